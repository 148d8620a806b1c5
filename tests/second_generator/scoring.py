"""What counts as right, written down before any answer was seen (docs/decisions/0026-second-generator.md)."""

import json
import re
from collections import Counter

from tests.second_generator.seeds import KINDS

CLASSES = (
    "right",
    "right_set",
    "partly",
    "wrong_name",
    "misreading",
    "other_set",
    "unexplained",
    "nothing_wrong",
    "not_identifiable",
    "no_answer",
)
MISREADING = re.compile(r"the other way round|\bin degrees\b|\bnot in rad\b")
"""What a summary says where it takes the columns for misread; no case has misread columns."""
EVERYWHERE = "all joints"
NEAR = 4.0
"""Visibility below which a cause is near its limit; a case counts with its faintest cause."""


def classify(truth, answer):
    """The class of one answer, of ``CLASSES``."""
    verdict = answer["verdict"]
    if says_misreading(answer):
        return "misreading"
    if verdict in {"unexplained", "nothing_wrong", "not_identifiable"}:
        return verdict
    said = said_places(answer["causes"], truth["session"]["joint_names"])
    found = [is_found(cause, said) for cause in truth["causes"]]
    if verdict == "confusable":
        return _class_of_set(found, answer)
    return _class_of_names(found, said, truth["causes"]) if verdict == "named" else "no_answer"


def _class_of_set(found, answer):
    if found and all(found) and answer.get("record_next"):
        return "right_set"
    return "partly" if len(found) > 1 and any(found) else "other_set"


def _class_of_names(found, said, causes):
    if not said or any(not belongs(effect, where, causes) for effect, places in said.items() for where in places):
        return "wrong_name"
    return "right" if found and all(found) else "partly"


def says_misreading(answer):
    """Whether an answer blames the declared units or signs."""
    listed = (answer.get("more") or {}).get("misreadings")
    return bool(listed) or MISREADING.search(answer.get("summary") or "") is not None


def said_places(causes, joint_names):
    """Effects that an answer lists, each with its places: {effect: {where, ...}}; "all joints" is each of them."""
    said = {}
    for cause in causes or ():
        where = cause.get("where")
        said.setdefault(cause["effect"], set()).update(joint_names if where == EVERYWHERE else {where})
    return said


def names_of(cause):
    """Names that say the truth of a hidden cause; none where the catalogue lacks it."""
    return set() if cause["effect"] == "outside" else {cause["effect"], *cause["same_physics"]}


def places_of(cause):
    """Joints of a hidden cause; empty for one of the whole arm."""
    return {place["where"] for place in cause["places"] if place["where"] is not None}


def is_found(cause, said):
    """Whether one of the names stands there with at least half of the places (any place does for a cause of the whole arm)."""
    places = places_of(cause)
    return any(not places or len(places & said[name]) * 2 >= len(places) for name in names_of(cause) & set(said))


def belongs(effect, where, causes):
    """Whether a named effect at a place is one of the hidden causes."""
    return any(effect in names_of(cause) and (not places_of(cause) or where in places_of(cause)) for cause in causes)


def values_of(truth, answer):
    """Whether the 90 % interval of each rightly named value holds the hidden one: a list of booleans."""
    hidden = {}
    for cause in truth["causes"]:
        for place in cause["places"]:
            for parameter, value in place["parameters"].items():
                if not isinstance(value, list):
                    hidden[cause["effect"], place["where"], parameter] = value + place["declared"]
    held = []
    for cause in answer["causes"] or ():
        value = hidden.get((cause["effect"], cause.get("where"), cause.get("parameter")))
        if value is not None and cause.get("interval_90"):
            low, high = cause["interval_90"]
            held.append(low <= value <= high)
    return held


def score(rows, truths):
    """Counts of an answered run: classes by kind and by visibility, false alarms, wrong names, intervals.

    ``rows`` are answers (the last of a case counts), ``truths`` maps a case to what is hidden there.
    """
    last = {row["case"]: row for row in rows}
    table = {kind: Counter() for kind in KINDS}
    seen = {"near the limit": Counter(), "clear": Counter()}
    by_law, held = {}, []
    for name, truth in sorted(truths.items()):
        if name not in last:
            continue
        found = classify(truth, last[name])
        table[truth["kind"]][found] += 1
        for cause in truth["causes"]:
            by_law.setdefault(cause["law"], Counter())[found] += 1
        if truth["kind"] == "single":
            seen["near the limit" if truth["causes"][0]["visibility"] < NEAR else "clear"][found] += 1
        if last[name]["verdict"] == "named":
            held += values_of(truth, last[name])
    healthy = table["healthy"]
    return {
        "answered": sum(sum(counts.values()) for counts in table.values()),
        "made": len(truths),
        "by_kind": {kind: dict(counts) for kind, counts in table.items()},
        "single_by_visibility": {key: dict(counts) for key, counts in seen.items()},
        "by_law": {law: dict(counts) for law, counts in sorted(by_law.items())},
        "wrong_names": sum(counts["wrong_name"] + counts["misreading"] for counts in table.values()),
        "false_alarms": sum(healthy[key] for key in ("wrong_name", "misreading", "other_set", "unexplained")),
        "intervals_that_hold": [sum(held), len(held)],
    }


def read_truths(folder):
    """What is hidden, by case."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}


def text_of(counts):
    """The counts as tables for the console."""
    heads = [key.replace("_", " ") for key in CLASSES]
    lines = [
        f"{counts['answered']} of {counts['made']} cases answered",
        "",
        f"{'':20}" + "".join(f"{head:>17}" for head in heads),
    ]
    for part in ("by_kind", "single_by_visibility", "by_law"):
        for key, row in counts[part].items():
            lines.append(f"{key:20}" + "".join(f"{row.get(name, 0):>17}" for name in CLASSES))
        lines.append("")
    right = {kind: sum(counts["by_kind"][kind].get(key, 0) for key in ("right", "right_set")) for kind in ("single", "double")}
    total = {kind: sum(row.values()) for kind, row in counts["by_kind"].items()}
    outside = counts["by_kind"]["outside"].get("unexplained", 0)
    lines.append(f"right: single {right['single']} of {total['single']}, double {right['double']} of {total['double']}")
    lines.append(f"outside, called unexplained: {outside} of {total['outside']}")
    lines.append(f"wrong names: {counts['wrong_names']} of {counts['answered']}")
    lines.append(f"false alarms: {counts['false_alarms']} of {total['healthy']}")
    held, named = counts["intervals_that_hold"]
    lines.append(f"90 % intervals of rightly named values that hold the truth: {held} of {named}")
    return "\n".join(lines)
