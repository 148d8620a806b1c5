"""A training run from its recipe to a policy that the farm takes: PPO of stable-baselines3 on many robots at once.

    python -m sim_backend.training RECIPE [--out DIR] [--resume] [--json]

Everything goes into one folder: the policy and its manifest, ``record.json``, and a checkpoint from which it can go on.
"""

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO

from sim_backend.environments.vec_env import TrifingerVecEnv
from sim_backend.tasks import TASKS
from sim_backend.training import evaluating
from sim_backend.training.actor_critic import ActorCritic, hold_actor, whole_of
from sim_backend.training.changes import MAY_CHANGE, changes
from sim_backend.training.demonstrations.plain_policy import begin_with
from sim_backend.training.demonstrations.residual import FrozenPolicy, ResidualRobots
from sim_backend.training.demonstrations.term import DemonstrationTerm
from sim_backend.training.export import ExportedPolicy, exported
from sim_backend.training.folder import CHECKPOINT
from sim_backend.training.from_recipe import network_arguments, practice_of_recipe
from sim_backend.training.progress import Watch
from sim_backend.training.randomization import Randomizer, randomizer_of
from sim_backend.training.recipe import PpoWarmStartTable, Recipe, RecipeError
from sim_backend.training.recurrent import RecurrentActorCritic
from sim_backend.training.returns import NormalisedReturns
from sim_backend.training.sliced_ppo import SlicedPPO, SlicedRobots
from sim_backend.training.slices import Slices
from trial_logs.disk import put_in_place


