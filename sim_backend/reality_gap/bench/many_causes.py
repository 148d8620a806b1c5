"""The blind test on robots that differ everywhere: does each interval hold the truth?

    python -m sim_backend.reality_gap.bench.many_causes --first-seed S --robots N --out DIR [--effects K] [--excitation NAME]

Robots are drawn from ``real``, or are healthy but for K of its effects, and are seen by one excitation or by everything. Each
is a line of ``robots.jsonl``, so that a test goes on where it stopped. With ``--calibrate`` errors of these robots and of those
in other folders become the usual ones (``knowledge/value_errors.json``): other seeds than those that are tested with.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Per, load_ranges
from sim_backend.reality_gap.bench.counting import share, whole_lines
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, IN_THE_AIR, healthy_physics, simulated_recordings
from sim_backend.reality_gap.knowledge.healthy import STANDARD, detection_limits
from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES, TILT
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.knowledge.value_errors import FILE, deviation, document
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.causes import index_of, is_clear, usual_errors_of
from sim_backend.reality_gap.subjects.joints.verdicts.untold import turned_bases
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import Cause, VerdictKind
from sim_backend.refusal import refused
from sim_backend.trifinger.constants import JOINT_NAMES
from sim_backend.trifinger.scene import compile_scene
from sim_backend.workers.pool import WorkersError, open_workers

LINES = "robots.jsonl"
"""Of a folder with results: a line for each robot."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Ask about robots that differ everywhere.")
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--effects", type=int, metavar="K", help="how many effects act; all of them if not given")
    parser.add_argument(
        "--excitation", default=STANDARD, choices=(*IN_THE_AIR, EVERYTHING), help="what the robots are seen by (%(default)s)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--processes", type=int, default=2, help="that work side by side (%(default)s)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    parser.add_argument(
        "--calibrate",
        type=Path,
        nargs="*",
        metavar="DIR",
        help="errors of these robots, and of those kept in DIR, become the usual ones",
    )
    options = parser.parse_args(arguments)
    if options.calibrate is not None and (options.effects is not None or options.excitation != STANDARD):
        parser.error(f"--calibrate is for robots with all effects, seen by {STANDARD}")
    seen = options.effects, options.excitation
    for folder in options.calibrate or ():
        if not any(_is_of(line, seen) for line in whole_lines(folder / LINES)):
            parser.error(f"--calibrate: there is no robot with all effects, seen by {STANDARD}, in {folder / LINES}")
    try:
        return _run(options)
    except (OSError, WorkersError) as error:
        return refused(error, as_json=False)


