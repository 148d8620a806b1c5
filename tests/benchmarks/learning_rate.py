"""Rates of learning, all in one run and with steps of 4 ms: ``python tests/benchmarks/learning_rate.py --out FILE``.

In turns, on the same actions: (a) bare ``Batch.step`` of the nominal model, put to where the nominal environment is
before each control period and driven by the mean torque that was applied there; (b) the environment with nominal robots; (c) the
environment with all effects of ``real``, whose robots end their trials and are drawn anew. Then (d) the loop of
stable-baselines3 and what it spends its time on. Figures are ratios within the run: rates by the clock, which other work on
the machine disturbs, and by the processor's time of this process.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from mujoco.batch import Batch

from sim_backend.environments.environment import Environment
from sim_backend.environments.practice import practice_of
from sim_backend.trifinger.scene import compile_scene

STEP_S, SUBSTEPS = 0.004, 5
FLOORS = {"nominal": 0.8, "real": 0.5, "physics_and_networks": 0.9}
TRIAL_S = 5.0


@dataclass
class Stopwatch:
    """Time by the clock and of the processor that was spent on something."""

    wall_s: float = 0.0
    cpu_s: float = 0.0

    def __call__(self, work: Callable, *arguments):
        """The work's result."""
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        done = work(*arguments)
        self.wall_s += time.perf_counter() - wall_s
        self.cpu_s += time.process_time() - cpu_s
        return done

    def rates(self, samples: int) -> dict[str, float]:
        """Samples for each second of both."""
        return {"samples_per_s": samples / self.wall_s, "samples_per_cpu_s": samples / self.cpu_s}


class Bare:
    """``Batch.step`` and nothing else."""

    def __init__(self, robots: int, threads: int) -> None:
        self._batch = Batch(compile_scene(physics_step_s=STEP_S), robots, nthread=threads)
        self._qpos, self._qvel, self._ctrl = (self._batch.bind(name) for name in ("qpos", "qvel", "ctrl"))

    def put(self, qpos: np.ndarray, qvel: np.ndarray, torque_nm: np.ndarray) -> None:
        """Bring the simulations to a state."""
        self._qpos[:], self._qvel[:], self._ctrl[:] = qpos, qvel, torque_nm

    def step(self) -> None:
        """One control period."""
        self._batch.step(nstep=SUBSTEPS)


def rates(robots: int, threads: int, blocks: int, periods: int) -> list[dict]:
    """Samples per second of the environments and of bare physics, block by block."""
    rng = np.random.default_rng(0)
    both = {
        physics: Environment(
            practice_of("push", layout="push", physics=physics, episode_s=TRIAL_S, physics_step_s=STEP_S),
            robots=robots,
            threads=threads,
        )
        for physics in ("nominal", "real")
    }
    for environment in both.values():
        environment.reset(np.random.default_rng(1))
    bare, found, action = Bare(robots, threads), [], np.zeros((robots, 9))
    for block in range(blocks + 1):
        watches = {name: Stopwatch() for name in ("bare", *both)}
        for period in range(periods):
            if period % 10 == 0:
                action = rng.uniform(-0.6, 0.6, (robots, 9))
            driver = both["nominal"]._driver
            qpos, qvel = driver._qpos.copy(), driver._qvel.copy()
            for physics, environment in both.items():
                watches[physics](environment.step, action)
            bare.put(qpos, qvel, driver._torque_nm)
            watches["bare"](bare.step)
        samples = robots * periods
        if block:  # the first one warms up
            found.append(
                {
                    name: {"samples_per_s": samples / w.wall_s, "samples_per_cpu_s": samples / w.cpu_s}
                    for name, w in watches.items()
                }
            )
    return found


def summary_of_rates(blocks: list[dict]) -> dict:
    """Medians over blocks; ratios are taken within each block."""
    summary: dict = {"blocks": len(blocks)}
    for name in ("bare", "nominal", "real"):
        summary[name] = {kind: median(block[name][kind] for block in blocks) for kind in ("samples_per_s", "samples_per_cpu_s")}
        if name != "bare":
            for kind, ratio in (("samples_per_s", "ratio"), ("samples_per_cpu_s", "cpu_ratio")):
                summary[name][ratio] = median(block[name][kind] / block["bare"][kind] for block in blocks)
            summary[name]["floor"] = FLOORS[name]
    return summary


def ppo_shares(recipe: str, robots: int, threads: int, iterations: int) -> dict:
    """What the loop of PPO spends its time on, as shares of the clock, once all robots have begun."""
    from sim_backend.environments.vec_env import TrifingerVecEnv
    from sim_backend.training.recipe import Recipe, load_recipe
    from sim_backend.training.train import Run

    name, settings = load_recipe(recipe)
    assert isinstance(settings, Recipe), "PPO's own loop"
    samples = robots * settings.ppo.steps * iterations
    ppo = settings.ppo.model_copy(update={"robots": robots, "minibatch": min(settings.ppo.minibatch, samples // iterations)})
    quick = settings.model_copy(update={"samples": samples, "minutes": None, "ppo": ppo})
    watches = {name: Stopwatch() for name in ("begin", "physics", "environment", "act", "update")}
    with tempfile.TemporaryDirectory() as folder:
        run = Run(name, quick, Path(folder), threads=threads, tell=lambda _line: None)
        assert isinstance(run.robots, TrifingerVecEnv)
        watch_method(watches["physics"], run.robots.environment._driver, "advance_torques")
        watch_method(watches["environment"], run.robots.environment, "step")
        for method in ("forward", "predict_values"):
            watch_method(watches["act"], run.policy, method)
        watch_method(watches["update"], run.model, "train")
        watch_method(watches["begin"], run.robots, "reset")
        run._look_around()
        for watch in watches.values():
            watch.wall_s = watch.cpu_s = 0.0
        whole = Stopwatch()
        run.model.num_timesteps = 1  # it has looked around already
        whole(run.learn)
    whole.wall_s, whole.cpu_s = whole.wall_s - watches["begin"].wall_s, whole.cpu_s - watches["begin"].cpu_s
    spent = {name: watch.wall_s / whole.wall_s for name, watch in watches.items()}
    networks = spent["act"] + spent["update"]
    return {
        "recipe": recipe,
        "samples": samples,
        **whole.rates(samples),
        "share_physics": spent["physics"],
        "share_environment_beyond_physics": spent["environment"] - spent["physics"],
        "share_networks": networks,
        "physics_and_networks": spent["physics"] + networks,
        "floor": FLOORS["physics_and_networks"],
    }


def watch_method(watch: Stopwatch, owner: object, method: str) -> None:
    """Take the time of a method from now on."""
    work = getattr(owner, method)
    setattr(owner, method, lambda *a, **k: watch(lambda: work(*a, **k)))


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Rates of learning.")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--robots", type=int, default=1024)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--blocks", type=int, default=8)
    parser.add_argument("--periods", type=int, default=20)
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--recipes", nargs="+", default=["push", "push-randomized"])
    options = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    found = {
        "robots": options.robots,
        "threads": options.threads,
        "load_before": os.getloadavg()[0],
        "rates": summary_of_rates(rates(options.robots, options.threads, options.blocks, options.periods)),
        "ppo": [ppo_shares(recipe, options.robots, options.threads, options.iterations) for recipe in options.recipes],
        "load_after": os.getloadavg()[0],
    }
    text = json.dumps(found, indent=2)
    print(text)
    if options.out:
        options.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