@dataclass
class Run:
    """A run in its folder. Owner of networks, robots and of what has been measured so far."""

    name: str
    recipe: Recipe
    folder: Path
    threads: int = 2
    tell: Callable[[str], None] = print
    workers: int | None = None  # that roll out slices of the robots; without, all robots are here
    cluster: str | None = None
    seconds: float = 0.0  # before this start
    iterations: int = 0
    level: int = 0
    starts: int = 1
    stopped: bool = False
    evaluations: list[dict] = field(default_factory=list)
    curve: list[dict] = field(default_factory=list)

    def __post_init__(self) -> None:
        recipe = self.recipe
        evaluating.check_robots(recipe)
        torch.manual_seed(recipe.seed)
        torch.set_num_threads(self.threads)
        self.randomizer: Randomizer = randomizer_of(recipe)
        practice = practice_of_recipe(recipe, self.randomizer)
        settings: dict[str, Any] = {"robots": recipe.ppo.robots, "threads": self.threads, "seed": recipe.seed}
        settings |= {"privileged": recipe.networks.privileged, "physics_backend": recipe.physics_backend}
        self.frozen = FrozenPolicy(recipe.residual, practice) if recipe.residual else None
        if self.workers is None and recipe.ppo.lag:
            raise ValueError("ppo.lag is about rollouts of workers; give --workers, or leave it out")
        self.slices = None if self.workers is None else Slices(self, self.workers, self.cluster)
        self.robots: TrifingerVecEnv | SlicedRobots
        if self.slices is not None:
            self.robots = SlicedRobots(practice, recipe.ppo.robots, privileged=recipe.networks.privileged)
        elif self.frozen is not None:
            self.robots = ResidualRobots(self.frozen, practice, **settings)
        else:
            self.robots = TrifingerVecEnv(practice, **settings)
        self.returns = NormalisedReturns(self.robots, recipe.ppo.discount)
        self.model = _ppo(recipe, self.returns, self._rate, self.slices)
        self.policy: ActorCritic | RecurrentActorCritic = self.model.policy  # type: ignore[assignment]
        if recipe.networks.memory is None:
            self.returns.value_of = self._values
        if self.frozen is not None:
            assert isinstance(self.policy, ActorCritic)
            self.frozen.fix_inputs(self.policy.features_extractor)
            self.exported()  # complains at once if the two networks do not fit together
        self.term: DemonstrationTerm | None = None
        if recipe.demonstrations is not None:
            assert isinstance(self.policy, ActorCritic)
            self.term = DemonstrationTerm(recipe.demonstrations, practice, self.policy, recipe.seed)
            self.term.join(self.policy.optimizer, lambda: self.iterations - 1)
        if recipe.warm_start is not None:
            self._begin_with(recipe.warm_start)

    @property
    def samples(self) -> int:
        """Control periods of all robots together so far."""
        return self.model.num_timesteps

    def learn(self) -> None:
        """Train until the samples or minutes of the recipe are over."""
        if self.slices is not None:
            with self.slices:
                self._learn()
        else:
            self._learn()

    def _learn(self) -> None:
        if self.model.num_timesteps == 0:
            if not self.knows_inputs:
                self._look_around() if self.slices is None else self.slices.look_around()
            if self.term is not None:
                self.term.clone(self.tell)
                evaluating.evaluate(self, 0)  # what the clone can do before it practises; the checkpoint has it from now on
        left = self.recipe.samples - self.model.num_timesteps
        if left > 0:
            self.model.learn(left, Watch(self), reset_num_timesteps=False, log_interval=1)

    def stop(self) -> None:
        """End the training after the present control period."""
        self.stopped = True

    def finish(self) -> dict:
        """Write the policy, try it on fresh goals at 1 kHz, and write the record, which is returned."""
        return evaluating.finish(self)

    def exported(self) -> ExportedPolicy:
        """The actor as the farm takes it."""
        practice = self.robots.environment.practice
        if self.frozen is not None:
            assert isinstance(self.policy, ActorCritic)
            return self.frozen.with_residual(self.policy, practice, self.name)
        return exported(self.policy, practice.manifest, self.name)

    def record(self) -> dict:
        """What the run has done so far."""
        return {
            "recipe": self.name,
            "settings": self.recipe.model_dump(mode="json"),
            "samples": self.model.num_timesteps,
            "iterations": self.iterations,
            "wall_s": round(self.seconds, 1),
            "starts": self.starts,
            "level": self.level,
            "randomization": self.randomizer.document(),
            "return_scaling": {"mean": self.returns.mean, "variance": self.returns.variance},
            "curve": self.curve,
            "evaluations": self.evaluations,
            **({} if self.slices is None else {"workers": self.slices.document()}),
        }

    def keep(self) -> None:
        """Write the checkpoint; whatever happens there is a whole one."""
        state = {
            "policy": self.policy.state_dict(),
            "optimizer": self.policy.optimizer.state_dict(),
            "returns": [self.returns.mean, self.returns.variance, self.returns.count],
            "samples": self.model.num_timesteps,
            "settings": self.recipe.model_dump_json(),
            "randomization": self.randomizer.state(),
            "run": [self.iterations, self.seconds, self.level, self.starts],
            "evaluations": json.dumps([self.evaluations, self.curve]),
            **({} if self.slices is None else {"slices": self.slices.state()}),
        }
        fresh = self.folder / (CHECKPOINT + ".new")
        torch.save(state, fresh)
        put_in_place(fresh, self.folder / CHECKPOINT)

    def go_on(self) -> None:
        """Take up the checkpoint; robots begin new trials, drawn from another seed than before.

        Raises:
            RecipeError: the checkpoint is of a recipe by which it would have been learned otherwise.
        """
        state = torch.load(self.folder / CHECKPOINT, weights_only=True)
        if found := changes(json.loads(state["settings"]), self.recipe, MAY_CHANGE):
            raise RecipeError(
                f"{self.folder} was begun with another recipe: {'; '.join(found)}; go on with that one, of which only "
                f"{', '.join(MAY_CHANGE)} may change, or give another --out to begin anew"
            )
        if (self.slices is None) == ("slices" in state):
            raise RecipeError(f"{self.folder} was begun {'without' if self.slices else 'with'} --workers; go on with it likewise")
        self.policy.load_state_dict(state["policy"])
        self.policy.optimizer.load_state_dict(state["optimizer"])
        self.returns.mean, self.returns.variance, self.returns.count = state["returns"]
        self.model.num_timesteps = state["samples"]
        self.randomizer.restore(state["randomization"])
        self.iterations, self.seconds, level, starts = state["run"]
        self.evaluations, self.curve = json.loads(state["evaluations"])
        self.starts = starts + 1
        self.robots.seed(self.recipe.seed + 1_000_003 * starts)
        torch.manual_seed(self.recipe.seed + 1_000_003 * starts)
        self.set_level(level)
        if self.slices is not None:
            self.slices.restore(state["slices"])

    def set_level(self, level: int) -> None:
        """Practise this level of the curriculum from now on, all robots beginning anew."""
        self.level = level
        if self.recipe.curriculum:
            levels = [*self.recipe.curriculum]
            task = TASKS[levels[level].task if level < len(levels) else self.recipe.task]
            self.robots.environment.practice = replace(self.robots.environment.practice, task=task)

    @property
    def knows_inputs(self) -> bool:
        """Whether the scaling of the inputs stays as it is: that of another run was taken over, or enough was seen."""
        return self._begun_with_run or self.iterations > self.recipe.ppo.freeze_inputs_after

    def _begin_with(self, start: PpoWarmStartTable) -> None:
        assert isinstance(self.policy, ActorCritic)
        if start.run is not None:
            self._take_over(Path(start.run) / CHECKPOINT)
            return
        assert start.policy is not None
        practice, policy = self.robots.environment.practice, self.policy
        begin_with(start.policy, start.layout, practice, policy.features_extractor, policy.all_actor_layers)
        hold_actor(self.policy, self.policy.optimizer, lambda: self._critic_is_first)

    def _take_over(self, checkpoint: Path) -> None:
        """All that another run has learned: actor, critic, deviation, scalings; not what it had measured."""
        if not checkpoint.exists():
            raise ValueError(f"there is no {checkpoint} to begin with; train that run first")
        state = torch.load(checkpoint, weights_only=True)
        other = Recipe.model_validate_json(state["settings"])
        for name in ("layout", "action", "action_scale", "networks"):
            if getattr(other, name) != getattr(self.recipe, name):
                raise ValueError(f"{checkpoint.parent.name} was trained with another {name}; the recipe must have the same")
        self.policy.load_state_dict(state["policy"])
        self.policy.optimizer.load_state_dict(state["optimizer"])
        self.returns.mean, self.returns.variance, self.returns.count = state["returns"]

    @property
    def _begun_with_run(self) -> bool:
        return self.recipe.warm_start is not None and self.recipe.warm_start.run is not None

    @property
    def _critic_is_first(self) -> bool:
        start = self.recipe.warm_start
        return start is not None and start.policy is not None and self.iterations <= start.critic_first

    def _rate(self, left: float) -> float:
        """The learning rate when such a share of the samples is left."""
        first, last = self.recipe.ppo.learning_rate, self.recipe.ppo.final_learning_rate or self.recipe.ppo.learning_rate
        if self._critic_is_first:
            assert self.recipe.warm_start is not None
            return self.recipe.warm_start.critic_learning_rate
        return last + (first - last) * left

    def _look_around(self) -> None:
        """Learn the scaling of the inputs from some steps with actions by chance, before anything else."""
        rng, observation = np.random.default_rng(self.recipe.seed), self.robots.reset()
        for _ in range(self.recipe.ppo.steps):
            self.policy.features_extractor.learn_scaling(_as_rows(observation))
            space = self.robots.action_space
            shape = (self.robots.num_envs, 9)
            actions = rng.uniform(-0.5, 0.5, shape) if hasattr(space, "low") else rng.integers(0, 11, shape)
            observation = self.robots.step(actions)[0]

    @torch.no_grad()
    def _values(self, observation) -> np.ndarray:
        assert isinstance(self.policy, ActorCritic)
        tensors = self.policy.obs_to_tensor(observation)[0]
        return self.policy.predict_values(tensors).flatten().numpy()


def _ppo(recipe: Recipe, robots: NormalisedReturns, rate: Callable[[float], float], slices: Slices | None) -> PPO | RecurrentPPO:
    ppo, policy = recipe.ppo, ActorCritic
    method: Any = PPO
    if slices is not None:
        method = functools.partial(SlicedPPO, slices)
    elif recipe.networks.memory is not None:
        method, policy = RecurrentPPO, RecurrentActorCritic
    return method(
        policy,
        robots,
        learning_rate=rate,
        n_steps=ppo.steps,
        batch_size=ppo.minibatch,
        n_epochs=ppo.epochs,
        gamma=ppo.discount,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip,
        ent_coef=ppo.entropy,
        vf_coef=ppo.value,
        max_grad_norm=ppo.largest_gradient,
        policy_kwargs=network_arguments(recipe),
        seed=recipe.seed,
        device="cpu",
    )


def _as_rows(observation) -> torch.Tensor:
    if isinstance(observation, dict):
        return whole_of({name: torch.from_numpy(part) for name, part in observation.items()})
    return torch.from_numpy(observation)
