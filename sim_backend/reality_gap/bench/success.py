"""How well extended models predict a policy's success on robots that differ everywhere.

    python -m sim_backend.reality_gap.bench.success --policy FILE --first-seed S --robots N --goals G --out DIR

Robots are drawn from ``real``. Each is seen by what ``trifarm identify`` records and studied, first its joints, then, with what
was found of them, its cube; then the policy tries the same goals on it, on its extended model and on the nominal robot, with
noise of their own. ``joints.jsonl`` and ``studies.jsonl`` have a line for each robot and ``tries.jsonl`` one for each
``TOGETHER`` goals of a model, so that a test goes on where it stopped.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.evaluation import evaluate
from sim_backend.reality_gap.bench.counting import whole_lines
from sim_backend.reality_gap.bench.cube_sessions import sessions_with_pushes
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, simulated_recordings
from sim_backend.reality_gap.bench.many_causes import robot
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.model.files import writable
from sim_backend.reality_gap.model.model import physics_of
from sim_backend.reality_gap.study import knowing
from sim_backend.reality_gap.subjects.cube import subject as cube
from sim_backend.reality_gap.subjects.joints import subject as joints
from sim_backend.reality_gap.subjects.subject import Material
from sim_backend.reality_gap.success.gain import NOISE_SEED, success_gain
from sim_backend.reality_gap.success.policy_file import load_policy
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind, joined
from sim_backend.refusal import refused
from sim_backend.tasks import TASKS
from sim_backend.workers.pool import WorkersError, open_workers

NOMINAL, EXTENDED, MEASURED = MODELS = ("nominal", "extended", "measured")
FIRST_GOAL = 7_300_000
"""Seed of the first goal; all robots and models are asked for the same."""
MEASURED_NOISE_SEED = 2 * NOISE_SEED
"""Added to a trial's seed to seed the noise of the robot itself: not that of predictions."""
TOGETHER = 100
"""Goals that are tried at once."""
CLOSE = 0.05
"""A rate that is off by no more than this counts as predicted."""
RNG_SEED = 1
Asked = tuple[str, int | None, range]
"""A model, the robot that it is of, and which goals."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Predict a policy's success on robots that differ everywhere.")
    parser.add_argument("--policy", type=Path, required=True, help="a safetensors or ONNX file")
    parser.add_argument("--manifest", default="rrc2022-lift", help="layout or JSON file of what it expects (%(default)s)")
    parser.add_argument("--task", default="lift", choices=TASKS, help="that it is tried with (%(default)s)")
    parser.add_argument("--first-seed", type=int, required=True, help="of the robots")
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--goals", type=int, default=400, help="for each robot and model (%(default)s)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument(
        "--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s); 0: none but this"
    )
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    options = parser.parse_args(arguments)
    if options.robots < 1 or options.goals < 1 or options.processes < 0:
        parser.error("--robots and --goals must be at least 1, and --processes 0")
    try:
        load_policy(options.policy, options.manifest)  # before any long work
    except ValueError as error:
        return refused(error, as_json=False)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        found = _run(options)
    except (OSError, WorkersError) as error:
        return refused(error, as_json=False)
    (options.out / "success.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps({key: value for key, value in found.items() if key != "by_robot"}, indent=1))
    return 0


def _run(options: argparse.Namespace) -> dict[str, Any]:
    at, seeds = (options.processes, options.cluster), range(options.first_seed, options.first_seed + options.robots)

    def studied(what: str, work: Callable[[], Any], items: Mapping[int, Any]) -> dict[int, dict]:
        """A line for each robot, by its seed; what a file has already is not done again."""
        path = options.out / f"{what}.jsonl"
        there = {line["seed"] for line in whole_lines(path)}
        todo = [item for seed, item in items.items() if seed not in there]
        if todo:
            with open_workers(work, *at) as workers:
                _keep(path, workers.map(todo), (len(items) - len(todo), len(items)), f"{what} are done")
        return {line["seed"]: line for line in whole_lines(path) if line["seed"] in items}

    done = {line["seed"]: line for line in whole_lines(options.out / "studies.jsonl")}
    of_joints = studied("joints", _Joints, {seed: seed for seed in seeds if seed not in done})
    studies = studied("studies", _Study, {seed: of_joints.get(seed) for seed in seeds})
    parts = [range(first, min(first + TOGETHER, options.goals)) for first in range(0, options.goals, TOGETHER)]
    tries: list[Asked] = [(NOMINAL, None, part) for part in parts]
    tries += [(model, seed, part) for seed in seeds for model in (MEASURED, EXTENDED) for part in parts]
    path = options.out / "tries.jsonl"
    there = {_asked_of(line) for line in whole_lines(path)}
    causes = {None: []} | {seed: study["causes"] for seed, study in studies.items()}
    asked = [(each, causes[each[1]]) for each in tries if each not in there]
    with open_workers(partial(_Try, options.policy.absolute(), options.manifest, options.task), *at) as workers:
        _keep(path, workers.map(asked), (len(tries) - len(asked), len(tries)), f"times {TOGETHER} goals are tried")
    return summary([studies[seed] for seed in seeds], [line for line in whole_lines(path) if _asked_of(line) in set(tries)])


def _asked_of(line: dict) -> Asked:
    return line["model"], line["seed"], range(line["first"], line["first"] + len(line["success"]))


def _keep(path: Path, found: Iterable[dict], counts: tuple[int, int], what: str) -> None:
    """Write each line as it comes, behind those that are there; ``counts``: how many of those asked for were there, and all."""
    kept, (there, of) = whole_lines(path), counts
    path.write_text("".join(json.dumps(line) + "\n" for line in kept))
    with path.open("a") as file:
        for done, line in enumerate(found, start=there + 1):
            file.write(json.dumps(line) + "\n")
            file.flush()
            print(f"{done} of {of} {what}", file=sys.stderr, flush=True)


class _Joints:
    """What a worker does: the study of a robot's joints by its seed."""

    def __call__(self, seed: int, _: None = None) -> dict:
        """Their verdict as plain values."""
        begun = time.monotonic()
        (recordings,) = simulated_recordings(robot(seed), [seed], EVERYTHING)
        known, material = KnownTriFinger.seen_in(recordings), Material(f"robot {seed}", tuple(recordings), ())
        verdict, _sections = joints.study(material, known, np.random.default_rng(seed), lambda *_: None)
        return {"seed": seed, **line_of(verdict), "seconds": time.monotonic() - begun}


