"""The blind test on cubes: effects hidden in pushing and resting logs, found or not by a tool with thresholds set before.

``python -m sim_backend.reality_gap.bench.cube --cases N --seed S --out DIR [--json]`` simulates N robots with an effect,
half as many healthy ones and a tenth with an error of a joint, and judges them. What ``--out`` holds of simulations is not done
again. Cases of 2 and 5 times the detection limit are judged a second time without the hypothesis that is true, which should leave
them unexplained.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.bench.counting import share
from sim_backend.reality_gap.bench.cube_cases import (
    LEVELS,
    CubeCase,
    Simulate,
    effect_cases,
    gather,
    joint_cases,
    load_evidence,
    null_cases,
)
from sim_backend.reality_gap.knowledge.hidden import OF_CUBE
from sim_backend.reality_gap.subjects.cube.healthy import HealthyCubes, load_calibration
from sim_backend.reality_gap.subjects.cube.study import CubeStudy, study_evidence
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.verdict import VerdictKind
from sim_backend.refusal import refused
from sim_backend.workers.pool import WorkersError, open_workers

_LEFT_OUT = (VerdictKind.UNEXPLAINED, VerdictKind.CONFUSABLE, VerdictKind.NAMED, VerdictKind.NOTHING_WRONG)


@dataclass(frozen=True)
class Judgement:
    """What the tool said of a case.

    Attributes:
        error: that of the effect's size over the size, where the name was right.
        held: for each number of an effect that was rightly named alone, whether its interval holds the truth.
        left_out: what it said without the true hypothesis, None where that was not asked.
    """

    case: CubeCase
    verdict: VerdictKind
    causes: tuple[str, ...]
    null_p: float
    pushes: int
    error: float | None
    held: tuple[bool, ...] = ()
    left_out: str | None = None

    @property
    def is_right(self) -> bool:
        """The right name, alone or in a confusable set."""
        return self.case.effect in self.causes

    @property
    def said(self) -> str:
        """For the confusion matrix: the name, the set, or what there was instead of one."""
        return " or ".join(sorted(self.causes)) if self.causes else str(self.verdict)


def judge_case(case: CubeCase, study: CubeStudy, without: CubeStudy | None = None) -> Judgement:
    """Compare a study, and one ``without`` the true hypothesis, with what was hidden."""
    verdict = study.verdict
    causes = tuple(dict.fromkeys(cause.effect for cause in verdict.causes))
    error, held = None, ()
    own = [cause for cause in verdict.causes if cause.effect == case.effect]
    if own and case.value:
        absent = PARAMETERS[OF_CUBE[case.effect]].absent
        true = np.array(case.value)
        error = float(np.linalg.norm([cause.value for cause in own] - true[: len(own)]) / np.linalg.norm(true - absent))
        if verdict.verdict is VerdictKind.NAMED and causes == (case.effect,):
            held = tuple(
                bool(low <= value <= high) for value, (low, high) in zip(case.value, (c.interval_90 for c in own), strict=False)
            )
    left_out = None if without is None else str(without.verdict.verdict)
    return Judgement(case, verdict.verdict, causes, verdict.null_p or 1.0, study.pushes, error, held, left_out)


def results(judged: Sequence[Judgement], calibration: HealthyCubes, limits: Mapping[str, float]) -> dict[str, Any]:
    """The test's numbers, plain values for JSON."""
    effects = [row for row in judged if row.case.level > 0.0]
    nulls = [row for row in judged if not row.case.effect]
    joints = [row for row in judged if row.case.effect and row.case.level == 0.0]
    strong = [row for row in effects if row.case.level >= 2.0]
    named = (VerdictKind.NAMED, VerdictKind.CONFUSABLE)
    return {
        "n_effect": len(effects),
        "n_null": len(nulls),
        **_shares(effects),
        "false_alarm": _rate([row.verdict is not VerdictKind.NOTHING_WRONG for row in nulls]),
        "right_name_2x_5x": _rate([row.is_right for row in strong]),
        "interval_coverage": _rate([held for row in effects for held in row.held]),
        "right_name_alone": _rate([row.is_right and row.verdict is VerdictKind.NAMED for row in effects]),
        "by_level": {f"{level:g}x": _shares([row for row in effects if row.case.level == level]) for level in LEVELS},
        "by_effect": {effect: _shares([row for row in effects if row.case.effect == effect]) for effect in OF_CUBE},
        "left_out_2x_5x": {str(kind): _rate([row.left_out == str(kind) for row in strong if row.left_out]) for kind in _LEFT_OUT},
        "joint_errors_named_as_cube": _rate([row.verdict in named for row in joints]),
        "confusion": _confusion(judged),
        "detection_limits": dict(limits),
        "detection_limits_of_table": calibration.limits,
        "calibration": {"healthy_sessions": len(calibration.misfits), "seeds": calibration.seeds},
        "cases": [
            {**asdict(row.case), "said": row.said}
            | {"null_p": row.null_p, "error": row.error, "held": list(row.held), "left_out": row.left_out}
            for row in judged
        ],
    }


