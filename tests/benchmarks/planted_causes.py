"""Are causes of failed trials named right? Planted failures, and failures that no effect explains.

    python -m tests.benchmarks.planted_causes --out FILE.jsonl [--planted 100] [--hopeless 40] [--for-s 240] [--first-seed 81000]
    python -m tests.benchmarks.planted_causes --out FILE.jsonl --summary

A planted failure: a robot drawn from `real` on which the policy reaches its goal; then one effect is made strong, by chance
which and how strong. It counts if the trial now fails, and succeeds without the effect, under its own noise and under two more
seeds of the noise, which the explanation does not use. A hopeless one fails on its robot and on the ideal robot. Each case is run
as on a farm, jailed policy, log and truth file, and explained from these by what ``trifarm why`` runs. Each line of FILE is a
case; cases that are there are not redone.
"""

import argparse
import itertools
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy import PolicyManifest
from api_schemas.robot import Lease
from robot_farm.explaining import OtherNumbersError, PolicyInLoop, why
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import Prepared
from robot_farm.trial import measured_channels, run_trial
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.causes import cause_of
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.replays.counterfactual import Again, ends
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial
from sim_backend.trifinger.objects import CUBE
from tests.benchmarks.graphs import graph_of
from trial_logs.reader import read_log, read_truth

TASK = "push"
PLANTED_WITH, HOPELESS_WITH = "push-adr", "push-scratch"
STRONG: dict[str, tuple[float, float]] = {
    "coulomb_friction.torque_nm": (0.1, 0.25),
    "viscous_friction.damping_nm_s_rad": (0.02, 0.1),
    "load_friction.coefficient": (0.3, 0.6),
    "action_delay.delay_s": (0.02, 0.08),
    "torque_saturation.limit_nm": (0.05, 0.2),
    "torque_constant.error": (-0.5, -0.3),
    "backlash.gap_rad": (0.03, 0.1),
    "joint_stiffness.stiffness_nm_rad": (0.1, 0.3),
    "table_tilt.pitch_rad": (0.05, 0.15),
    "fingertip_friction.coefficient": (0.1, 0.3),
    "table_friction.coefficient": (1.3, 2.0),
    "cube_mass.factor": (2.0, 3.0),
    "encoder_offset.offset_rad": (0.08, 0.2),
    "joint_noise.velocity_rad_s": (0.4, 1.0),
    "velocity_filter.time_constant_s": (0.03, 0.1),
    "tracking_latency.extra_s": (0.15, 0.3),
    "tracking_dropout.probability": (0.3, 0.9),
    "tracking_offset.position_m": (0.012, 0.04),
    "tracking_noise.position_m": (0.02, 0.05),
    "tracking_scale.factor_error": (0.05, 0.1),
}
"""What may be made strong, and between which values; within the catalogue's bounds."""
PLANTS_PER_ROBOT = 4
OTHER_SEEDS = 2
MOST_DRAWS = 60
DRAWN_TOGETHER, TRIED_TOGETHER, IDEAL_TOGETHER = 3, 3, 16


def begun(physics: Physics, seed: int, noise_seed: int, manifest: PolicyManifest) -> Again:
    """A trial as a robot with a placed object begins it."""
    start, goal = draw_trial(TASKS[TASK], seed)
    position_m = start.cube_position_world_m.copy()
    position_m[:, 2] *= physics.value("cube_size.factor")
    start = replace(start, cube_position_world_m=position_m, noise_seed=np.array([noise_seed]))
    return Again(TASKS[TASK], goal, manifest, CUBE, start, physics, ())


def drawn(rng: np.random.Generator, manifest: PolicyManifest) -> tuple[Again, int]:
    """A trial of a `real` robot, and the seed of its start and goal."""
    ranges = load_ranges("real")
    physics = ranges.draw_episode(rng, ranges.draw(rng, 1))
    seed, noise_seed = int(rng.integers(2**31)), int(rng.integers(2**53))
    return begun(physics, seed, noise_seed, manifest), seed