class _Study:
    """What a worker does: the study of a robot's cube, told what was found of its joints."""

    def __call__(self, of_joints: dict, _: None = None) -> dict:
        """Both verdicts as one, with what the extended model has; a cause as a dictionary."""
        begun, seed = time.monotonic(), of_joints["seed"]
        found = verdict_in(of_joints)
        (pushes,) = sessions_with_pushes(robot(seed), [seed])
        known, material = KnownTriFinger.seen_in(pushes), Material(f"robot {seed}", tuple(pushes), ())
        of_cube, _sections = cube.study(material, knowing(known, found), np.random.default_rng([seed, 1]), lambda *_: None)
        verdict = joined((found, of_cube))
        return {
            "seed": seed,
            "verdict": verdict.verdict,
            "summary": verdict.summary,
            "causes": [asdict(cause) for cause in writable(verdict.extended or verdict.causes)],
            "cannot_tell": list(verdict.cannot_tell),
            "seconds": of_joints["seconds"] + time.monotonic() - begun,
        }


def line_of(verdict: Verdict) -> dict:
    """What a line of ``joints.jsonl`` has of a verdict: all that the study of the cube and the extended model ask for."""
    document = verdict.document()
    return {key: document[key] for key in ("verdict", "summary", "causes", "extended", "cannot_tell")}


def verdict_in(line: dict) -> Verdict:
    """The verdict that a line has."""
    causes, extended = (tuple(_cause(row) for row in line[key]) for key in ("causes", "extended"))
    return Verdict(VerdictKind(line["verdict"]), line["summary"], causes, extended, cannot_tell=tuple(line["cannot_tell"]))


class _Try:
    """What a worker does: some goals of a policy on the nominal robot, on a robot or on its extended model."""

    def __init__(self, policy: Path, manifest: str, task: str) -> None:
        (self._act, self._manifest), self._task = load_policy(policy, manifest), TASKS[task]

    def __call__(self, item: tuple[Asked, list[dict]], _: None = None) -> dict:
        """Success of each goal; a model's causes go with it."""
        (model, seed, goals), causes = item
        physics = robot(seed) if model == MEASURED and seed is not None else physics_of(map(_cause, causes))
        seeds = [FIRST_GOAL + goal for goal in goals]
        noise = np.array(seeds, dtype=float) + (MEASURED_NOISE_SEED if model == MEASURED else NOISE_SEED)
        robots = Physics.stack([physics] * len(seeds))
        tried = evaluate(self._act, self._manifest, self._task, seeds, physics=robots, noise_seeds=noise, threads=1)
        return {"model": model, "seed": seed, "first": goals[0], "success": tried.success.tolist()}


def _cause(row: dict) -> Cause:
    return Cause(**row | {"interval_90": tuple(row["interval_90"])})


def summary(studies: Sequence[dict], tries: Sequence[dict]) -> dict[str, Any]:
    """How far the two predictions are off, by robot and in the median, and how many are close."""
    nominal = _of(tries, NOMINAL, None)
    rows = []
    for study in studies:
        measured, extended = (_of(tries, model, study["seed"]) for model in (MEASURED, EXTENDED))
        gain = success_gain(nominal, extended, measured, np.random.default_rng(RNG_SEED), physics=None)
        rates = {row.label: row.rate for row in gain.rows}
        rows.append({"seed": study["seed"], "verdict": study["verdict"], **rates, **_gaps(gain.document())})
    before, after = (np.abs([row[key] for row in rows]) for key in ("gap_before", "gap_after"))
    return {
        "robots": len(rows),
        "goals": len(nominal),
        "close": int((after <= CLOSE).sum()),
        "close_before": int((before <= CLOSE).sum()),
        "median_gap_before": float(np.median(before)),
        "median_gap_after": float(np.median(after)),
        "by_robot": rows,
    }


def _gaps(document: dict[str, Any]) -> dict[str, Any]:
    kept = ("gap_before", "gap_after", "gap_before_interval_95", "gap_after_interval_95", "agreement_before", "agreement_after")
    return {key: document[key] for key in kept}


def _of(tries: Sequence[dict], model: str, seed: int | None) -> list[bool]:
    """All outcomes of a model, in the order of the goals."""
    own: Iterator[dict] = (line for line in tries if (line["model"], line["seed"]) == (model, seed))
    return [success for line in sorted(own, key=lambda line: line["first"]) for success in line["success"]]


if __name__ == "__main__":
    raise SystemExit(main())
