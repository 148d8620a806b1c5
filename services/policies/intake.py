"""What is checked of weights before anything parses or inflates them: their size, their first bytes and their structure.

All of it works on the file as it lies on disk, costs at most a tenth of a second of CPU time and keeps nothing of it in memory.
"""

import mmap
from pathlib import Path

from api_schemas.policy import WeightsFormat
from services.errors import TooLarge
from services.policies.foreign import FIRST_BYTES, check_start, named_foreign
from services.policies.onnx_wire import check_onnx
from services.policies.safetensors_header import check_safetensors
from services.policies.sb3_archive import check_entries_of
from services.policies.unfit import UnfitError, printable, refused


def weights_format(filename: str | None) -> WeightsFormat:
    """The form of the weights, by the end of their file's name.

    Raises:
        Refused: none of those that are taken.
    """
    for known in WeightsFormat:
        if (filename or "").lower().endswith(f".{known}"):
            return known
    raise refused(named_foreign(filename), filename)


def check_weights(path: Path, kind: WeightsFormat, limit_bytes: int, filename: str | None = None) -> None:
    """Raises unless the file may be given to a parser.

    Args:
        path: the file.
        kind: its format by its name.
        limit_bytes: the most that is taken.
        filename: what its owner calls it; without it the path's name.

    Raises:
        TooLarge: over the limit.
        Refused: empty, another format, or not well formed.
    """
    size, name = path.stat().st_size, filename or path.name
    if size > limit_bytes:
        detail = f"{printable(name)}: the weights have {size} bytes; at most {limit_bytes} are taken."
        raise TooLarge("weights-too-large", detail, file=printable(name), part="", instead="send the policy's network alone")
    try:
        if size == 0:
            raise UnfitError(
                "the weights' file is empty", slug="weights-empty", instead="check that the upload was not cut short"
            )
        with path.open("rb") as file:
            # Not closed by hand: views of it may still be held where an error was raised.
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        content = memoryview(mapped)
        check_start(bytes(content[:FIRST_BYTES]), kind)
        if kind == WeightsFormat.ZIP:
            check_entries_of(content, limit_bytes)
        else:
            check = check_onnx if kind == WeightsFormat.ONNX else check_safetensors
            check(content, lambda: mapped.madvise(mmap.MADV_DONTNEED))
    except UnfitError as error:
        # Without the error's own frames, which would keep the file mapped.
        raise refused(error, name) from None
