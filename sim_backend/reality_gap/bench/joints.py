"""The blind test on joints, ``trifarm gap blind-test --cases N --seed S --out DIR``: hides effects in robots, asks, counts.

N cases with an effect, N/2 healthy robots, and half of the cases at 5 times the detection limit again with the true cause taken
out of the catalogue. Each case is a line of ``cases-SEED.jsonl``, so that a test goes on where it stopped; a test in several
folders or with several seeds is summarised together by giving the same folder. Those of another excitation than ``standard`` have
their own files, ``cases-EXCITATION-SEED.jsonl``, and their own summary. Detection limits are those of ``standard`` throughout.
"""

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.bench.counting import share, whole_lines
from sim_backend.reality_gap.bench.joint_cases import MULTIPLES, Case, draw_cases, keys_shown_by, recordings_of
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, IN_THE_AIR
from sim_backend.reality_gap.knowledge.healthy import STANDARD, detection_limits
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS
from sim_backend.reality_gap.knowledge.joint_effects import FITTED
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, study_joints
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import VerdictKind
from sim_backend.refusal import refused
from sim_backend.trifinger.scene import compile_scene
from sim_backend.workers.pool import WorkersError, open_workers

SEEDS_USED = "2301, 2303, 2305, 5001, 5002, 5003, 88001, 88002; with other excitations than 'standard' 41 and 42, too"
_TOGETHER = 4


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(
        prog="trifarm gap blind-test", description="Hide effects in simulated robots and ask for them."
    )
    parser.add_argument("--cases", type=int, default=30, metavar="N", help="cases with an effect; N/2 healthy robots come on top")
    parser.add_argument(
        "--seed", type=int, default=1, help=f"of the cases; not one that thresholds were made with ({SEEDS_USED})"
    )
    parser.add_argument(
        "--excitation",
        default=STANDARD,
        choices=(*IN_THE_AIR, EVERYTHING),
        help="what the robots are seen by (%(default)s); sizes are multiples of the detection limits of 'standard' all the same",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("blind-test"), metavar="DIR", help="where results are kept (%(default)s)"
    )
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    if options.cases < 0 or options.processes < 1:
        parser.error("--cases must be at least 0 and --processes at least 1")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        run(options.out, options.cases, options.seed, options.excitation, options.processes, options.cluster)
        files = sorted(options.out.glob(_lines_name("[0-9]*", options.excitation)))
        document = summary([line for path in files for line in whole_lines(path)])
        named = "blind-test.json" if options.excitation == STANDARD else f"blind-test-{options.excitation}.json"
        (options.out / named).write_text(json.dumps(document, indent=1))
    except (OSError, WorkersError) as error:
        return refused(error, options.json)
    print(json.dumps(document) if options.json else "\n".join(sentences(document)))
    return 0


def _lines_name(seed: int | str, excitation: str) -> str:
    """Of the file of cases; those of other excitations than the standard one are never counted together with it."""
    return f"cases-{seed}.jsonl" if excitation == STANDARD else f"cases-{excitation}-{seed}.jsonl"


