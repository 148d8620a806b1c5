"""Rollouts of slices of the robots: each slice has seeds of its own, and whichever worker has it goes on with it from its state.

What a slice gives depends on its state, the networks and (seed of the recipe, slice, iteration), and on nothing of who rolls it
out, so that it may be done again elsewhere with the same bits.
"""

import mmap
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces

from sim_backend.environments.environment import PRIVILEGED_SIZE, Environment, Stepped
from sim_backend.environments.observation_space import gym_action_space, observation_space
from sim_backend.environments.vec_env import PRIVILEGED, SEEN, seen_space
from sim_backend.training.actor_critic import ActorCritic
from sim_backend.training.from_recipe import network_arguments, practice_of_recipe
from sim_backend.training.randomization import randomizer_of
from sim_backend.training.recipe import Recipe

Layout = dict[str, tuple[tuple[int, ...], str]]


@dataclass(frozen=True)
class Order:
    """A slice to roll out for an iteration. ``state`` is what it became in the one before, None to begin anew."""

    slice: int
    iteration: int
    state: dict[str, Any] | None = None


@dataclass(frozen=True)
class Rollout:
    """What a slice of k robots gave. ``columns`` (:func:`layout_of_rollouts`) are None where they lie in memory that is shared.

    ``last_values`` (k,) are the critic's of what is seen at the end, ``ended`` are (step, robot of the slice, success) of the
    trials that ended, ``work_s`` is what it took.
    """

    slice: int
    columns: dict[str, np.ndarray] | None
    last_values: np.ndarray
    ended: list[tuple[int, int, bool]]
    state: dict[str, Any]
    work_s: float


def layout_of_rollouts(recipe: Recipe, robots: int) -> Layout:
    """Arrays of an iteration: shape (steps, robots, ...) and type of each.

    ``bootstrap`` is what the critic says of the last observation of trials that only time ended, 0 elsewhere.
    """
    practice, shape = practice_of_recipe(recipe, randomizer_of(recipe)), (recipe.ppo.steps, robots)
    seen, action = observation_space(practice.manifest).shape, gym_action_space(practice.action_space)
    assert seen is not None and action.shape is not None and action.dtype is not None
    layout: Layout = {SEEN: ((*shape, *seen), "float32"), "actions": ((*shape, *action.shape), str(action.dtype))}
    if recipe.networks.privileged:
        layout[PRIVILEGED] = ((*shape, PRIVILEGED_SIZE), "float32")
    return (
        layout
        | {name: (shape, "float32") for name in ("rewards", "values", "log_probs", "bootstrap")}
        | {"dones": (shape, "bool")}
    )


class SharedColumns:
    """Arrays that the processes of a machine share: unpickled it is the same memory, which goes with its last user."""

    def __init__(self, layout: Layout, opened: tuple[int, int] | None = None) -> None:
        self._layout = layout
        size = sum(_bytes(*each) for each in layout.values())
        if opened is None:
            file = os.memfd_create("rollouts")
            os.ftruncate(file, size)
            self._opened, self._file = (os.getpid(), file), file
        else:
            self._opened, self._file = opened, os.open(Path(f"/proc/{opened[0]}/fd/{opened[1]}"), os.O_RDWR)
        memory, at = mmap.mmap(self._file, size), 0
        self.arrays: dict[str, np.ndarray] = {}
        for name, (shape, kind) in layout.items():
            self.arrays[name] = np.ndarray(shape, kind, memory, at)
            at += _bytes(shape, kind)
        self.nbytes, self._close = size, os.close  # which may be gone when the program ends

    def __reduce__(self) -> tuple:
        """Pickled by where it is, not by what is in it."""
        return SharedColumns, (self._layout, self._opened)

    def __del__(self) -> None:
        """The arrays keep the memory; the file is no longer needed."""
        self._close(self._file)


