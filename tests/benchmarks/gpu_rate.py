"""Samples for each second with the physics on a GPU, beside MuJoCo's own batch on the cores of the same machine.

    python -m tests.benchmarks.gpu_rate --out FILE [--robots 1024 4096 16384] [--real 1024]

First, whether the GPU moves robots as MuJoCo does: nominal ones under the same torques, the largest differences. Then samples
of the environment (``push``, control at 50 Hz, steps of 4 ms) with random actions, for each number of robots and each back end;
and what the time goes to: the device's own step, copies to and from it, safety and effects on the processor, new trials, and
the rest of the environment, of which the functions that take most are listed. A row is kept as soon as it is known.
"""

import argparse
import cProfile
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.warp_batch import WarpBatch, open_device
from sim_backend.environments.environment import Environment
from sim_backend.environments.practice import practice_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial, stack_starts
from tests.benchmarks.learning_rate import STEP_S, SUBSTEPS, TRIAL_S, Stopwatch, watch_method
from tests.benchmarks.machine import cores, cpu_model, kind

PARTS = {"control": "_control", "to_device": "_send", "device": "_launch", "from_device": "_receive"}


def agreement(backend: PhysicsBackend, robots: int, steps: int) -> dict[str, float]:
    """The largest differences to MuJoCo's batch among nominal robots under the same random torques, cube on the table."""
    start = stack_starts([draw_trial(TASKS["push"], seed)[0] for seed in range(robots)])
    ends: list[tuple[np.ndarray, np.ndarray]] = []
    for chosen in (PhysicsBackend.CPU, backend):
        driver = SimulatedDriver(robots=robots, threads=cores(), physics_step_s=STEP_S, backend=chosen)
        driver.reset(start)
        rng = np.random.default_rng(0)
        torques_nm = np.repeat(rng.uniform(-0.2, 0.2, (robots, steps // 25, 9)), 25, axis=1)
        last = driver.advance_torques(torques_nm)
        ends.append((last.true_joint_position_rad[:, -1], last.cube_position_world_m[:, -1]))
    joints, cube = (np.abs(ends[1][part] - ends[0][part]).max(axis=1) for part in (0, 1))
    told = {"robots": robots, "steps": steps, "joint_rad_median": np.median(joints), "joint_rad_largest": joints.max()}
    told |= {"cube_mm_median": 1000 * np.median(cube), "cube_mm_largest": 1000 * cube.max()}
    return {name: float(value) for name, value in told.items()}


def rate(backend: PhysicsBackend, robots: int, physics: str, seconds: float) -> dict[str, Any]:
    """One environment's samples for each second, after four periods that are not counted, and shares of the time."""
    practice = practice_of("push", layout="push", physics=physics, episode_s=TRIAL_S, physics_step_s=STEP_S)
    began_s = time.perf_counter()
    environment = Environment(practice, robots=robots, threads=cores(), physics_backend=backend)
    opened_s = time.perf_counter() - began_s
    environment.reset(np.random.default_rng(1))
    reset_s = time.perf_counter() - began_s - opened_s
    rng, watches = np.random.default_rng(0), dict[str, Stopwatch]()
    for _ in range(4):
        environment.step(rng.uniform(-0.6, 0.6, (robots, 9)))
    batch = environment._driver._batch
    if isinstance(batch, WarpBatch):
        launch, warp = batch._launch, batch._warp

        def launched_and_done() -> None:
            launch()
            warp.synchronize()

        batch._launch = launched_and_done
        watches = {part: Stopwatch() for part in PARTS}
        for part, method in PARTS.items():
            watch_method(watches[part], batch, method)
    watch_method(watches.setdefault("new_trials", Stopwatch()), environment, "_begin_anew")
    periods, whole_s, began_s = 0, 0.0, time.perf_counter()
    while whole_s < seconds or periods < 5:
        environment.step(rng.uniform(-0.6, 0.6, (robots, 9)))
        periods, whole_s = periods + 1, time.perf_counter() - began_s
    with cProfile.Profile() as profile:
        for _ in range(3):
            environment.step(rng.uniform(-0.6, 0.6, (robots, 9)))
    shares = {part: round(watch.wall_s / whole_s, 3) for part, watch in watches.items()}
    told = {"backend": str(backend), "robots": robots, "physics": physics, "periods": periods}
    told |= {"samples_per_s": round(robots * periods / whole_s), "steps_per_s": round(SUBSTEPS * robots * periods / whole_s)}
    if isinstance(batch, WarpBatch):
        told["device_steps_per_s"] = round(SUBSTEPS * robots * periods / watches["device"].wall_s)
    return told | {"shares": shares, "open_s": round(opened_s, 1), "reset_s": round(reset_s, 1), "functions": slowest(profile)}


def slowest(profile: cProfile.Profile) -> dict[str, float]:
    """The ten functions that take most of a profile, each with its own share."""
    profile.create_stats()
    own_s = {f"{Path(file).name}:{name}": row[2] for (file, _, name), row in vars(profile)["stats"].items()}
    return {name: round(s / sum(own_s.values()), 3) for name, s in sorted(own_s.items(), key=lambda pair: -pair[1])[:10]}


def name_of(backend: PhysicsBackend) -> str:
    """What steps the physics, by name."""
    if backend is PhysicsBackend.CPU:
        return cpu_model()
    warp, _, device = open_device("cpu" if backend is PhysicsBackend.WARP_CPU else None)
    return warp.get_device(device).name


def main(arguments: list[str] | None = None) -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--backend", type=PhysicsBackend, default=PhysicsBackend.WARP)
    parser.add_argument("--robots", type=int, nargs="+", default=[1024, 4096, 16384])
    parser.add_argument("--real", type=int, nargs="*", default=[1024], help="numbers of robots drawn as 'real'")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--compared", type=int, default=64, help="robots whose motion is compared")
    given = parser.parse_args(arguments)
    found: dict[str, Any] = {"machine": kind(), "device": name_of(given.backend), "step_s": STEP_S}
    began_s = time.perf_counter()

    def keep(**part: Any) -> None:
        print(round(time.perf_counter() - began_s, 1), part, flush=True)
        found.update(part)
        given.out.write_text(json.dumps(found, indent=1) + "\n")

    keep(agreement=agreement(given.backend, given.compared, 250))
    wanted = [(n, "nominal") for n in given.robots] + [(n, "real") for n in given.real]
    for robots, physics in wanted:
        for backend in dict.fromkeys((given.backend, PhysicsBackend.CPU)):
            keep(rates=[*found.get("rates", []), rate(backend, robots, physics, given.seconds)])


if __name__ == "__main__":
    main()
