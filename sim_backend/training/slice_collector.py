"""Rollouts of all slices of an iteration, by workers: now, or while the learner is busy with the iteration before.

With a lag of 1 the orders of an iteration go out before the updates of the one before, with the networks as they are then, and
there are two sets of columns, since workers fill one while the learner reads the other. What comes back is the same bits for any
number of workers: which networks rolled out which iteration hangs on no clock.
"""

import functools
import time
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_backend.training.recipe import Recipe
from sim_backend.training.rollouts import Order, Rollout, RolloutWorker, SharedColumns, layout_of_rollouts
from sim_backend.workers.pool import Workers, open_workers

Weights = dict[str, np.ndarray]


@dataclass(frozen=True)
class Collected:
    """An iteration of all slices, in their order. ``lost`` are places of slices whose workers were lost, one for each loss."""

    columns: dict[str, np.ndarray]
    rollouts: list[Rollout]
    lost: list[int]
    waited_s: float
    moved_bytes: int


class SliceCollector(AbstractContextManager["SliceCollector"]):
    """Owner of the workers, of the columns that they fill, and of the slices' states between iterations.

    Args:
        recipe: of the run.
        workers: how many; 0 for the calling process, which rolls out when it is asked for the result.
        cluster: as for ``open_workers``.
        threads: of all workers together.
    """

    def __init__(self, recipe: Recipe, workers: int, cluster: str | None, threads: int) -> None:
        self._recipe, self._count, self._cluster = recipe, workers, cluster
        self._threads = max(1, threads // max(1, workers))
        self._sides = recipe.ppo.lag + 1
        self.states: list[dict | None] = [None] * recipe.ppo.slices
        self.under_way: tuple[int, Weights | None] | None = None
        self._result: Future[tuple[list[Rollout], list[int]]] | None = None
        self._moved_bytes = 0
        self.shared_bytes_per_sample = 0.0

    def __enter__(self) -> "SliceCollector":
        """Begin the workers."""
        layout = layout_of_rollouts(self._recipe, self._recipe.ppo.robots)
        shared = tuple(SharedColumns(layout) for _ in range(self._sides)) if self._cluster is None else None
        if shared is not None:
            self._columns = [each.arrays for each in shared]
            self.shared_bytes_per_sample = shared[0].nbytes / shared[0].arrays["dones"].size
        else:
            self._columns = [{name: np.zeros(*each) for name, each in layout.items()} for _ in range(self._sides)]
        make = functools.partial(RolloutWorker, self._recipe, self._recipe.ppo.slices, self._threads, shared)
        self._opened = open_workers(make, self._count, self._cluster)
        self.workers: Workers | None = self._opened.__enter__()
        self._thread = ThreadPoolExecutor(1, "collector")
        return self

    def __exit__(self, *failed: Any) -> None:
        """End the workers, once they have done what is under way, which is thrown away."""
        self._thread.shutdown()
        self.workers = None
        self._opened.__exit__(*failed)

    def start(self, iteration: int, weights: Weights | None) -> None:
        """Give the orders of an iteration out; ``weights`` are not changed until its end."""
        assert self.under_way is None, "one iteration at a time"
        self.under_way = iteration, weights
        if self._count or self._cluster:
            self._result = self._thread.submit(self._rolled_out, iteration, weights)

    def finish(self) -> Collected:
        """The iteration that is under way, once all of it is there.

        Raises:
            WorkersError: as for ``Workers.map``.
        """
        assert self.under_way is not None and self.workers is not None
        begun_s, (iteration, weights) = time.perf_counter(), self.under_way
        rollouts, lost = self._result.result() if self._result else self._rolled_out(iteration, weights)
        self.under_way = self._result = None
        columns, robots = self._columns[iteration % self._sides], self._recipe.ppo.robots // self._recipe.ppo.slices
        moved, self._moved_bytes = self.workers.moved_bytes - self._moved_bytes, self.workers.moved_bytes
        for rollout in rollouts:
            for name, values in (rollout.columns or {}).items():
                columns[name][:, rollout.slice * robots : (rollout.slice + 1) * robots] = values
        self.states = [rollout.state for rollout in rollouts]
        return Collected(columns, rollouts, lost, time.perf_counter() - begun_s, moved)

    def _rolled_out(self, iteration: int, weights: Weights | None) -> tuple[list[Rollout], list[int]]:
        assert self.workers is not None, "workers are there within the 'with' only"
        orders = [Order(part, iteration, state) for part, state in enumerate(self.states)]
        return list(self.workers.map(orders, weights)), list(self.workers.lost)