def _bytes(shape: tuple[int, ...], kind: str) -> int:
    return -(-int(np.prod(shape)) * np.dtype(kind).itemsize // 64) * 64


def _no_optimizer(*_: Any, **__: Any) -> None:
    """A worker only acts. Each of torch's optimizers would import its compiler first, which takes longer than all else."""


class RolloutWorker:
    """The work of a rollout worker. Owner of the environments of the slices that it rolled out last.

    Args:
        recipe: of the run.
        slices: into which its robots are divided.
        threads: of the physics.
        shared: where rollouts are written, those of iteration k at k modulo their number; if None they are given back instead.
    """

    def __init__(self, recipe: Recipe, slices: int, threads: int = 1, shared: tuple[SharedColumns, ...] | None = None) -> None:
        self._recipe, self._robots, self._threads, self._shared = recipe, recipe.ppo.robots // slices, threads, shared
        self._practice = practice_of_recipe(recipe, randomizer_of(recipe))
        self._action_space = gym_action_space(self._practice.action_space)
        with _one_thread():
            space = seen_space(self._practice, recipe.networks.privileged)
            self._policy = ActorCritic(
                space,
                self._action_space,
                lambda _: 0.0,
                optimizer_class=_no_optimizer,
                **network_arguments(recipe),
            )
        self._policy.set_training_mode(False)
        self._environments: dict[int, tuple[int | None, Environment, np.ndarray]] = {}

    def __call__(self, order: Order, weights: dict[str, np.ndarray] | None) -> Rollout:
        """Roll out a slice; without weights actions are drawn evenly, to see what there is to be seen."""
        begun_s = time.perf_counter()
        seeds = np.random.SeedSequence([self._recipe.seed, order.slice, order.iteration])
        environment, seen = self._environment_of(order, np.random.default_rng(seeds))
        columns = self._columns(order)
        with _one_thread(), torch.no_grad():
            torch.manual_seed(int(seeds.spawn(1)[0].generate_state(1, np.uint64)[0]))
            if weights is not None:
                self._policy.load_state_dict({name: torch.from_numpy(values.copy()) for name, values in weights.items()})
            ended = []
            for step in range(self._recipe.ppo.steps):
                seen, over = self._step(
                    environment, seen, {name: array[step] for name, array in columns.items()}, weights is None
                )
                ended += [(step, robot, success) for robot, success in over]
            last_values = self._policy.predict_values(self._tensors(environment, seen)).flatten().numpy().copy()
        following = None if weights is None else order.iteration + 1  # nobody goes on from where actions by chance led
        self._environments[order.slice] = following, environment, seen
        given = None if self._shared else columns
        return Rollout(order.slice, given, last_values, ended, environment.state(), time.perf_counter() - begun_s)

    def _environment_of(self, order: Order, rng: np.random.Generator) -> tuple[Environment, np.ndarray]:
        at, environment, seen = self._environments.get(order.slice, (None, None, None))
        if order.state is not None and at == order.iteration:
            assert environment is not None and seen is not None
            environment.draw_by(rng)
            return environment, seen
        environment = environment or Environment(self._practice, robots=self._robots, threads=self._threads)
        if order.state is None:
            return environment, environment.reset(rng)
        environment.draw_by(rng)
        return environment, environment.restore(order.state)

    def _columns(self, order: Order) -> dict[str, np.ndarray]:
        if self._shared is not None:
            first, whole = order.slice * self._robots, self._shared[order.iteration % len(self._shared)].arrays
            return {name: array[:, first : first + self._robots] for name, array in whole.items()}
        layout = layout_of_rollouts(self._recipe, self._robots)
        return {name: np.zeros(shape, kind) for name, (shape, kind) in layout.items()}

    def _step(
        self, environment: Environment, seen: np.ndarray, row: dict[str, np.ndarray], by_chance: bool
    ) -> tuple[np.ndarray, list[tuple[int, bool]]]:
        row[SEEN][:] = seen
        if PRIVILEGED in row:
            row[PRIVILEGED][:] = environment.privileged()
        if by_chance:
            action = _by_chance(self._action_space, self._robots)
        else:
            actions, values, log_probs = self._policy(self._tensors_of(row))
            action = actions.numpy()
            row["values"][:], row["log_probs"][:] = values.flatten().numpy(), log_probs.numpy()
        row["actions"][:] = action
        if isinstance(self._action_space, spaces.Box):
            action = np.clip(action, self._action_space.low, self._action_space.high)
        stepped = environment.step(action)
        row["rewards"][:], row["dones"][:], row["bootstrap"][:] = stepped.reward, False, 0.0
        return stepped.observation, self._ends(stepped, row)

    def _ends(self, stepped: Stepped, row: dict[str, np.ndarray]) -> list[tuple[int, bool]]:
        ended = stepped.ended
        if ended is None:
            return []
        row["dones"][ended.robots] = True
        goes_on = ~ended.diverged
        if goes_on.any():
            last = {SEEN: ended.observation[goes_on]}
            if PRIVILEGED in row:
                last[PRIVILEGED] = ended.privileged[goes_on]
            row["bootstrap"][ended.robots[goes_on]] = self._policy.predict_values(self._tensors_of(last)).flatten().numpy()
        return list(zip(ended.robots.tolist(), (ended.scores.success & goes_on).tolist(), strict=True))

    def _tensors(self, environment: Environment, seen: np.ndarray) -> Any:
        return self._tensors_of(
            {SEEN: seen, **({PRIVILEGED: environment.privileged()} if self._recipe.networks.privileged else {})}
        )

    def _tensors_of(self, parts: dict[str, np.ndarray]) -> Any:
        if PRIVILEGED not in parts:
            return torch.from_numpy(parts[SEEN])
        return {name: torch.from_numpy(parts[name]) for name in (SEEN, PRIVILEGED)}


def _by_chance(space: spaces.Space, robots: int) -> np.ndarray:
    if isinstance(space, spaces.Box):
        return torch.rand(robots, 9).sub_(0.5).numpy()
    return torch.randint(0, 11, (robots, 9)).numpy()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Torch's sums are in one order; what it was is so again, since the calling process may be the worker."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
