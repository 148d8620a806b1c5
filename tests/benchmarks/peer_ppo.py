"""How long our PPO and rsl_rl's take to push: ``python -m tests.benchmarks.peer_ppo --rows ROWS.jsonl --out FILE``.

Both learn in the environment of a recipe, with as many robots, steps of a rollout and layers of the same sizes, and with the
same inputs: what the policy sees, completed by the differences between places in it. The critics of both may know more than the
policy. All else of rsl_rl is as its users publish it for lifting a cube: Isaac Lab's ``LiftCubePPORunnerCfg`` (5 epochs, 4
minibatches, learning rate 1e-4 and adaptive, discount 0.98, entropy 0.006), but for its observations: they are normalised here,
since ours are metres and radians as they are. In turns, seed by seed, until 90 % of 200 goals are reached at 1 kHz. These are
tried every so many samples, with the clock of the training stopped. The peer gives up at twice the time that ours took with the
seed. A training that was stopped begins anew; kept ones are not redone, and count only with the settings that they were made
with. Each says what time of the processor it took, and how busy the machine was.
"""

import argparse
import contextlib
import json
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command has it: torch's threads do not spin while they wait

import numpy as np
import torch
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from api_schemas.policy import PolicyManifest
from sim_backend.environments.vec_env import PRIVILEGED, SEEN, TrifingerVecEnv
from sim_backend.evaluation import Act, evaluate
from sim_backend.tasks import TASKS
from sim_backend.training import evaluating
from sim_backend.training.actor_critic import difference_matrix
from sim_backend.training.from_recipe import practice_of_recipe
from sim_backend.training.randomization import randomizer_of
from sim_backend.training.recipe import Recipe, load_recipe
from sim_backend.training.train import Run
from sim_backend.training.trying import Tried
from tests.benchmarks.machine import kind

WANTED, FIRST_GOAL = 0.9, 30_000_000
OURS, PEER = "trifarm", "rsl_rl"
QUICKER, GIVES_UP = 1.5, 2.0
"""By which ours is wanted to be there earlier, in the median; at how many times of our seconds the peer ends."""


class Course:
    """What a training has reached, by the samples and seconds that it has taken without its evaluations."""

    def __init__(self, recipe: Recipe, goals: int, threads: int, limit_s: float) -> None:
        self._task, self._goals, self._threads, self._limit_s = TASKS[recipe.task], goals, threads, limit_s
        self._manifest = practice_of_recipe(recipe, randomizer_of(recipe)).manifest
        self.curve: list[dict[str, float]] = []
        self._begun_s, self._away_s = time.perf_counter(), 0.0
        self._begun_cpu_s, self._away_cpu_s = time.process_time(), 0.0

    @property
    def arrived(self) -> bool:
        """Whether the wanted share of goals was reached at last."""
        return bool(self.curve) and self.curve[-1]["success"] >= WANTED

    def is_over(self, act: Act, samples: int) -> bool:
        """Try the policy as it is on nominal robots at 1 kHz, while the clock stands still; whether that ends the training."""
        away_s, away_cpu_s = time.perf_counter(), time.process_time()
        spent_s, spent_cpu_s = away_s - self._begun_s - self._away_s, away_cpu_s - self._begun_cpu_s - self._away_cpu_s
        seeds = range(FIRST_GOAL, FIRST_GOAL + self._goals)
        rate = float(evaluate(act, self._manifest, self._task, seeds, threads=self._threads).success.mean())
        spent = {"wall_s": round(spent_s, 1), "processor_s": round(spent_cpu_s, 1), "load": round(os.getloadavg()[0], 2)}
        self.curve.append({"samples": samples, **spent, "success": rate})
        print(f"  {samples:>11,} samples {spent_s:7.0f} s  {rate:.0%}", flush=True)
        self._away_s += time.perf_counter() - away_s
        self._away_cpu_s += time.process_time() - away_cpu_s
        return self.arrived or spent_s >= self._limit_s


