"""Imitation of a published expert by DAgger (Ross et al., 2011): the student acts, the expert says what it would have done.

    python -m sim_backend.training.dagger TEACHER.safetensors --out FOLDER [--minutes 12] [--seed 1] [--physics real]

Writes ``push.safetensors``, ``push.json`` (the manifest) and ``push-record.json`` (settings, seeds, score). Needs torch, which
comes with the extra ``learning``. Runs on two CPU cores.
"""

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from scipy.stats import binomtest
from torch import nn

from api_schemas.policy import LAYOUTS, InputScaling, OutputScaling, PolicyManifest
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.episode import Episode
from sim_backend.evaluation import begin_trials, evaluate
from sim_backend.tasks import TASKS
from sim_backend.training.networks import Student, Teacher
from sim_backend.training.randomization import draw_robots
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class Settings:
    """Everything that shapes a run, as kept in its record."""

    task: str = "push"
    seed: int = 1
    minutes: float = 12.0
    steps: int | None = None  # control periods to train for instead of minutes; the same seed then gives the same student
    physics: str = "real"  # ranges that the robots trained on are drawn from, anew for each episode
    robots: int = 128
    physics_step_s: float = 0.004
    hidden: tuple[int, ...] = (256, 256)
    steps_between_updates: int = 10
    updates: int = 4
    batch: int = 1024
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-5
    expert_share_until: float = 0.2  # of the run, falling linearly from 1 to 0
    largest_memory: int = 2_000_000  # samples
    evaluation_seed: int = 10_000_000
    evaluation_trials: int = 200

    def done(self, steps: int, elapsed_s: float) -> float:
        """Share of the run that is over after this many control periods and this time, s."""
        return elapsed_s / (60 * self.minutes) if self.steps is None else steps / self.steps


MANIFEST = LAYOUTS["rrc2022-push"]


