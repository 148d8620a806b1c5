"""One measurement with the code of one checkout, alone in its process; ``against`` starts it, as JSON in and JSON out.

The process is pinned to one core. Everything of the project comes from the checkout named, which PYTHONPATH has to point to;
that is looked at afterwards, module by module. Only what commit 4d66ffd has, too, is used of ``full_path`` and
``sim_backend.training``. Times are the processor's, of this process and of the policy's, and the clock's; physics alone runs as
it does in this process, with what a checkout's robots install in the engine.
"""

import argparse
import gc
import importlib.util
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout

PROJECT = ("trifarm", "api_schemas", "jail", "trial_logs", "report_views", "sim_backend", "robot_farm", "services", "tests")
HELD_STEPS = 4000
REPEATS = 5
STIFFNESS_NM_RAD, DAMPING_NM_S_RAD = 9.0, 0.3


class Clocks:
    """Seconds of the processor and by the clock since this was made; ``pid`` is a second process that counts."""

    def __init__(self, pid: int | None = None) -> None:
        self._clocks = [time.CLOCK_PROCESS_CPUTIME_ID] + ([] if pid is None else [~pid << 3 | 2])  # as clock_getcpuclockid(3)
        self._began = self._now()

    def _now(self) -> tuple[float, float]:
        return sum(map(time.clock_gettime, self._clocks)), time.perf_counter()

    def us(self, steps: float) -> dict[str, float]:
        """Microseconds for each of so many steps."""
        return {
            name: 1e6 * (now - began) / steps for name, now, began in zip(("cpu", "wall"), self._now(), self._began, strict=True)
        }


def rolled_out(model: mujoco.MjModel, data: mujoco.MjData, torque_nm: np.ndarray) -> dict[str, float]:
    """Microseconds for a step of the model driven by torques of shape (steps, 9), as the median of some repetitions."""
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, state, full)
    found = []
    with Rollout(nthread=0) as rollout:
        scratch = mujoco.MjData(model)
        for _ in range(REPEATS):
            clocks = Clocks()
            rollout.rollout(model, scratch, state, torque_nm[None])
            found.append(clocks.us(len(torque_nm)))
    return {name: median(each[name] for each in found) for name in found[0]}