def _run(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    seeds = range(options.first_seed, options.first_seed + options.robots)
    seen = options.effects, options.excitation
    lines = _asked(options.out / LINES, seeds, seen, (options.processes, options.cluster))
    if options.calibrate is not None:
        others = [line for folder in options.calibrate for line in whole_lines(folder / LINES) if _is_of(line, seen)]
        robots = {line["seed"]: line["values"] for line in (*others, *lines)}
        FILE.write_text(json.dumps(document(list(robots.values()), sorted(robots)), indent=1) + "\n")
        print(f"wrote {FILE}: {len(robots)} robots")
    found = summary(lines)
    (options.out / "many-causes.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))
    return 0


def _asked(path: Path, seeds: Sequence[int], seen: tuple[int | None, str], at: tuple[int, str | None]) -> list[dict]:
    """The lines of all seeds with so many effects and an excitation; what is not there yet is asked."""
    there = whole_lines(path)
    path.write_text("".join(json.dumps(line) + "\n" for line in there))
    kept = [line for line in there if line["seed"] in seeds and _is_of(line, seen)]
    todo = [seed for seed in seeds if seed not in {line["seed"] for line in kept}]
    with open_workers(_Asker, *at) as workers, path.open("a") as file:
        for line in workers.map(todo, seen):
            kept.append(line)
            file.write(json.dumps(kept[-1]) + "\n")
            file.flush()
            print(f"{len(kept)} of {len(seeds)} robots", file=sys.stderr, flush=True)
    return sorted(kept, key=lambda line: line["seed"])


def _is_of(line: Mapping, seen: tuple[int | None, str]) -> bool:
    """Whether a line is of robots with so many effects that an excitation has seen."""
    return (line["effects"], line.get("excitation", STANDARD)) == seen


def is_of_real(line: Mapping) -> bool:
    """Whether a line is of a robot with all effects that the standard excitation has seen."""
    return _is_of(line, (None, STANDARD))


def robot(seed: int, effects: int | None = None) -> Physics:
    """A robot of ``real``, or a healthy one with so many of the effects of ``real`` that joints can show, drawn with the seed."""
    rng = np.random.default_rng([seed, 1])
    if effects is None:
        return load_ranges("real").draw(rng, 1)
    rows = {row.key: row for row in load_ranges("real").rows if row.per is Per.ROBOT}
    chosen = rng.choice(sorted({_effect(key) for key in rows} & {_effect(key) for key in SCALES}), effects, replace=False)
    return healthy_physics(seed).changed({key: row.draw(rng, 1) for key, row in rows.items() if _effect(key) in chosen})


def hidden_effects(seed: int, effects: int) -> set[str]:
    """The effects of :func:`robot`."""
    drawn, healthy = robot(seed, effects), healthy_physics(seed)
    return {_effect(key) for key in PARAMETERS if not np.array_equal(drawn.value(key), healthy.value(key))}


def _effect(key: str) -> str:
    return key.partition(".")[0]


class _Asker:
    """What a worker does: the line of a seed."""

    def __call__(self, seed: int, seen: tuple[int | None, str]) -> dict:
        return asked(seed, *seen)


def asked(seed: int, effects: int | None = None, excitation: str = STANDARD) -> dict:
    """The verdict on one robot, and each of its values beside the truth."""
    begun = time.monotonic()
    physics = robot(seed, effects)
    (recordings,) = simulated_recordings(physics, [seed], excitation)
    study = study_joints(compile_scene(), recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))
    verdict = judge(study).verdict
    values = [_value(study, physics, cause) for cause in verdict.causes]
    return {
        "seed": seed,
        "effects": effects,
        "excitation": excitation,
        "causes": len(study.fit.accepted),
        "of_many": study.is_of_many,
        "verdict": verdict.verdict,
        "summary": verdict.summary,
        "cannot_tell": list(verdict.cannot_tell),
        "in_a_set": [TILT[0][0]] if turned_bases(study, verdict.causes) else [],
        "values": values,
        "seconds": time.monotonic() - begun,
    }


def _value(study: JointStudy, physics: Physics, cause: Cause) -> dict:
    key = f"{cause.effect}.{cause.parameter}"
    place = index_of(study.problem.names, key, cause.where)
    below, usual = cause.value - cause.interval_90[0], usual_errors_of(study, cause).below if study.is_of_many else 0.0
    return {
        "key": key,
        "where": cause.where,
        "value": cause.value,
        "truth": float(np.ravel(np.atleast_2d(physics.value(key))[0])[place]),
        "nominal": study.problem_start(key, place),
        "interval_90": list(cause.interval_90),
        "clear": is_clear(study, cause),
        "own": float(np.sqrt(max(0.0, below**2 - usual**2))),
    }


def summary(lines: Sequence[dict]) -> dict:
    """Verdicts, effects, and how many intervals hold the truth: of all values, of the clear ones, by parameter.

    An effect counts as named if a value of it is clear and the verdict is ``named``. ``effects`` is of robots with some effects;
    of those beyond their detection limits ``above_limits`` has the share that is named, by its joints and once for each robot.
    """
    rows = [row for line in lines for row in line["values"]]
    clear = [row for row in rows if row["clear"] and row["key"] in SCALES]  # what only says how a number looks has no side
    by_key = {key: [row for row in rows if row["key"] == key] for key in sorted({row["key"] for row in rows})}
    return {
        "robots": len(lines),
        "seeds": [lines[0]["seed"], lines[-1]["seed"]] if lines else [],
        "verdicts": {kind: sum(line["verdict"] == kind for line in lines) for kind in sorted({x["verdict"] for x in lines})},
        "effects": _effects(lines) if lines and lines[0]["effects"] is not None else None,
        "above_limits": _above_limits(lines),
        "interval_coverage": _covered(rows),
        "clear": len(clear),
        "clear_interval_coverage": _covered(clear),
        "clear_with_the_right_sign": share(sum(_has_right_sign(row) for row in clear), len(clear)),
        "median_error": {key: float(np.median([abs(row["value"] - row["truth"]) for row in of])) for key, of in by_key.items()},
        "by_parameter": {key: _covered(of) for key, of in by_key.items()},
        "median_seconds": float(np.median([line["seconds"] for line in lines])) if lines else None,
    }


def _effects(lines: Sequence[dict]) -> dict[str, int]:
    """Of robots with some effects: how many were named, missed, and named without being there."""
    right = wrong = missed = 0
    for line in lines:
        there = hidden_effects(line["seed"], line["effects"])
        is_named = line["verdict"] == VerdictKind.NAMED
        said = {_effect(row["key"]) for row in line["values"] if is_named and row["clear"]}
        right, wrong, missed = right + len(said & there), wrong + len(said - there), missed + len(there - said)
    return {"right": right, "wrong": wrong, "missed": missed}


def _above_limits(lines: Sequence[dict]) -> dict:
    """Of the fitted numbers that are beyond their detection limit, those that a clear value of the right side names.

    ``effects_or_set`` adds effects that are told to be the same for joints as one that is named.
    """
    limits = {key: limit for key, limit in detection_limits().items() if key in NUMBERS}
    there: dict[str, list[list[bool]]] = {}
    told: list[bool] = []
    for line in lines:
        physics, is_named = robot(line["seed"], line["effects"]), line["verdict"] == VerdictKind.NAMED
        given = {(row["key"], index_of(JOINT_NAMES, row["key"], row["where"])): row for row in line["values"] if is_named}
        named = {place for place, row in given.items() if row["clear"] and _has_right_sign(row)}
        in_a_set = line.get("in_a_set", ()) if is_named else ()
        for key, limit in limits.items():
            off = np.abs(np.ravel(np.atleast_2d(physics.value(key))[0]) - PARAMETERS[key].absent)
            if (off >= limit).any():
                marks = [(key, int(i)) in named for i in np.flatnonzero(off >= limit)]
                there.setdefault(key, []).append(marks)
                told.append(any(marks) or _effect(key) in in_a_set)
    places = [mark for robots in there.values() for marks in robots for mark in marks]
    robots = [any(marks) for robots in there.values() for marks in robots]
    return {
        "places": share(sum(places), len(places)),
        "effects": share(sum(robots), len(robots)),
        "effects_or_set": share(sum(told), len(told)),
        "by_parameter": {key: share(sum(map(sum, rows)), sum(map(len, rows))) for key, rows in there.items()},
        "robots_by_parameter": {key: share(sum(map(any, rows)), len(rows)) for key, rows in there.items()},
    }


def _covered(rows: Sequence[dict]) -> dict:
    return share(sum(_holds(row, row["truth"]) for row in rows), len(rows))


def _holds(row: dict, value: float) -> bool:
    (low, high), off = row["interval_90"], deviation(row["key"], row["value"], value)
    return low <= row["value"] - off <= high


def _has_right_sign(row: dict) -> bool:
    return (row["value"] - row["nominal"]) * (row["truth"] - row["nominal"]) > 0.0


if __name__ == "__main__":
    raise SystemExit(main())