def run(out: Path, cases: int, seed: int, excitation: str = STANDARD, workers: int = 0, cluster: str | None = None) -> None:
    """Do what is not done yet of a test; workers as for ``open_workers``."""
    lines = out / _lines_name(seed, excitation)
    kept = whole_lines(lines)
    done = {(line["case"]["number"], line["left_out"]) for line in kept}
    lines.write_text("".join(json.dumps(line) + "\n" for line in kept))
    drawn = draw_cases(seed, cases, cases // 2, detection_limits(), keys_shown_by(excitation))
    todo = [(case, False) for case in drawn] + [
        (case, True) for case in drawn[:cases] if case.multiple == MULTIPLES[-1] and case.number % 2 == 0
    ]
    todo = [(case, left_out) for case, left_out in todo if (case.number, left_out) not in done]
    groups = [todo[i : i + _TOGETHER] for i in range(0, len(todo), _TOGETHER)]
    begun, finished = time.monotonic(), 0
    with open_workers(_Judge, workers, cluster) as opened, lines.open("a") as file:
        for judged in opened.map(groups, excitation):
            file.writelines(json.dumps(line) + "\n" for line in judged)
            file.flush()
            finished += len(judged)
            left_s = (time.monotonic() - begun) / finished * (len(todo) - finished)
            print(f"{finished} of {len(todo)} cases, about {left_s / 60:.0f} min left", file=sys.stderr, flush=True)


class _Judge:
    """What a worker does: the lines of a group of cases, each with whether its true cause is left out."""

    def __init__(self) -> None:
        self._model = compile_scene()

    def __call__(self, group: Sequence[tuple[Case, bool]], excitation: str) -> list[dict]:
        found = []
        seen = recordings_of([case for case, _ in group], excitation)
        for (case, left_out), recordings in zip(group, seen, strict=True):
            begun = time.monotonic()
            excluded = _with_containing(case.effect) if left_out else ()
            robot = KnownTriFinger.seen_in(recordings)
            study = study_joints(self._model, recordings, lambda *_: None, robot=robot, excluded=excluded)
            judged = judge(study)
            strongest = judged.patterns[0] if judged.patterns else None
            found.append(
                {
                    "case": case.document(),
                    "left_out": left_out,
                    "verdict": judged.verdict.document(),
                    "gains": [a.gain for a in study.fit.accepted],
                    "pattern": [strongest.channel, strongest.joint, strongest.variable, strongest.gain] if strongest else [],
                    "naive": _naive(study),
                    "seconds": time.monotonic() - begun,
                }
            )
        return found


def _with_containing(effect: str) -> tuple[str, ...]:
    """An effect, what is the same with more numbers, and what with fewer: without the one, the other is the right name."""
    contained = FITTED[effect].contains if effect in FITTED else ""
    return tuple(other for other in CATALOGUE if other in (effect, contained) or _contains(other, effect))


def _contains(effect: str, other: str) -> bool:
    return effect in FITTED and FITTED[effect].contains == other


def _naive(study: JointStudy) -> dict[str, list[str]]:
    """What simpler rules would have named: smallest error of the fit, BIC with every row counted, largest z-score."""
    look = study.fit.first
    allowed = [c for c in look.candidates if c.allowed and len(c.hypothesis.terms) <= 2]
    if not allowed:
        return {}
    rows = float(look.sums.rows.sum())
    smallest = max(allowed, key=lambda c: c.gain)
    bic = max(allowed, key=lambda c: c.gain - 0.5 * len(c.values) * np.log(rows))
    largest = max(allowed, key=lambda c: float(np.max(np.abs(c.values) / c.errors)))
    names = {"smallest_error": smallest, "bic": bic, "largest_z": largest}
    return {rule: list(candidate.hypothesis.name) for rule, candidate in names.items()}


def outcome(line: dict) -> str:
    """How a case ended.

    One of ``right``, ``right set`` (confusable, the truth among them), ``extra`` (right and more), ``wrong``, ``unexplained``
    and ``missed``.
    """
    verdict, truth = line["verdict"], (line["case"]["effect"], line["case"]["where"])
    causes = {(cause["effect"], _where(cause)) for cause in verdict["causes"]}
    match verdict["verdict"]:
        case VerdictKind.NOTHING_WRONG | VerdictKind.NOT_IDENTIFIABLE:
            return "missed"
        case VerdictKind.UNEXPLAINED:
            return "unexplained"
        case VerdictKind.CONFUSABLE:
            return "right set" if truth in causes else "wrong"
    if causes == {truth}:
        return "right"
    return "extra" if truth in causes else "wrong"


def _where(cause: dict) -> str:
    parameter = PARAMETERS[f"{cause['effect']}.{cause['parameter']}"]
    return cause["where"] if parameter.scope is Scope.JOINT else PLATFORM


def summary(lines: Sequence[dict]) -> dict:
    """Counts with 90 % Wilson intervals, by magnitude and by effect, and the confusion matrix."""
    effects = [line for line in lines if line["case"]["effect"] and not line["left_out"]]
    nulls = [line for line in lines if not line["case"]["effect"]]
    left_out = [line for line in lines if line["left_out"]]
    ends = {id(line): outcome(line) for line in (*effects, *left_out)}
    large = [line for line in effects if line["case"]["multiple"] >= 2.0]
    false = [line for line in nulls if line["verdict"]["verdict"] != VerdictKind.NOTHING_WRONG]
    errors = [_error(line) for line in effects if ends[id(line)] == "right" and not np.isnan(_error(line))]
    by_multiple = {
        f"{multiple:g}": dict(Counter(ends[id(line)] for line in effects if line["case"]["multiple"] == multiple))
        for multiple in (1, 2, 5)
    }
    by_effect: dict[str, dict] = defaultdict(dict)
    for effect in dict.fromkeys(line["case"]["key"] for line in large):
        by_effect[effect] = dict(Counter(ends[id(line)] for line in large if line["case"]["key"] == effect))
    return {
        "n_effect": len(effects),
        "n_null": len(nulls),
        "n_left_out": len(left_out),
        "right_name": share(sum(ends[id(line)] == "right" for line in large), len(large)),
        "right_name_all_magnitudes": share(sum(ends[id(line)] == "right" for line in effects), len(effects)),
        "right_name_or_set": share(sum(ends[id(line)] in ("right", "right set") for line in large), len(large)),
        "false_alarm": share(len(false), len(nulls)),
        "wrong_name": share(sum(ends[id(line)] == "wrong" for line in effects), len(effects)),
        "unexplained": share(sum(ends[id(line)] == "unexplained" for line in left_out), len(left_out)),
        "unexplained_among_effects": share(sum(ends[id(line)] == "unexplained" for line in effects), len(effects)),
        "median_parameter_error": float(np.median(errors)) if errors else None,
        "interval_coverage": share(*_coverage([line for line in effects if ends[id(line)] == "right"])),
        "median_seconds": float(np.median([line["seconds"] for line in lines])) if lines else None,
        "by_multiple": by_multiple,
        "by_effect_2x_5x": dict(by_effect),
        "naive_right_name": {
            rule: share(sum(_is_named(line, line["naive"].get(rule)) for line in large), len(large))
            for rule in ("smallest_error", "bic", "largest_z")
        },
        "confusion": _confusion(large),
        "false_alarms": [[cause["effect"] for cause in line["verdict"]["causes"]] for line in false],
        "left_out": [[line["case"]["key"], ends[id(line)]] for line in left_out],
    }


def _is_named(line: dict, name: Sequence[str] | None) -> bool:
    return name is not None and tuple(name) == (line["case"]["effect"], line["case"]["where"])


def _true_cause(line: dict) -> dict | None:
    parameter = line["case"]["key"].partition(".")[2]
    for cause in line["verdict"]["causes"]:
        is_vector = PARAMETERS[line["case"]["key"]].scope is Scope.VECTOR
        is_axis = not is_vector or cause["where"] == "xyz"[line["case"]["joint"]]
        if cause["effect"] == line["case"]["effect"] and cause["parameter"] == parameter and is_axis:
            return cause
    return None


def _error(line: dict) -> float:
    """Relative to the deviation from absent; NaN where the size means nothing."""
    cause, absent = _true_cause(line), PARAMETERS[line["case"]["key"]].absent
    if cause is None or AT_JOINTS[line["case"]["key"]].is_whole:
        return float("nan")
    return abs(cause["value"] - line["case"]["value"]) / abs(line["case"]["value"] - absent)


def _coverage(lines: Sequence[dict]) -> tuple[int, int]:
    causes = [(line, cause) for line in lines if (cause := _true_cause(line)) is not None and not np.isnan(_error(line))]
    inside = sum(cause["interval_90"][0] <= line["case"]["value"] <= cause["interval_90"][1] for line, cause in causes)
    return inside, len(causes)


def _confusion(lines: Sequence[dict]) -> dict[str, dict[str, int]]:
    """By true effect, what was said: effects joined by +, or the kind of verdict."""
    matrix: dict[str, Counter] = defaultdict(Counter)
    for line in lines:
        kind = line["verdict"]["verdict"]
        named = "+".join(sorted({cause["effect"] for cause in line["verdict"]["causes"]}))
        said = named if kind == VerdictKind.NAMED else f"({kind})" if kind != VerdictKind.CONFUSABLE else f"{named}?"
        matrix[line["case"]["effect"]][said] += 1
    return {effect: dict(said) for effect, said in sorted(matrix.items())}


def sentences(document: dict) -> list[str]:
    """The summary for a person."""

    def said(share: dict) -> str:
        if share["rate"] is None:
            return "not asked"
        low, high = share["interval_90"]
        return f"{share['rate']:.0%} ({share['k']} of {share['n']}, 90 %: {low:.0%} to {high:.0%})"

    error = document["median_parameter_error"]
    lines = [
        f"{document['n_effect']} robots with an effect, {document['n_null']} healthy ones",
        f"right name at 2 and 5 times the detection limit: {said(document['right_name'])}",
        f"false alarms: {said(document['false_alarm'])}",
        f"wrong name: {said(document['wrong_name'])}",
        f"true cause not in the catalogue, called unexplained: {said(document['unexplained'])}",
    ]
    return lines if error is None else [*lines, f"median error of the value: {error:.1%}"]


if __name__ == "__main__":
    raise SystemExit(main())
