"""What a study found, in sentences: for the console and for the head of the page."""

from collections.abc import Mapping, Sequence
from typing import Any

from sim_backend.reality_gap.report.numbers import (
    UNKNOWN,
    count,
    interval,
    number,
    percent,
    probability,
    quantity,
    quantity_with_interval,
    readable_unit,
    real,
    with_unit,
)
from sim_backend.reality_gap.verdict import AXES

Document = Mapping[str, Any]

HEADLINES = {
    "named": "The data name what is wrong with the model.",
    "confusable": "The model is wrong, but these data fit more than one explanation.",
    "unexplained": "The model is wrong, and no cause of the catalogue explains how.",
    "nothing_wrong": "The data show nothing wrong with the model.",
    "not_identifiable": "These data cannot show what is wrong, or whether anything is.",
    "calibrated": "Numbers of the model were calibrated to the data, which names no cause.",
}
_MOST_LISTED = 8
_MOST_PLACES = 10
"""More causes than that are told by effect; each one's value with its interval is in the table and in study.json."""
_UNIT_SUFFIXES = frozenset(("nm", "n", "rad", "s", "ms", "m", "mm", "kg", "k", "hz", "v", "a", "w", "m2", "s2"))


def words(name: Any) -> str:
    """A name as text on one line: control characters become blanks, nothing else changes."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in str(name)).split())


def effect_name(name: Any) -> str:
    """``coulomb_friction`` as ``coulomb friction``."""
    return words(name).replace("_", " ")


def label_name(label: Any) -> str:
    """``coulomb_friction, finger0_joint_upper`` as ``coulomb friction, finger0_joint_upper``: places keep their names."""
    effect, comma, where = words(label).partition(",")
    return effect_name(effect) + comma + where


def parameter_name(name: Any) -> str:
    """``damping_nm_s_rad`` as ``damping``: the value beside it has the unit."""
    parts = words(name).split("_")
    while len(parts) > 1 and parts[-1] in _UNIT_SUFFIXES:
        parts.pop()
    return " ".join(parts)


def kind_of(document: Document) -> str:
    """Kind of the verdict, such as ``named``."""
    return str(document["verdict"]["verdict"])


def headline(document: Document) -> str:
    """The verdict in one sentence."""
    kind = kind_of(document)
    if document["verdict"].get("misreads"):
        return "The model does not agree with the data as they are told."
    causes = len(_places(document["verdict"].get("causes") or ()))
    if kind == "named" and causes > 1:
        return f"The data name {causes} things that are wrong with the model."
    return HEADLINES.get(kind, effect_name(kind) + ".")


def place_of(effect: Any, where: Any) -> str:
    """Effect and where it sits, such as ``coulomb friction, finger0_joint_upper``."""
    return f"{effect_name(effect)}, {words(where)}" if words(where) else effect_name(effect)


def cause_sentences(document: Document) -> list[str]:
    """One sentence for each effect at each place, with all its numbers."""
    kind = kind_of(document)
    start = {"named": "Cause", "confusable": "Possible cause", "calibrated": "Calibrated"}.get(kind, "Considered")
    places = _places(document["verdict"].get("causes") or ())
    if len(places) > _MOST_PLACES:
        return _by_effect(start, places)
    sentences = []
    for (effect, where), causes in places.items():
        numbers = "; ".join(_number_of(cause, len(causes) > 1) for cause in causes)
        sentences.append(f"{start}: {place_of(effect, where)}: {numbers}.")
    return sentences


def _by_effect(start: str, places: Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]) -> list[str]:
    """One sentence for each effect: how many places, and from which value to which."""
    effects: dict[str, list[Mapping[str, Any]]] = {}
    for (effect, _), causes in places.items():
        effects.setdefault(effect, []).append(causes[0])
    found = []
    for effect, causes in effects.items():
        if len(causes) == 1:
            found.append(f"{start}: {place_of(effect, causes[0]['where'])}: {_number_of(causes[0], False)}.")
            continue
        unit = words(causes[0].get("unit", ""))
        low, high = (quantity(end(cause["value"] for cause in causes), unit) for end in (min, max))
        found.append(f"{start}: {effect_name(effect)}, {len(causes)} places: {low} to {high}.")
    return found


def evidence_sentences(document: Document) -> list[str]:
    """Held-out error, runner-up, null test, what the error follows, success and the upper bound, as far as they are there."""
    verdict = document["verdict"]
    misreads = verdict.get("misreads")
    sentences = [
        *(line for held_out in verdict.get("held_out_there") or () for line in _held_out(held_out)),
        *_held_out(verdict.get("held_out")),
        *_residual_network(None if misreads else document.get("residual_network")),
        *_null(verdict.get("null_p")),
        *_runner_up(verdict.get("runner_up")),
        *_rejected(verdict.get("rejected") or (), verdict.get("runner_up")),
        *_success(document.get("success")),
    ]
    if follows := [each for each in verdict.get("follows") or () if each != misreads]:
        what = "What little differs" if verdict.get("verdict") == "nothing_wrong" else "What is left of the error"
        sentences.append(f"{what} follows: {listed(follows)}.")
    return sentences


def data_sentence(document: Document) -> list[str]:
    """How much was recorded and what it was used for."""
    recordings = document.get("recordings") or ()
    if not recordings:
        return []
    duration_s = sum(real(recording.get("duration_s")) or 0.0 for recording in recordings)
    samples = sum(real(recording.get("samples")) or 0.0 for recording in recordings)
    uses: dict[str, int] = {}
    for recording in recordings:
        use = words(recording.get("used_for", UNKNOWN))
        uses[use] = uses.get(use, 0) + 1
    how = "; ".join(f"{count(n)} {use}" for use, n in uses.items())
    plural = "recording" if len(recordings) == 1 else "recordings"
    return [f"Data: {count(len(recordings))} {plural} of {number(duration_s)} s together, {count(samples)} samples ({how})."]


def listed(items: Sequence[Any]) -> str:
    """Items with commas; a long list ends with how many more there are."""
    shown = [words(item).rstrip(".") for item in items[:_MOST_LISTED]]
    more = len(items) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def sentence(text: Any) -> str:
    """One line that ends as a sentence does."""
    line = words(text)
    return line if line.endswith((".", "!", "?", ":")) or not line else line + "."


def _places(causes: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], list[Mapping[str, Any]]]:
    """Causes by effect and place; axes are one place."""
    places: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for cause in causes:
        places.setdefault((cause["effect"], "" if cause["where"] in AXES else cause["where"]), []).append(cause)
    return places


def _number_of(cause: Mapping[str, Any], several: bool) -> str:
    value = quantity_with_interval(cause.get("value"), words(cause.get("unit", "")), cause.get("interval_90"))
    axis = f" {cause['where']}" if cause["where"] in AXES else ""
    return f"{parameter_name(cause.get('parameter', ''))}{axis} {value}" if several or axis else value


def _held_out(held_out: Mapping[str, Any] | None) -> list[str]:
    if not held_out:
        return []
    unit = words(held_out["unit"])
    before, after = held_out.get("before"), held_out.get("after")
    known = [value for value in (real(before), real(after)) if value is not None]
    factor, shown_unit = readable_unit(max(map(abs, known), default=0.0), unit)
    start, end = (number(None if (value := real(each)) is None else factor * value) for each in (before, after))
    what = "Held-out error" if held_out.get("is_unseen", True) else "Error on fitted data, as none was held out"
    sentence_ = f"{what} ({words(held_out['metric'])}, {count(held_out.get('samples'))} samples): "
    sentence_ += f"{start} → {with_unit(end, shown_unit)}{_reduction(held_out)}"
    floor = held_out.get("noise_floor")
    if real(floor) is not None:
        sentence_ += f"; noise floor {quantity(floor, unit)}{_excess(before, after, floor)}"
    return [sentence_ + "."]


def _reduction(held_out: Mapping[str, Any]) -> str:
    share, between = real(held_out.get("reduction")), interval(held_out.get("reduction_interval_95"))
    if share is None:
        return ""
    span = "" if between is None else f", 95 % interval {_signed_percent(-between[0])} to {_signed_percent(-between[1])} %"
    return f" ({_signed_percent(-share)} %{span})"


def _signed_percent(share: float) -> str:
    text = percent(share)
    return text if text.startswith("−") or text == "0" else f"+{text}"


def _excess(before: Any, after: Any, floor: Any) -> str:
    start, end, least = real(before), real(after), real(floor)
    if start is None or end is None or least is None or start <= least or end >= start:
        return ""
    return f", so that {percent(min((start - end) / (start - least), 1.0))} % of the excess over it is gone"


def _residual_network(network: Mapping[str, Any] | None) -> list[str]:
    if not network or real(network.get("held_out")) is None:
        return []
    least = quantity(network["held_out"], words(network.get("unit", "")))
    return [f"A flexible network fitted to the residual reaches {least}: about the most that any explanation could gain."]


def _null(p: Any) -> list[str]:
    if real(p) is None:
        return []
    share = "under 0.1" if float(p) < 0.0005 else percent(p, 1 if float(p) < 0.1 else 0)
    return [f"Null test: {probability(p)}; {share} % of healthy sessions show as large a gain by chance, of whichever effect."]


def _runner_up(rival: Mapping[str, Any] | None) -> list[str]:
    if not rival:
        return []
    behind = _behind(rival)
    by = words(rival.get("separated_by") or "")
    tail = f"; what separates them: {by}" if by else ""
    return [sentence(f"Runner-up: {place_of(rival['effect'], rival['where'])}, {behind}{tail}")]


def _rejected(rivals: Sequence[Mapping[str, Any]], runner_up: Mapping[str, Any] | None) -> list[str]:
    """Other explanations that lost, one for each effect, beside the runner-up."""
    seen, found = {(runner_up or {}).get("effect")}, []
    for rival in rivals:
        if rival["effect"] in seen:
            continue
        seen.add(rival["effect"])
        by = words(rival.get("separated_by") or "")
        found.append(f"{place_of(rival['effect'], rival['where'])} ({_behind(rival)}{f'; {by}' if by else ''})")
    return [f"Rejected, too: {listed(found)}."] if found else []


def _behind(rival: Mapping[str, Any]) -> str:
    """How far a rival lies behind, or ahead where it was not taken although it gains more."""
    behind = real(rival.get("behind"))
    if behind is not None and behind < 0.0:
        return f"{number(-behind, 2)} nats ahead"
    return f"{number(behind, 2)} nats behind"


def _success(success: Mapping[str, Any] | None) -> list[str]:
    if not success:
        return []
    parts = []
    for row in success.get("rows") or ():
        between = interval(row.get("interval_80"))
        span = "" if between is None else f" (80 %: {percent(between[0])} to {percent(between[1])})"
        parts.append(f"{_SUCCESS_WORDS.get(row['label'], words(row['label']))} {percent(row.get('rate'))} %{span}")
    line = f"Success over {count(success.get('trials'))} trials: {', '.join(parts)}"
    before, after = real(success.get("gap_before")), real(success.get("gap_after"))
    if before is not None and after is not None:
        line += f"; gap to the measured rate {percent(before)} → {percent(after)} percentage points"
    return [line + "."]


_SUCCESS_WORDS = {
    "nominal": "simulated with the nominal model",
    "extended": "simulated with the extended model",
    "measured": "measured",
}
