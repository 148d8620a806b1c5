"""Samples by DAgger (Ross et al., 2011): the student drives the robots, the teacher says what it would have done."""

import numpy as np
import torch

from sim_backend.environments.environment import Environment
from sim_backend.training.demonstrations.recipe import ImitationRecipe
from sim_backend.training.demonstrations.samples import Samples
from sim_backend.training.demonstrations.student import Student
from sim_backend.training.demonstrations.teacher import Teacher


class Dagger:
    """Robots that the student drives, and in some trials at first the teacher. Owner of the robots and of what was seen.

    Args:
        recipe: what is practised.
        environment: the robots.
        teacher: watches them.
        samples: where it is kept what was seen.
        rng: draws everything.
    """

    def __init__(
        self, recipe: ImitationRecipe, environment: Environment, teacher: Teacher, samples: Samples, rng: np.random.Generator
    ) -> None:
        assert recipe.teacher is not None, "recipes of DAgger have one"
        self._environment, self._teacher, self.samples, self._rng = environment, teacher, samples, rng
        self._window, self._acts_until = recipe.imitation.window, recipe.teacher.acts_until
        self._observation: np.ndarray | None = None
        self.successes: list[bool] = []  # of the student
        self.teacher_successes: list[bool] = []

    def advance(self, student: Student, done: float) -> torch.Tensor:
        """A window of control periods; returns what was seen in it, shape (samples, size)."""
        if self._observation is None:
            self._begin(student, done)
        assert self._observation is not None
        n = self._environment.robots
        seen, wanted = torch.empty((self._window, n, self._observation.shape[1])), torch.empty((self._window, n, 9))
        before, whole = self._state.clone(), np.ones(n, dtype=bool)
        for step in range(self._window):
            labels = self._teacher.outputs()
            outputs, self._state = student.act(self._observation, self._state)
            seen[step], wanted[step] = torch.from_numpy(self._observation), torch.from_numpy(labels)
            stepped = self._environment.step(np.where(self._teacher_acts[:, None], labels, outputs))
            self._observation = stepped.observation
            if stepped.ended is not None:
                over = stepped.ended.robots
                whole[over] &= step == self._window - 1
                success, taught = stepped.ended.scores.success & ~stepped.ended.diverged, self._teacher_acts[over]
                self.successes += success[~taught].tolist()
                self.teacher_successes += success[taught].tolist()
                self._state[:, over] = 0.0
                self._teacher.forget(over)
                self._teacher_acts[over] = self._rng.random(len(over)) < self._teacher_share(done)
        self.samples.add(seen[:, whole], wanted[:, whole], before[:, whole])
        return seen.flatten(0, 1)

    def _begin(self, student: Student, done: float) -> None:
        robots = self._environment.robots
        self._observation, self._state = self._environment.reset(self._rng), student.nothing(robots)
        self._teacher_acts = self._rng.random(robots) < self._teacher_share(done)

    def _teacher_share(self, done: float) -> float:
        return max(0.0, 1.0 - done / self._acts_until) if self._acts_until else 0.0