def as_driven(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Without what only shows, where the checkout's robots step a model without it."""
    from sim_backend.trifinger import scene

    return getattr(scene, "discard_what_shows", lambda whole: whole)(spec)


def live_as_robots() -> None:
    """Leave what was imported out of garbage collections, where the checkout's robots do so."""
    if importlib.util.find_spec("robot_farm.warm_parent") is not None:
        gc.collect()
        gc.freeze()


def held() -> dict[str, float]:
    """The nominal robot with the cube in the middle of the table and fingers held where trials begin."""
    from sim_backend.driver.robot_model import robot_spec
    from sim_backend.effects.physics import Physics
    from sim_backend.trifinger import constants as c

    model = as_driven(robot_spec(Physics.nominal(), physics_step_s=c.PHYSICS_STEP_S)).compile()

    def begun() -> mujoco.MjData:
        data = mujoco.MjData(model)
        data.qpos[:9] = c.START_JOINT_POSITION_RAD
        data.qpos[9:16] = [0.0, 0.0, 0.0325, 1.0, 0.0, 0.0, 0.0]
        mujoco.mj_forward(model, data)
        return data

    data, torques = begun(), []
    for _ in range(HELD_STEPS):
        error_rad = data.qpos[:9] - c.START_JOINT_POSITION_RAD
        data.ctrl[:] = data.qfrc_bias[:9] - STIFFNESS_NM_RAD * error_rad - DAMPING_NM_S_RAD * data.qvel[:9]
        torques.append(data.ctrl.copy())
        mujoco.mj_step(model, data)
    return rolled_out(model, begun(), np.array(torques))


class Timed:
    """Robots of the checkout's ``full_path``, with clocks around what it measures."""

    def __init__(self, full_path: Any, physics: str, policy: Any) -> None:
        self._full_path, self._policy, self._run_trial = full_path, policy, full_path.run_trial
        full_path.run_trial, full_path.bare_s = self._trial, self._bare
        self._robot = full_path.NominalRobot() if physics == "nominal" else _by_text(full_path.RealRobot)(physics)
        self._full: dict[str, float] = {}
        self._alone: dict[str, float] = {}

    def run(self, lease: Any, path: Path) -> tuple[dict[str, float], dict[str, float]]:
        """A trial: microseconds for a step of the full path and of physics alone with the same torques."""
        clock_s, _ = self._robot.run(lease, self._policy, path)  # for a simulated second
        steps = 1e3 * self._full["wall"] / (1e6 * clock_s)
        return {name: took / steps for name, took in self._full.items()}, self._alone

    def _trial(self, *arguments: Any, **settings: Any) -> Any:
        clocks = Clocks(self._policy.pid)
        done = self._run_trial(*arguments, **settings)
        self._full = clocks.us(1)
        return done

    def _bare(self, physics: Any, log: Any, cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> float:
        model = as_driven(self._full_path.robot_spec(physics, physics_step_s=self._full_path.c.PHYSICS_STEP_S)).compile()
        data = mujoco.MjData(model)
        data.qpos[:9], data.qpos[9:12] = log.joint_position_rad[0], cube_position_world_m
        data.qpos[12:16] = cube_quat_wxyz
        mujoco.mj_forward(model, data)
        self._alone = rolled_out(model, data, np.asarray(log.applied_torque_nm))
        return 1.0


def _by_text(real_robot: type) -> type:
    """Real robots that draw their trials by the seed's text; those of 4d66ffd end with a traceback at a number."""

    class ByText(real_robot):
        def _draw(self, seed: int | str, attempt: int) -> Any:
            return super()._draw(str(seed), attempt)

    return ByText


def trials(physics: str, seeds: range) -> dict[str, dict[str, float]]:
    """The full path and physics alone, over one push trial for each seed; a trial before them warms everything up."""
    from tests.benchmarks import full_path

    found = []
    with tempfile.TemporaryDirectory() as name:
        graph, manifest = full_path.convert(Path(name))
        with full_path.JailedPolicy("reference", graph) as policy:
            policy.reset()
            robot = Timed(full_path, physics, policy)
            for seed in (seeds[0], *seeds):
                path = Path(name) / f"{len(found)}.mcap"
                found.append(robot.run(full_path._lease(manifest, seed), path))
                path.unlink()
                if len(found) == 1:
                    live_as_robots()
    full, alone = ([part[which] for part in found[1:]] for which in (0, 1))
    return {"full": _middle(full), "alone": _middle(alone)}


def training(settings: dict, iterations: int) -> dict[str, dict[str, float]]:
    """Microseconds for a sample of training by PPO, rollouts and updates; an iteration before them warms everything up."""
    from sim_backend.training.recipe import Recipe
    from sim_backend.training.train import Run

    recipe = Recipe.model_validate(settings)
    a_round = recipe.ppo.robots * recipe.ppo.steps
    recipe = recipe.model_copy(update={"samples": a_round * (iterations + 1), "minutes": None})
    begun: list[Clocks] = []
    found: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        run = Run("against", recipe, Path(folder), threads=1, tell=lambda _line: None)
        update: Callable[[], None] = run.model.train

        def updated() -> None:
            update()
            if not begun:
                begun.append(Clocks())
            found[:] = [begun[0].us(a_round * iterations)]

        run.model.train = updated
        run.learn()
    return {"sample": found[0]}


def _middle(rows: list[dict[str, float]]) -> dict[str, float]:
    return {name: median(row[name] for row in rows) for name in rows[0]}


def strangers(checkout: Path) -> list[str]:
    """Files of the project's modules that do not lie in the checkout."""
    own = Path(__file__).resolve()
    files = [Path(m.__file__).resolve() for n, m in list(sys.modules.items()) if n.split(".")[0] in PROJECT and m.__file__]
    return [str(file) for file in files if not file.is_relative_to(checkout) and file != own]


def main() -> int:
    """One part, printed as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkout", type=Path, required=True)
    parser.add_argument("--core", type=int, required=True)
    parser.add_argument("--part", choices=["bare", "nominal", "real", "training", "recipe"], required=True)
    parser.add_argument("--seed", type=int, default=500, help="of the first trial")
    parser.add_argument("--count", type=int, default=1, help="trials, or iterations of the training")
    parser.add_argument("--recipe", default="push", help="name of the recipe, or the recipe itself as JSON")
    asked = parser.parse_args()
    os.sched_setaffinity(0, {asked.core})
    seeds = range(asked.seed, asked.seed + asked.count)
    if asked.part == "recipe":
        from sim_backend.training.recipe import load_recipe

        found: dict = load_recipe(asked.recipe)[1].model_dump(mode="json")
    elif asked.part == "training":
        found = training(json.loads(asked.recipe), asked.count)
    elif asked.part == "bare":
        found = {"push": trials("nominal", seeds)["alone"], "held": held()}
    else:
        found = trials(asked.part, seeds)
    if wrong := strangers(asked.checkout.resolve()):
        print(f"modules of another checkout than {asked.checkout}: {', '.join(sorted(wrong)[:5])}", file=sys.stderr)
        return 1
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
