"""The callback of stable-baselines3 that tries a policy on a farm while it is trained."""

from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from api_schemas.job import TaskName
from trifarm.callbacks import Evaluated, Evaluations

__all__ = ["EvaluateOnFarm"]


class EvaluateOnFarm(BaseCallback):
    """Tries the policy on a farm every so many steps, while the training goes on.

    Results are recorded as ``farm/success_rate``, ``farm/low_80``, ``farm/high_80``, ``farm/trials`` and ``farm/of_step``, the
    step that they are of. One evaluation goes on at a time; one whose turn comes meanwhile is left out. ``found`` are
    those that are over.

    Args:
        task: what is asked of the robots.
        every: steps between evaluations.
        env: the environment; by default the training's.
        timeout_s: how long the training's end waits for the last; afterwards the job is cancelled.
        verbose: as for every callback.
        **asked: as for ``evaluate``, such as ``trials``, ``seed``, ``until_known`` or ``farm``.

    Example:
        >>> import trifarm
        >>> def learn(model):
        ...     callback = trifarm.EvaluateOnFarm("push", every=100_000, trials=20, seed=1)
        ...     model.learn(1_000_000, callback=callback)
        ...     return [(each.step, each.report.success_rate) for each in callback.found if each.report]
    """

    def __init__(
        self,
        task: TaskName | str,
        *,
        every: int,
        env: Any = None,
        timeout_s: float | None = None,
        verbose: int = 0,
        **asked: Any,
    ) -> None:
        super().__init__(verbose)
        self._evaluations, self._env, self._timeout_s = Evaluations(task, every, asked), env, timeout_s

    @property
    def found(self) -> list[Evaluated]:
        """What the farm has said so far."""
        return self._evaluations.found

    def _on_training_start(self) -> None:
        self._evaluations.begin_at(self.num_timesteps)

    def _on_step(self) -> bool:
        env = self.training_env if self._env is None else self._env
        self._evaluations.look(self.num_timesteps, self.model, env, self.logger.record)
        return True

    def _on_training_end(self) -> None:
        self._evaluations.finish(self.logger.record, self._timeout_s)
        self.logger.dump(self.num_timesteps)
