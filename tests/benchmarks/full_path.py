"""Rate of the full path against bare physics, and of a whole farm: ``make bench``.

In one run, on the same recorded trials: (a) the full path, a robot with its jailed policy, safety, tracker and 1 kHz log, and
(b) bare ``mj_step`` driven by the recorded torques, both pinned to one core and taken in turns; then (c) the time from
submission to report of a 40-trial push job on a farm of 4 robots. Figures are ratios within the run.
"""

import argparse
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

from api_schemas.policy import PolicyManifest
from api_schemas.robot import Lease
from api_schemas.trial_log_reader import TrialLog, read_log
from robot_farm.jail import JailedPolicy
from robot_farm.trial import log_channels, run_trial
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.trifinger.scene import compile_scene

ROOT = Path(__file__).parent.parent.parent
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
FLOOR_RATIO = 0.5
FARM_FACTOR = 1.3
FIRST_SEED = 500


def convert(folder: Path) -> tuple[Path, PolicyManifest]:
    """The reference policy as the graph that robots run."""
    manifest, graph = REFERENCE.with_suffix(".json"), folder / "push.onnx"
    command = [sys.executable, "-m", "services.policies.conversion", str(REFERENCE), str(manifest), str(graph)]
    subprocess.run(command, check=True, capture_output=True)
    return graph, PolicyManifest.model_validate_json(manifest.read_text())


def bare_s(model: mujoco.MjModel, log: TrialLog) -> float:
    """Wall time of ``mj_step`` over a recorded trial: the faster of a native loop and a Python loop."""
    data = mujoco.MjData(model)
    data.qpos[:9], data.qpos[9:12] = log.joint_position_rad[0], log.cube_position_world_m[0]
    data.qpos[12:16] = log.cube_quat_wxyz[0]
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


def one_core_rates(trials: int) -> dict:
    """Simulated seconds per wall second on one core, full path and bare, trial by trial in turns."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    bare_model, driver, channels = compile_scene(), SimulatedDriver(), log_channels()
    full, bare = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        graph, manifest = convert(folder)
        with JailedPolicy("reference", graph) as policy:
            policy.reset()
            for index in range(trials + 1):
                path = folder / f"{index}.mcap"
                lease = _lease(manifest, FIRST_SEED + index)
                started_s = time.perf_counter()
                run_trial(lease, policy, driver, channels, path, stop_reason=lambda: None)
                full_s = time.perf_counter() - started_s
                bare_time_s = bare_s(bare_model, read_log(path))
                if index:  # the first warms caches up
                    full.append(15.0 / full_s)
                    bare.append(15.0 / bare_time_s)
                path.unlink()
    ratios = [f / b for f, b in zip(full, bare, strict=True)]
    return {
        "trials": trials,
        "full_path_rate": median(full),
        "bare_rate": median(bare),
        "ratio": median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
        "floor": FLOOR_RATIO,
    }


def _lease(manifest: PolicyManifest, seed: int) -> Lease:
    return Lease(
        trial_id="jbench-000",
        job_id="jbench",
        ordinal=0,
        fence=1,
        robot="robot-0",
        policy="0" * 64,
        manifest=manifest,
        graph_sha256="0" * 64,
        task="push",
        seed=seed,
    )


def farm_s(robots: int, trials: int, jobs: int) -> list[float]:
    """Submit-to-report times of push jobs on a farm of its own, policy processes and all."""
    from tests.end_to_end.farm import Farm

    times = []
    with tempfile.TemporaryDirectory() as name, Farm(Path(name), robots=robots) as farm:
        for index in range(jobs):
            started_s = time.perf_counter()
            job = farm.submit(REFERENCE, trials=trials, seed=100 + index, wait=True)
            times.append(time.perf_counter() - started_s)
            report = farm.report(job)
            assert report["trials"] == trials, report
    return times


def main() -> int:
    """Measure, print, and keep the figures as a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=8, help="trials for the one-core rates")
    parser.add_argument("--jobs", type=int, default=3, help="40-trial jobs on the farm")
    parser.add_argument("--out", type=Path, help="also write the figures as JSON")
    parser.add_argument("--rates", action="store_true", help="only measure and print the one-core rates, as JSON")
    options = parser.parse_args()
    if options.rates:
        print(json.dumps(one_core_rates(options.trials)))
        return 0
    command = [sys.executable, __file__, "--rates", "--trials", str(options.trials)]
    before = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    times = farm_s(robots=4, trials=40, jobs=options.jobs)
    after = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    rate = median([before["full_path_rate"], after["full_path_rate"]])
    allowed_s = FARM_FACTOR * 40 * 15.0 / (2 * rate)
    ratio = median([before["ratio"], after["ratio"]])
    figures = {
        "one_core_before": before,
        "one_core_after": after,
        "ratio": ratio,
        "farm_submit_to_report_s": times,
        "farm_factor": median(times) / (40 * 15.0 / (2 * rate)),
        "allowed_factor": FARM_FACTOR,
    }
    print(f"full path   {rate:.1f} simulated s per wall s and core; {ratio:.2f} of bare mj_step (floor {FLOOR_RATIO})")
    within = f"{median(times):.1f} s from submission to report (allowed {allowed_s:.1f})"
    print(f"40 trials   {within}: factor {figures['farm_factor']:.2f} (allowed {FARM_FACTOR})")
    if options.out:
        options.out.write_text(json.dumps(figures, indent=2) + "\n")
    return 0 if ratio >= FLOOR_RATIO and median(times) <= allowed_s else 1


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