def ours(recipe: Recipe, threads: int, course: Course) -> None:
    """Learn as ``trifarm train`` does."""

    def tried(run: Run, samples: int) -> list[Tried]:
        if course.is_over(run.exported(), samples):
            run.stop()
        return []

    with tempfile.TemporaryDirectory() as folder, patch.object(evaluating, "evaluate", tried):
        Run("peer", recipe, Path(folder), threads=threads, tell=lambda _line: None).learn()


class ForRslRl:
    """``rsl_rl.env.VecEnv`` around our robots, with the inputs of our networks; trials that ran out of time are told as such."""

    device, cfg, num_actions = "cpu", {}, 9

    def __init__(self, robots: TrifingerVecEnv, manifest: PolicyManifest) -> None:
        self._robots, self.num_envs, self._manifest = robots, robots.num_envs, manifest
        self.max_episode_length = robots.environment.practice.periods
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self._seen: Any = robots.reset()

    def get_observations(self) -> TensorDict:
        """What actor and critic see now."""
        privileged = torch.from_numpy(np.asarray(self._seen[PRIVILEGED], np.float32))
        return TensorDict({SEEN: completed(self._seen[SEEN], self._manifest), PRIVILEGED: privileged}, [self.num_envs])

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """Advance all robots by one control period."""
        self._seen, reward, done, infos = self._robots.step(actions.numpy())
        late = np.array([bool(info.get("TimeLimit.truncated")) for info in infos])
        return (
            self.get_observations(),
            torch.from_numpy(reward),
            torch.from_numpy(done).long(),
            {"time_outs": torch.from_numpy(late)},
        )


def completed(seen: np.ndarray, manifest: PolicyManifest) -> torch.Tensor:
    """What a policy sees, shape (n, seen), with the differences between places in it that our networks are given, too."""
    numbers = np.asarray(seen, np.float32)
    return torch.from_numpy(np.concatenate([numbers, numbers @ difference_matrix(manifest).T.astype(np.float32)], axis=1))


