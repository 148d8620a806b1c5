"""A run of imitation from its recipe to a policy that the farm takes; ``train.py`` is the same for PPO."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import nn

from sim_backend.effects.physics import Physics
from sim_backend.environments.action_space import ActionSpace
from sim_backend.environments.environment import Environment
from sim_backend.environments.practice import Practice
from sim_backend.tasks import TASKS
from sim_backend.training import evaluating
from sim_backend.training.demonstrations.cloning import Cloning, read_demonstrations
from sim_backend.training.demonstrations.dagger import Dagger
from sim_backend.training.demonstrations.plain_policy import begin_with
from sim_backend.training.demonstrations.recipe import ImitationRecipe
from sim_backend.training.demonstrations.samples import Samples
from sim_backend.training.demonstrations.student import Student
from sim_backend.training.demonstrations.teacher import read_teacher
from sim_backend.training.evaluating import TELL_EVERY_S
from sim_backend.training.export import ExportedPolicy
from sim_backend.training.folder import CHECKPOINT
from sim_backend.training.randomization import draw_robots, ranges_to_train_on
from trial_logs.disk import put_in_place

_ANOTHER = 1_000_003


@dataclass
class ImitationRun:
    """A run in its folder. Owner of the student, of its optimiser and of what has been measured so far."""

    name: str
    recipe: ImitationRecipe
    folder: Path
    threads: int = 2
    tell: Callable[[str], None] = print
    seconds: float = 0.0  # before this start
    samples: int = 0
    starts: int = 1
    stopped: bool = False
    loss: float = float("nan")
    evaluations: list[dict] = field(default_factory=list)
    curve: list[dict] = field(default_factory=list)
    settings_before: list[dict] = field(default_factory=list)  # of earlier starts, where the recipe was another one

    def __post_init__(self) -> None:
        evaluating.check_robots(self.recipe)
        torch.manual_seed(self.recipe.seed)
        torch.set_num_threads(self.threads)
        practice = practice_of_recipe(self.recipe)
        self.student = Student(practice.manifest, self.recipe.student)
        if (start := self.recipe.warm_start) is not None:
            begin_with(start.policy, start.layout, practice, self.student.inputs, self.student.linear_layers)
        self._optimizer = torch.optim.Adam(self.student.parameters(), lr=self.recipe.imitation.learning_rate)
        self._begin(np.random.default_rng(self.recipe.seed))

    def _begin(self, rng: np.random.Generator) -> None:
        self._rng, settings, practice = rng, self.recipe.imitation, practice_of_recipe(self.recipe)
        student, size, windows = self.student, practice.manifest.observation_size, settings.largest_memory // settings.window
        if self.recipe.method == "cloning":
            recorded = [read_demonstrations(Path(each)) for each in self.recipe.demonstrations]
            self.source: Dagger | Cloning = Cloning(recorded, practice, settings, student)
        else:
            assert self.recipe.teacher is not None, "recipes of DAgger have one"
            environment = Environment(practice, robots=settings.robots, threads=self.threads)
            kept = Samples(max(1, windows), settings.window, size, student.parts, student.cells)
            self.source = Dagger(self.recipe, environment, read_teacher(self.recipe.teacher, environment), kept, rng)

    @property
    def done(self) -> float:
        """Share of the run that is over."""
        of_minutes = self.seconds / (60 * self.recipe.minutes) if self.recipe.minutes else 0.0
        return max(self.samples / self.recipe.samples, of_minutes)

    def learn(self) -> None:
        """Train until the samples or minutes of the recipe are over."""
        watch = _Watch(self)
        while self.done < 1 and not self.stopped:
            seen = self.source.advance(self.student, self.done)
            self.samples += len(seen)
            if self.samples <= self.recipe.imitation.freeze_inputs_after or self.student.inputs.count == 0:
                self.student.inputs.learn_scaling(seen)
            if self.recipe.method == "cloning" or self.source.samples.count >= self.recipe.imitation.least_memory:
                self._update()
            watch.look()

    def _update(self) -> None:
        """Some updates; the learning rate falls with the share of the run that is done."""
        settings = self.recipe.imitation
        first, last = settings.learning_rate, settings.final_learning_rate
        self._optimizer.param_groups[0]["lr"] = first * (last / first) ** min(1.0, self.done)
        for _ in range(settings.updates):
            seen, wanted, state = self.source.samples.draw(self._rng, settings.batch)
            loss = imitation_loss(self.student(seen, state)[0], wanted)
            self._optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.student.parameters(), settings.largest_gradient)
            self._optimizer.step()
            self.loss = loss.item()

    def stop(self) -> None:
        """End the training after the present window."""
        self.stopped = True

    def exported(self) -> ExportedPolicy:
        """The student as the farm takes it."""
        return self.student.exported(self.name)

    def finish(self) -> dict:
        """Write the policy, try it on fresh goals at 1 kHz, and write the record, which is returned."""
        return evaluating.finish(self)

    def record(self) -> dict:
        """What the run has done so far."""
        return {
            "recipe": self.name,
            "settings": self.recipe.model_dump(mode="json"),
            "samples": self.samples,
            "wall_s": round(self.seconds, 1),
            "starts": self.starts,
            "loss": self.loss,
            "curve": self.curve,
            "evaluations": self.evaluations,
            "settings_before": self.settings_before,
        }

    def keep(self) -> None:
        """Write the checkpoint; whatever happens there is a whole one."""
        state = {
            "student": self.student.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "settings": self.recipe.model_dump_json(),
            "run": [self.samples, self.seconds, self.starts, self.loss],
            "evaluations": json.dumps([self.evaluations, self.curve, self.settings_before]),
        }
        fresh = self.folder / (CHECKPOINT + ".new")
        torch.save(state, fresh)
        put_in_place(fresh, self.folder / CHECKPOINT)

    def go_on(self) -> None:
        """Take up the checkpoint; robots begin new trials, drawn from another seed, and the memory of samples fills anew."""
        state = torch.load(self.folder / CHECKPOINT, weights_only=True)
        self.student.load_state_dict(state["student"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.samples, self.seconds, starts, self.loss = state["run"]
        self.evaluations, self.curve, *before = json.loads(state["evaluations"])
        self.settings_before = before[0] if before else []
        if state["settings"] != self.recipe.model_dump_json():
            self.settings_before.append({"until_samples": self.samples} | json.loads(state["settings"]))
        self.starts = starts + 1
        self._begin(np.random.default_rng(self.recipe.seed + _ANOTHER * starts))


class _Watch:
    """Progress, evaluations and checkpoints. Owner of the clock of this start."""

    def __init__(self, run: ImitationRun) -> None:
        self._run = run
        self._begun_s = self._told_s = self._kept_s = self._counted_s = time.monotonic()
        self._samples_before = run.samples
        every = run.recipe.evaluation.every_samples
        self._due = (run.samples // every + 1) * every

    def look(self) -> None:
        """After each window."""
        run, now = self._run, time.monotonic()
        run.seconds, self._counted_s = run.seconds + now - self._counted_s, now
        if run.samples >= self._due:
            self._evaluate()
        if now - self._told_s >= TELL_EVERY_S or run.done >= 1:
            self._tell(now)
        if now - self._kept_s >= 60 * run.recipe.checkpoint_minutes:
            run.keep()
            self._kept_s = now

    def _evaluate(self) -> None:
        run = self._run
        self._due += run.recipe.evaluation.every_samples
        evaluating.evaluate(run, run.samples)

    def _tell(self, now: float) -> None:
        run, source = self._run, self._run.source
        rate = (run.samples - self._samples_before) / max(now - self._begun_s, 1e-9)
        success, taught = (float(np.mean(each)) if each else None for each in (source.successes, source.teacher_successes))
        run.curve.append(
            {"samples": run.samples, "wall_s": round(run.seconds, 1), "loss": run.loss, "success_rate": success}
            | {"teacher_success_rate": taught, "samples_per_s": round(rate)}
        )
        left_s = max(0.0, (run.recipe.samples - run.samples) / max(rate, 1e-9))
        if run.recipe.minutes is not None:
            left_s = min(left_s, max(0.0, 60 * run.recipe.minutes - run.seconds))
        reached, shown = ("–" if each is None else f"{each:.0%}" for each in (success, taught))
        line = f"{run.done:4.0%}  {run.samples:,} samples  {rate:,.0f}/s  {left_s / 60:.1f} min left"
        run.tell(f"{line}  success {reached} (teacher {shown})  loss {run.loss:.4f}")
        source.successes.clear()
        source.teacher_successes.clear()
        self._told_s = now


def imitation_loss(outputs: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Mean squared difference; outputs that go further than a wanted one at its end of [-1, 1] are clipped there and right."""
    return nn.functional.mse_loss(torch.where(wanted.abs() < 1.0, outputs, outputs.clamp(-1.0, 1.0)), wanted)


def practice_of_recipe(recipe: ImitationRecipe) -> Practice:
    """What the recipe lets robots practise."""
    acts, ranges = ActionSpace(recipe.action), ranges_to_train_on(recipe.physics_source)

    def draw(rng: np.random.Generator, robots: np.ndarray) -> Physics:
        return draw_robots(ranges, rng, len(robots), recipe.nominal_share)

    return Practice(
        TASKS[recipe.task],
        acts.manifest(recipe.manifest),
        acts,
        draw_physics=draw,
        episode_s=recipe.episode_s,
        physics_step_s=recipe.physics_step_s,
    )