def planted(rng: np.random.Generator, policy: PolicyInLoop, manifest: PolicyManifest) -> tuple[Again, int, str]:
    """A failure by one strong effect, the seed of its start and goal, and the effect's parameter: the first that counts."""
    for _ in range(MOST_DRAWS // DRAWN_TOGETHER):
        robots = [drawn(rng, manifest) for _ in range(DRAWN_TOGETHER)]
        succeed = [each for each, end in zip(robots, ends([trial for trial, _ in robots], policy), strict=True) if end.success]
        made = [plant for trial, seed in succeed for plant in _plants(rng, trial, seed)]
        failed = [plant for plant, end in zip(made, ends([plant[0] for plant in made], policy), strict=True) if not end.success]
        for first in range(0, len(failed), TRIED_TOGETHER):
            for plant in _causes(rng, failed[first : first + TRIED_TOGETHER], policy):
                return plant
    raise RuntimeError(f"no planted failure among {MOST_DRAWS} robots")


def _plants(rng: np.random.Generator, trial: Again, seed: int) -> Iterator[tuple[Again, int, str]]:
    for key in rng.choice(sorted(STRONG), PLANTS_PER_ROBOT, replace=False).tolist():
        value = rng.uniform(*STRONG[key]) * (rng.choice([-1.0, 1.0]) if key.endswith(("offset_rad", "pitch_rad")) else 1.0)
        yield replace(trial, physics=trial.physics.changed({key: value})), seed, key


def _causes(
    rng: np.random.Generator, plants: list[tuple[Again, int, str]], policy: PolicyInLoop
) -> Iterator[tuple[Again, int, str]]:
    """Those without whose effect the trial succeeds, and fails with it, whatever the noise."""
    others = rng.integers(2**53, size=OTHER_SEEDS).tolist()
    rows, wanted = [], []
    for trial, _, key in plants:
        away = (key.partition(".")[0],)
        rows += [trial.without(away), *(trial.without(each, seed) for seed in others for each in ((), away))]
        wanted.append([True, *([False, True] * OTHER_SEEDS)])
    found = iter(end.success for end in ends(rows, policy))
    for plant, each in zip(plants, wanted, strict=True):
        if list(itertools.islice(found, len(each))) == each:
            yield plant


def hopeless(rng: np.random.Generator, policy: PolicyInLoop, manifest: PolicyManifest) -> tuple[Again, int, str]:
    """A failure of a `real` robot that is one of the ideal robot, too."""
    while True:
        robots = [drawn(rng, manifest) for _ in range(IDEAL_TOGETHER)]
        ideal = ends([trial.without(_everything(trial)) for trial, _ in robots], policy)
        left = [robot for robot, end in zip(robots, ideal, strict=True) if not end.success]
        for (trial, seed), end in zip(left, ends([trial for trial, _ in left], policy), strict=True):
            if not end.success:
                return trial, seed, ""


def _everything(trial: Again) -> tuple[str, ...]:
    return tuple(name for cause in trial.causes for name in cause.effects)


def recorded(trial: Again, seed: int, policy: JailedPolicy, folder: Path) -> tuple[Path, Path]:
    """Log and truth of the trial, run as on a farm."""
    fields = {"trial_id": "jplanted-000", "job_id": "jplanted", "ordinal": 0, "fence": 1, "robot": "robot-0", "task": TASK}
    lease = Lease(policy="0" * 64, graph_sha256="0" * 64, manifest=trial.manifest, seed=seed, **fields)
    log, truth = folder / "log.mcap", folder / "truth.mcap"
    ready = Prepared(
        start=trial.start,
        goal=trial.goal,
        tracker=Tracker(physics=trial.physics),
        task=trial.task,
        physics=trial.physics,
        truth=TruthFile(truth, truth_channels()),
    )
    driver = SimulatedDriver(physics=trial.physics)
    run_trial(lease, policy, driver, measured_channels(), log, stop_reason=lambda: None, physics="real", prepared=ready)
    return log, truth


def one_case(kind: str, index: int, first_seed: int, graphs: dict[str, tuple[Path, PolicyManifest]]) -> dict:
    """Make, run and explain one case."""
    rng = np.random.default_rng([first_seed, index, kind == "planted"])
    name = PLANTED_WITH if kind == "planted" else HOPELESS_WITH
    graph, manifest = graphs[name]
    began_s, began_wall_s = time.process_time(), time.monotonic()
    with JailedPolicy(name, graph) as policy, tempfile.TemporaryDirectory() as folder:
        made = planted if kind == "planted" else hopeless
        trial, seed, key = made(rng, PolicyInLoop(policy), manifest)
        files = recorded(trial, seed, policy, Path(folder))
        case: dict[str, Any] = {"kind": kind, "index": index, "policy": name, "key": key, "seed": seed}
        case["making_cpu_s"], began_s = round(time.process_time() - began_s, 1), time.process_time()
        try:
            found = why(read_log(files[0]), read_truth(files[1]), PolicyInLoop(policy))
        except OtherNumbersError as error:
            return case | {"exact": False, "error": str(error)}
        cpu_s = {"cpu_s": round(time.process_time() - began_s, 1), "wall_s": round(time.monotonic() - began_wall_s, 1)}
        case |= {"exact": True} | cpu_s | {"answer": found.model_dump(mode="json")}
        if key:
            case |= {"effect": key.partition(".")[0], "group": cause_of(key.partition(".")[0]).name}
        return case


def summary(path: Path) -> dict:
    """Counts over all cases that were kept."""
    cases = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    found: dict[str, object] = {"cases": len(cases), "first replay bit-exact": sum(case["exact"] for case in cases)}
    of = {kind: [case for case in cases if case["kind"] == kind and case["exact"]] for kind in ("planted", "hopeless")}
    first = [(case, case["answer"]["groups"][:1], (case["answer"]["effects"] or [])[:1]) for case in of["planted"]]
    found["planted"] = len(first)
    for name, place in (("group", 1), ("effect", 2)):
        found[f"planted {name} first and blamed"] = sum(
            bool(each[place]) and each[place][0]["explains"] and each[place][0]["name"] == each[0][name] for each in first
        )
    found["planted and nothing blamed"] = sum(case["answer"]["verdict"] != "cause" for case, *_ in first)
    found["hopeless"] = len(of["hopeless"])
    found["hopeless and blamed"] = sum(case["answer"]["verdict"] == "cause" for case in of["hopeless"])
    replays = [case["answer"]["replays"] for kind in of.values() for case in kind]
    found["replays a case, mean"] = round(float(np.mean(replays)), 1) if replays else None
    return found


def main() -> int:
    """Run what is missing, as long as it may, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--planted", type=int, default=100)
    parser.add_argument("--hopeless", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=81_000)
    parser.add_argument("--for-s", type=float, default=float("inf"), help="begin no other case after so long")
    parser.add_argument("--share", default="0/1", help="K/N: only each N-th of the cases, for N processes that write to one file")
    parser.add_argument("--summary", action="store_true")
    asked = parser.parse_args()
    until_s = time.monotonic() + asked.for_s
    if not asked.summary:
        lines = asked.out.read_text().splitlines() if asked.out.exists() else []
        done = {(case["kind"], case["index"]) for case in map(json.loads, lines)}
        wanted = [("planted", index) for index in range(asked.planted)] + [("hopeless", index) for index in range(asked.hopeless)]
        wanted.sort(key=lambda case: case[1] / (asked.planted if case[0] == "planted" else asked.hopeless))
        mine, shares = map(int, asked.share.split("/"))
        with tempfile.TemporaryDirectory() as folder:
            graphs = {name: graph_of(name, Path(folder)) for name in (PLANTED_WITH, HOPELESS_WITH)}
            for kind, index in wanted[mine::shares]:
                if time.monotonic() < until_s and (kind, index) not in done:
                    case = one_case(kind, index, asked.first_seed, graphs)
                    with asked.out.open("a") as file:
                        file.write(json.dumps(case) + "\n")
                    print(
                        kind,
                        index,
                        case["key"],
                        {name: case.get(name) for name in ("making_cpu_s", "cpu_s", "wall_s")},
                        flush=True,
                    )
    print(json.dumps(summary(asked.out), indent=2))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
