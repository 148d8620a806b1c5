"""Rate of the full path against bare physics: ``python tests/benchmarks/full_path.py --physics real``; a part of ``make bench``.

In one run, on the same recorded trials: (a) the full path, a robot with its jailed policy, safety, tracker and 1 kHz log, and
(b) bare ``mj_step`` of the same model driven by the recorded torques, both pinned to one core and taken in turns: with nominal
robots, or with all effects of ``real``, their truth written, too.
"""

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from api_schemas.job import TaskName
from api_schemas.policy import PolicyManifest
from api_schemas.robot import Lease
from robot_farm.life import Life
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import TrialPhysics, prepare_plainly
from robot_farm.settings import Reset
from robot_farm.trial import log_channels, measured_channels, run_trial
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.driver.robot_model import robot_spec
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Ranges, load_ranges
from sim_backend.tasks import TASKS
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import discard_what_shows
from trial_logs.reader import TrialLog, read_log, read_truth

ROOT = Path(__file__).parent.parent.parent
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
TRIAL_S = 15.0
FIRST_SEED = 500


def convert(folder: Path) -> tuple[Path, PolicyManifest]:
    """The reference policy as the graph that robots run."""
    manifest, graph = REFERENCE.with_suffix(".json"), folder / "push.onnx"
    command = [sys.executable, "-m", "services.policies.conversion", str(REFERENCE), str(manifest), str(graph), "none"]
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    return graph, PolicyManifest.model_validate_json(manifest.read_text())


def bare_s(physics: Physics, log: TrialLog, cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> float:
    """Wall time of ``mj_step`` over a recorded trial: the faster of a native loop and a Python loop."""
    model = discard_what_shows(robot_spec(physics, physics_step_s=c.PHYSICS_STEP_S)).compile()
    data = mujoco.MjData(model)
    data.qpos[:9], data.qpos[9:12] = log.joint_position_rad[0], cube_position_world_m
    data.qpos[12:16] = cube_quat_wxyz
    mujoco.mj_forward(model, data)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with Rollout(nthread=0) as rollout:
        scratch = mujoco.MjData(model)
        started_s = time.perf_counter()
        rollout.rollout(model, scratch, state, log.applied_torque_nm[None])
        native_s = time.perf_counter() - started_s
    started_s = time.perf_counter()
    for torque in log.applied_torque_nm:
        data.ctrl[:] = torque
        mujoco.mj_step(model, data)
    return min(native_s, time.perf_counter() - started_s)


class NominalRobot:
    """A robot that is like all others: its log holds everything."""

    def __init__(self) -> None:
        self._driver, self._channels = SimulatedDriver(), log_channels()

    def run(self, lease: Lease, policy: JailedPolicy, path: Path) -> tuple[float, float]:
        """A trial; returns its wall time and that of bare physics, each for one simulated second."""
        ready = prepare_plainly(lease, TASKS)
        started_s = time.perf_counter()
        run_trial(lease, policy, self._driver, self._channels, path, stop_reason=lambda: None, prepared=ready)
        full_s, log = time.perf_counter() - started_s, read_log(path)
        bare = bare_s(Physics.nominal(), log, log.cube_position_world_m[0], log.cube_quat_wxyz[0])
        return full_s / TRIAL_S, bare / TRIAL_S


class RealRobot:
    """Another robot with all effects of a table for each trial; the truth is written and the robot looks at itself at the end."""

    def __init__(self, physics: str) -> None:
        self._ranges: Ranges = load_ranges(physics)
        self._life = Life("robot-0", self._draw, Reset.PLACEMENT, self_test_every=10**6)
        self._channels, self._truth_channels = measured_channels(), truth_channels()

    def _draw(self, seed: int | str, _attempt: int) -> TrialPhysics:
        rng = np.random.default_rng([FIRST_SEED, *str(seed).encode()])
        return TrialPhysics(self._ranges.draw_episode(rng, self._ranges.draw(rng, 1)), int(rng.integers(2**53)), rng)

    def run(self, lease: Lease, policy: JailedPolicy, path: Path) -> tuple[float, float]:
        """As of the nominal robot; what it moves after the trial counts as simulated, too."""
        truth = TruthFile(path.with_suffix(".truth.mcap"), self._truth_channels)
        ready = self._life.prepare(lease, truth, lambda: None)
        assert self._life._arena is not None
        motion = self._life._arena.motion
        before_s, started_s = motion.simulated_s, time.perf_counter()
        run_trial(lease, policy, self._life.driver, self._channels, path, stop_reason=lambda: None, prepared=ready)
        full_s, after_s = time.perf_counter() - started_s, motion.simulated_s - before_s
        read = read_truth(truth.path)
        bare = bare_s(ready.physics, read_log(path), read.cube_position_world_m[0], read.cube_quat_wxyz[0])
        truth.path.unlink()
        return full_s / (TRIAL_S + after_s), bare / TRIAL_S


def one_core_rates(trials: int, physics: str) -> dict:
    """Simulated seconds per wall second on one core, full path and bare, trial by trial in turns."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    robot = NominalRobot() if physics == "nominal" else RealRobot(physics)
    full, bare = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        graph, manifest = convert(folder)
        with JailedPolicy("reference", graph) as policy:
            policy.reset()
            for index in range(trials + 1):
                path = folder / f"{index}.mcap"
                full_s, bare_time_s = robot.run(_lease(manifest, FIRST_SEED + index), policy, path)
                if index:  # the first warms caches up
                    full.append(1 / full_s)
                    bare.append(1 / bare_time_s)
                else:
                    gc.collect()
                    gc.freeze()  # as the parent of robots does
                path.unlink()
    ratios = [f / b for f, b in zip(full, bare, strict=True)]
    return {
        "physics": physics,
        "trials": trials,
        "full_path_rate": median(full),
        "bare_rate": median(bare),
        "ratio": median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
    }


def _lease(manifest: PolicyManifest, seed: int) -> Lease:
    return Lease(
        trial_id=f"jbench-{seed}",
        job_id="jbench",
        ordinal=0,
        fence=1,
        robot="robot-0",
        policy="0" * 64,
        manifest=manifest,
        graph_sha256="0" * 64,
        task=TaskName.PUSH,
        seed=seed,
    )


def main() -> None:
    """Print the rates as JSON; the process is pinned to a core."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--physics", default="nominal")
    options = parser.parse_args()
    print(json.dumps(one_core_rates(options.trials, options.physics)))


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
