"""What a schema says of a wrong value, as a sentence about what the user wrote."""

from pydantic import ValidationError

LONGEST_VALUE = 60


def sentence(error: ValidationError, whole: str) -> str:
    """The first thing that is wrong, such as "trials is -1 and should be greater than or equal to 1".

    Args:
        error: of the schema.
        whole: the name of what was checked, for what is wrong with all of it.
    """
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    match first["type"]:
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            return f"{where} is not known there"
        case "value_error":
            reason = str(first.get("ctx", {}).get("error", first["msg"]))
            return f"{where}: {reason}" if where else reason
    _, should, wanted = first["msg"].partition(" should ")
    if not should:
        return f"{where or whole}: {first['msg']}"
    shown = repr(first["input"])
    shown = shown if len(shown) <= LONGEST_VALUE else shown[: LONGEST_VALUE - 1] + "…"
    return f"{where or whole} is {shown} and should {wanted}"