def runner_settings(recipe: Recipe) -> dict[str, Any]:
    """Of rsl_rl's runner: the recipe's sizes, and Isaac Lab's numbers for lifting a cube."""

    def model(layers: tuple[int, ...]) -> dict[str, Any]:
        return {"class_name": "MLPModel", "hidden_dims": list(layers), "activation": "elu", "obs_normalization": True}

    deviation = {"distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}}
    algorithm = {
        "class_name": "PPO",
        "value_loss_coef": 1.0,
        "use_clipped_value_loss": True,
        "clip_param": 0.2,
        "entropy_coef": 0.006,
    }
    algorithm |= {"num_learning_epochs": 5, "num_mini_batches": 4, "learning_rate": 1e-4, "schedule": "adaptive"}
    algorithm |= {"gamma": 0.98, "lam": 0.95, "desired_kl": 0.01, "max_grad_norm": 1.0}
    return {
        "seed": recipe.seed,
        "num_steps_per_env": recipe.ppo.steps,
        "save_interval": 10**9,
        "obs_groups": {"actor": [SEEN], "critic": [SEEN, PRIVILEGED]},
        "actor": model(recipe.networks.actor) | deviation,
        "critic": model(recipe.networks.critic),
        "algorithm": algorithm,
    }


def peer(recipe: Recipe, threads: int, course: Course) -> None:
    """Learn with rsl_rl's own runner."""
    torch.manual_seed(recipe.seed)
    torch.set_num_threads(threads)
    practice = practice_of_recipe(recipe, randomizer_of(recipe))
    robots = TrifingerVecEnv(practice, robots=recipe.ppo.robots, threads=threads, seed=recipe.seed, privileged=True)
    runner = OnPolicyRunner(ForRslRl(robots, practice.manifest), runner_settings(recipe), log_dir=None, device="cpu")  # type: ignore[arg-type]
    batch = recipe.ppo.robots * recipe.ppo.steps
    between = max(1, recipe.evaluation.every_samples // batch)

    def act(observation: np.ndarray) -> np.ndarray:
        seen = TensorDict({SEEN: completed(observation, practice.manifest)}, [len(observation)])
        with torch.inference_mode():
            return practice.action_space.to_command(runner.get_inference_policy()(seen).numpy())

    for iteration in range(between, recipe.samples // batch + 1, between):
        with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
            runner.learn(between)
            runner.current_learning_iteration += 1
        if course.is_over(act, iteration * batch):
            return


LEARNERS: dict[str, Callable[[Recipe, int, Course], None]] = {OURS: ours, PEER: peer}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Seconds by learner and the ratios of their medians; of trainings that did not arrive, those until they ended."""
    found: dict[str, Any] = {"wanted": WANTED, "wanted_ratio": QUICKER, "machine": kind()}
    for learner in LEARNERS:
        own = [row for row in rows if row["learner"] == learner]
        ends = [row["curve"][-1] for row in own]
        found[learner] = {"trainings": len(own), "arrived": sum(row["arrived"] for row in own)}
        found[learner] |= {name: sorted(end[name] for end in ends) for name in ("wall_s", "processor_s")}
    if found[OURS]["arrived"] == found[OURS]["trainings"] == found[PEER]["trainings"] > 0:
        ratio = {name: round(median(found[PEER][name]) / median(found[OURS][name]), 3) for name in ("wall_s", "processor_s")}
        found |= {"ratio_at_least": ratio["wall_s"], "ratio_of_processors": ratio["processor_s"]}
    return found | {"trainings": rows}


def kept(rows: Path) -> list[dict[str, Any]]:
    """Trainings that have ended."""
    return [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []


def main() -> None:
    """Learns what is missing, keeps each training when it has ended, and writes the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recipe", default="push")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--samples", type=int, help="of a training at most; the recipe's by default")
    parser.add_argument("--every", type=int, default=500_000, help="samples between two evaluations")
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--robots", type=int, help="the recipe's by default")
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    _, recipe = load_recipe(asked.recipe)
    assert isinstance(recipe, Recipe) and recipe.networks.privileged, (
        "PPO's own loop, whose critic knows more, as the peer's does"
    )
    evaluation = recipe.evaluation.model_copy(update={"every_samples": asked.every, "trials": asked.goals})
    ppo = recipe.ppo
    if asked.robots:
        ppo = ppo.model_copy(update={"robots": asked.robots, "minibatch": min(ppo.minibatch, asked.robots * ppo.steps)})
    made_with = {name: value for name, value in vars(asked).items() if name not in {"rows", "out", "seeds"}}
    if others := [row["seed"] for row in kept(asked.rows) if row.get("settings") != made_with]:
        parser.error(f"{asked.rows} has trainings with other settings (seeds {others}); name another file")
    changes = {"minutes": None, "samples": asked.samples or recipe.samples, "evaluation": evaluation, "ppo": ppo}
    for seed in asked.seeds:
        for learner, learn in LEARNERS.items():
            done = {row["learner"]: row for row in kept(asked.rows) if row["seed"] == seed}
            if learner in done:
                continue
            print(f"{learner}, seed {seed}", flush=True)
            settings = recipe.model_copy(update={**changes, "seed": seed})
            limit_s = GIVES_UP * done[OURS]["curve"][-1]["wall_s"] if learner == PEER else math.inf
            course = Course(settings, asked.goals, asked.threads, limit_s)
            learn(settings, asked.threads, course)
            row = {"learner": learner, "seed": seed, "arrived": course.arrived, "curve": course.curve, "settings": made_with}
            with asked.rows.open("a") as file:
                file.write(json.dumps(row) + "\n")
    found = summary(kept(asked.rows))
    asked.out.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps({name: value for name, value in found.items() if name != "trainings"}))


if __name__ == "__main__":
    main()
