"""What happens between the iterations of a run: progress, evaluations, checkpoints, levels, and the scaling of the inputs."""

import time
from typing import TYPE_CHECKING

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from sim_backend.training import evaluating
from sim_backend.training.actor_critic import whole_of

if TYPE_CHECKING:
    from sim_backend.training.train import Run

LEVEL_TRIALS = 200
"""Trials over which the success rate is taken that ends a level."""


class Watch(BaseCallback):
    """Called by PPO; owner of the clock of this start and of the outcomes since the last line of progress."""

    def __init__(self, run: "Run") -> None:
        super().__init__()
        self._run = run
        self._begun_s = self._told_s = self._kept_s = self._counted_s = time.monotonic()
        self._samples_before: int | None = None
        self._learned_from = run.model.num_timesteps  # samples that updates have used
        self._successes: list[bool] = []
        self._returns: list[float] = []
        self._recent: list[bool] = []
        every = run.recipe.evaluation.every_samples
        self._due = (run.model.num_timesteps // every + 1) * every
        self._board = _board(run)

    def _on_rollout_start(self) -> None:
        """The last iteration's observations go into the scaling, after the updates that were made with the old one."""
        run = self._run
        if self._samples_before is None:
            self._samples_before = run.model.num_timesteps
        elif run.slices is None:
            self.updated()
        self._learned_from = run.model.num_timesteps

    def _learn_scaling(self) -> None:
        if not self._run.knows_inputs:
            self._run.policy.features_extractor.learn_scaling(_seen(self._observations))

    def updated(self) -> None:
        """After the updates of an iteration: whatever is kept now has no sample twice and none too few."""
        self._learn_scaling()
        self._keep(time.monotonic())

    def count(self, success: list[bool], returns: list[float]) -> None:
        """Trials that ended in slices."""
        self._successes += success
        self._returns += returns

    def _on_step(self) -> bool:
        ended, run = self._run.robots.ended, self._run
        if ended is not None:
            success = ended.scores.success & ~ended.diverged
            self._successes += success.tolist()
            self._recent = (self._recent + success.tolist())[-LEVEL_TRIALS:]
            self._returns += [self.locals["infos"][robot]["episode"]["r"] for robot in ended.robots]
            run.randomizer.told(ended.robots, success)
        minutes = run.recipe.minutes
        goes_on = not run.stopped and (minutes is None or run.seconds < 60 * minutes)
        if not goes_on:
            run.model.num_timesteps = self._learned_from  # nobody learns from what was seen of this iteration
        return goes_on

    def _on_rollout_end(self) -> None:
        run, now = self._run, time.monotonic()
        run.iterations += 1
        self._observations = self.model.rollout_buffer.observations  # type: ignore[attr-defined]  # it empties itself before the next
        run.seconds, self._counted_s = run.seconds + now - self._counted_s, now
        if run.model.num_timesteps >= self._due:
            self._evaluate()
        self._go_up()
        if now - self._told_s >= evaluating.TELL_EVERY_S or run.model.num_timesteps >= run.recipe.samples:
            self._tell(now)

    def _keep(self, now: float) -> None:
        if now - self._kept_s >= 60 * self._run.recipe.checkpoint_minutes:
            self._run.keep()
            self._kept_s = now

    def _evaluate(self) -> None:
        run = self._run
        self._due += run.recipe.evaluation.every_samples
        for tried in evaluating.evaluate(run, run.model.num_timesteps):
            self._write({f"success/{tried.physics}": tried.success_rate})

    def _go_up(self) -> None:
        """The next level, once this one's success rate is reached."""
        run, levels = self._run, self._run.recipe.curriculum
        if run.level >= len(levels) or len(self._recent) < LEVEL_TRIALS or np.mean(self._recent) < levels[run.level].until:
            return
        run.set_level(run.level + 1)
        self._recent = []
        task = run.robots.environment.practice.task.name
        run.tell(f"level {run.level + 1}: {task}")
        model = run.model
        model._last_obs = run.returns.reset()  # type: ignore[assignment]
        model._last_episode_starts = np.ones(run.robots.num_envs, dtype=bool)

    def _tell(self, now: float) -> None:
        run, samples = self._run, self._run.model.num_timesteps
        rate = (samples - (self._samples_before or 0)) / max(now - self._begun_s, 1e-9)
        point = {
            "samples": samples,
            "wall_s": round(run.seconds, 1),
            "samples_per_s": round(rate),
            "success_rate": float(np.mean(self._successes)) if self._successes else None,
            "return": float(np.mean(self._returns)) if self._returns else None,
            "deviation": float(run.policy.log_std.detach().exp().mean()) if hasattr(run.policy, "log_std") else None,
            **self._of_last_update(),
        } | run.randomizer.curve()
        run.curve.append(point)
        self._write({f"train/{name}": value for name, value in point.items() if value is not None and name != "samples"})
        left_s = max(0.0, (run.recipe.samples - samples) / max(rate, 1e-9))
        if run.recipe.minutes is not None:
            left_s = min(left_s, max(0.0, 60 * run.recipe.minutes - run.seconds))
        success = "–" if point["success_rate"] is None else f"{point['success_rate']:.0%}"
        run.tell(
            f"{samples / run.recipe.samples:4.0%}  {samples:,} samples  {rate:,.0f}/s  {left_s / 60:.1f} min left  "
            f"success {success}  return {point['return'] or 0.0:.3f}"
        )
        self._successes, self._returns, self._told_s = [], [], now

    def _of_last_update(self) -> dict[str, float | None]:
        """How much of the returns' variance the critic explains, and how far the last update moved the actor."""
        found = self.model.logger.name_to_value
        return {name: _number(found.get(f"train/{name}")) for name in ("explained_variance", "approx_kl")}

    def _write(self, values: dict[str, float]) -> None:
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, self._run.model.num_timesteps)


def _number(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else round(float(value), 4)


def _seen(observations) -> torch.Tensor:
    """What was seen in an iteration, one row for each robot and step."""
    if isinstance(observations, dict):
        return whole_of({name: _seen(part) for name, part in observations.items()})
    return torch.from_numpy(observations.reshape(-1, observations.shape[-1]))


def _board(run: "Run"):
    """TensorBoard's writer, if it is installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(run.folder / "tensorboard"))