def _shares(effects: Sequence[Judgement]) -> dict[str, Any]:
    errors = [row.error for row in effects if row.error is not None]
    named = (VerdictKind.NAMED, VerdictKind.CONFUSABLE)
    return {
        "right_name": _rate([row.is_right for row in effects]),
        "wrong_name": _rate([row.verdict in named and not row.is_right for row in effects]),
        "unexplained": _rate([row.verdict is VerdictKind.UNEXPLAINED for row in effects]),
        "missed": _rate([row.verdict is VerdictKind.NOTHING_WRONG for row in effects]),
        "median_parameter_error": float(np.median(errors)) if errors else None,
    }


def _rate(marks: Sequence[bool]) -> dict[str, Any]:
    return share(sum(marks), len(marks))


def _confusion(judged: Sequence[Judgement]) -> dict[str, dict[str, int]]:
    """How often which answer came for what was hidden."""
    rows: dict[str, Counter[str]] = {}
    for row in judged:
        rows.setdefault(row.case.effect or "healthy", Counter())[row.said] += 1
    return {hidden: dict(counts.most_common()) for hidden, counts in rows.items()}


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="python -m sim_backend.reality_gap.bench.cube", description=__doc__)
    parser.add_argument("--cases", type=int, default=105, help="with an effect")
    parser.add_argument("--seed", type=int, default=83, help="other seeds than those the table was made with")
    parser.add_argument("--out", type=Path, default=Path("cube-blind-test"))
    parser.add_argument(
        "--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s); 0: none but this"
    )
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    options = parser.parse_args(arguments)
    if options.cases < 0 or options.processes < 0:
        parser.error("--cases and --processes must be at least 0")
    try:
        document = run(options.out, options.cases, options.seed, options.processes, options.cluster)
    except (OSError, WorkersError) as error:
        return refused(error, options.json)
    print(json.dumps(document, indent=1) if options.json else _sentences(document))
    return 0


def run(out: Path, count: int, seed: int, workers: int = 0, cluster: str | None = None) -> dict[str, Any]:
    """Simulate what is missing in a folder, judge all, and keep the results there; workers as for ``open_workers``."""
    calibration = load_calibration()
    limits = _kept_limits(out, calibration)
    cases = effect_cases(count, seed, limits) + null_cases(-(-count // 2), seed)
    cases += joint_cases(-(-count // 10), seed)
    with open_workers(Simulate, workers, cluster) as opened:
        _tell_progress("simulated", gather(cases, out, opened), len(cases))
    judged: list[Judgement] = []
    with open_workers(_Judge, workers, cluster) as opened:
        found = opened.map([(case, load_evidence(out / f"{case.name}.npz")) for case in cases], calibration)
        _tell_progress("judged", _kept_in(judged, found), len(cases))
    document = results(judged, calibration, limits)
    (out / "results.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return document


def _kept_in(judged: list[Judgement], found: Iterable[Judgement]) -> Iterator[int]:
    for row in found:
        judged.append(row)
        yield len(judged)


def _tell_progress(what: str, counts: Iterable[int], of: int) -> None:
    """How many are done and the time left, on standard error."""
    begun, first = time.monotonic(), None
    for done in counts:
        if first is None:  # there may have been some before
            begun, first = time.monotonic(), done
        left = f", about {(time.monotonic() - begun) / (done - first) * (of - done) / 60:.0f} min left" if done > first else ""
        if done % 10 == 0 or done == of:
            print(f"{done} of {of} cases are {what}{left}", file=sys.stderr, flush=True)


def _kept_limits(folder: Path, calibration: HealthyCubes) -> dict[str, float]:
    """Detection limits that the cases of this folder were made with, so that a newer table does not change half of them."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "limits.json"
    if not path.exists():
        path.write_text(json.dumps(calibration.limits, indent=1) + "\n", encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


class _Judge:
    """What a worker does: the judgement of a case by what its session left."""

    def __call__(self, item: tuple[CubeCase, CubeEvidence], calibration: HealthyCubes) -> Judgement:
        case, evidence = item
        study = study_evidence(evidence, np.random.default_rng([case.seed, 2]), calibration)
        without = None
        if case.level >= 2.0:
            without = study_evidence(evidence, np.random.default_rng([case.seed, 3]), calibration, without=(case.effect,))
        return judge_case(case, study, without)


def _sentences(document: Mapping[str, Any]) -> str:
    lines = [f"{document['n_effect']} robots with an effect, {document['n_null']} healthy ones"]
    for key in ("right_name", "right_name_2x_5x", "wrong_name", "unexplained", "missed", "false_alarm", "interval_coverage"):
        rate = document[key]
        if rate["n"]:
            low, high = rate["interval_90"]
            lines.append(f"{key}: {rate['k']} of {rate['n']}, {rate['rate']:.0%} (90 % {low:.0%} to {high:.0%})")
    for kind, rate in document["left_out_2x_5x"].items():
        lines.append(f"without the true hypothesis {kind}: {rate['k']} of {rate['n']}")
    lines.append(f"median parameter error: {document['median_parameter_error']}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