class Memory:
    """What was seen and what the teacher would have done there. Owner of the samples; the oldest give way to new ones."""

    def __init__(self, settings: Settings) -> None:
        self._seen = torch.empty((settings.largest_memory, MANIFEST.observation_size))
        self._wanted = torch.empty((settings.largest_memory, 9))
        self.count = 0

    def add(self, observation: torch.Tensor, torque_nm: torch.Tensor) -> None:
        """Observations (n, size) and the teacher's torques (n, 9), N m."""
        rows = (self.count + np.arange(len(observation))) % len(self._seen)
        self._seen[rows], self._wanted[rows] = observation, torque_nm / c.MAX_TORQUE_NM
        self.count += len(observation)

    def draw(self, rng: np.random.Generator, size: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Some samples: observations (size, ...) and actions (size, 9) in units of the torque limit."""
        rows = torch.from_numpy(rng.integers(len(self._kept), size=size))
        return self._seen[rows], self._wanted[rows].clamp(-1, 1)

    def scaling(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and variance of each input."""
        return self._kept.mean(0), self._kept.var(0)

    @property
    def _kept(self) -> torch.Tensor:
        return self._seen[: self.count]


class Learner:
    """The student and its optimiser. Owner of both."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.student = Student(MANIFEST.observation_size, settings.hidden)
        self._optimizer = torch.optim.Adam(self.student.parameters(), lr=settings.learning_rate)
        self.loss = float("nan")

    def learn(self, memory: Memory, rng: np.random.Generator, done: float) -> None:
        """Some updates; the learning rate falls with the share of the run that is done."""
        first, last = self._settings.learning_rate, self._settings.final_learning_rate
        self._optimizer.param_groups[0]["lr"] = first * (last / first) ** min(1.0, done)
        for _ in range(self._settings.updates):
            observation, wanted = memory.draw(rng, self._settings.batch)
            loss = nn.functional.mse_loss(self.student(observation), wanted)
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()
            self.loss = loss.item()


class Practice:
    """Trials one after the other on robots that were never seen before; in some of them the teacher acts."""

    def __init__(self, settings: Settings, teacher: Teacher, rng: np.random.Generator) -> None:
        self._settings, self._teacher, self._rng = settings, teacher, rng
        self._ranges = load_ranges(settings.physics)
        self._first_seed = settings.seed * 1_000_000
        self.teacher_acts = np.zeros(settings.robots, dtype=bool)

    def begin(self, done: float) -> None:
        """New robots and goals; the teacher acts the less often, the more of the run is done."""
        robots = self._settings.robots
        seeds = range(self._first_seed, self._first_seed + robots)
        self._episode = begin(self._settings, draw_robots(self._ranges, self._rng, robots), seeds)
        self._first_seed += robots
        self.teacher_acts = self._rng.random(robots) < max(0.0, 1 - done / self._settings.expert_share_until)

    def advance(self, student: Student) -> tuple[torch.Tensor, torch.Tensor]:
        """One control period; returns what was seen in it and what the teacher would have done."""
        observation = torch.from_numpy(self._episode.observe()).float()
        wanted = self._teacher.act(observation)
        action = torch.where(torch.from_numpy(self.teacher_acts)[:, None], wanted, student.act(observation))
        self._episode.advance(action.double().numpy())
        return observation, wanted


def begin(settings: Settings, physics: Physics, seeds: range) -> Episode:
    """Start one trial on each of n robots."""
    return begin_trials(MANIFEST, TASKS[settings.task], seeds, physics=physics, physics_step_s=settings.physics_step_s)[0]


def train(settings: Settings, teacher: Teacher) -> tuple[Student, dict]:
    """DAgger until the time is over, or for as many steps as are set; returns the student and what the run did."""
    torch.manual_seed(settings.seed)
    rng, started_s = np.random.default_rng(settings.seed), time.monotonic()
    practice, learner, memory = Practice(settings, teacher, rng), Learner(settings), Memory(settings)
    periods, step, done = TASKS[settings.task].steps // MANIFEST.period_steps, 0, 0.0
    while done < 1:
        if step % periods == 0:
            practice.begin(done)
        memory.add(*practice.advance(learner.student))
        step += 1
        if step == periods:
            learner.student.normalise(*memory.scaling())
        if step % settings.steps_between_updates == 0:
            learner.learn(memory, rng, done)
        if step % (10 * periods) == 0:
            acts = practice.teacher_acts.mean()
            print(f"{done:4.0%}  samples {memory.count}  loss {learner.loss:.4f}  teacher acts {acts:.0%}", flush=True)
        done = settings.done(step, time.monotonic() - started_s)
    return learner.student, {"samples": memory.count, "final_loss": learner.loss, "wall_s": time.monotonic() - started_s}


def measured(settings: Settings, actor: Student | Teacher, physics: str) -> dict:
    """Success at the end on fresh seeds and fresh robots, with physics at 1 kHz."""
    trials, first = settings.evaluation_trials, settings.evaluation_seed
    robots = draw_robots(load_ranges(physics), np.random.default_rng(first), trials)
    seeds = range(first, first + trials)

    def act(observation: np.ndarray) -> np.ndarray:
        return actor.act(torch.from_numpy(observation)).numpy()

    success = evaluate(act, MANIFEST, TASKS[settings.task], seeds, physics=robots).success
    interval = binomtest(int(success.sum()), trials).proportion_ci(0.95, method="wilson")
    return {
        "physics": physics,
        "trials": trials,
        "first_seed": first,
        "successes": int(success.sum()),
        "success_rate": float(success.mean()),
        "interval_95": [float(interval.low), float(interval.high)],
    }


def export(student: Student, folder: Path, name: str) -> PolicyManifest:
    """Write weights and manifest in the form that the farm accepts."""
    tensors = {f"layer{i}.{kind}": getattr(layer, kind) for i, layer in enumerate(student.layers) for kind in ("weight", "bias")}
    tensors |= {
        "running_mean": student.mean,
        "running_var": student.variance,
        "torque_limit_nm": torch.full((9,), c.MAX_TORQUE_NM),
    }
    save_file({key: value.detach().contiguous().float() for key, value in tensors.items()}, folder / f"{name}.safetensors")
    manifest = MANIFEST.model_copy(
        update={
            "name": f"reference-{name}",
            "input_scaling": InputScaling(clip=5.0),
            "output_scaling": OutputScaling(clip=1.0),
        }
    )
    (folder / f"{name}.json").write_text(manifest.model_dump_json(indent=2) + "\n")
    return manifest


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Imitate a published expert by DAgger.")
    parser.add_argument("teacher", type=Path, help="safetensors of the published push expert")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=Settings.minutes)
    parser.add_argument("--seed", type=int, default=Settings.seed)
    parser.add_argument("--physics", default=Settings.physics, help="robots to train on: a preset or a TOML file of ranges")
    options = parser.parse_args()
    torch.set_num_threads(1)  # a second one waits for work by spinning, on the core that the physics needs
    settings, teacher = Settings(minutes=options.minutes, seed=options.seed, physics=options.physics), Teacher(options.teacher)
    student, run = train(settings, teacher)
    options.out.mkdir(parents=True, exist_ok=True)
    export(student, options.out, settings.task)
    record = {
        "method": "DAgger; teacher: push expert of Gürtler et al., ICLR 2023 (rr-learning/trifinger-rl-example, BSD-3-Clause)",
        "settings": asdict(settings),
        "run": run,
        "student": [measured(settings, student, physics) for physics in ("nominal", "real")],
        "teacher_same_trials": [measured(settings, teacher, physics) for physics in ("nominal", "real")],
    }
    (options.out / f"{settings.task}-record.json").write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n")
    print(json.dumps({key: record[key] for key in ("student", "teacher_same_trials")}, indent=2))


if __name__ == "__main__":
    main()
