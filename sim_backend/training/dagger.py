"""Imitation of a published expert by DAgger (Ross et al., 2011): the student acts, the expert says what it would have done.

    python -m sim_backend.training.dagger TEACHER.safetensors --out FOLDER [--minutes 6] [--seed 1] [--physics real]

Writes ``push.safetensors``, ``push.json`` (the manifest) and ``push-record.json`` (settings, seeds, score). Needs torch, which
comes with the extra ``learning``. Runs on two CPU cores.
"""

import argparse
import itertools
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from scipy.stats import binomtest
from torch import nn

from api_schemas.policy import LAYOUTS, InputScaling, OutputScaling, PolicyManifest
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.episode import Episode
from sim_backend.evaluation import evaluate
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial, stack_goals, stack_starts
from sim_backend.training.randomization import draw_robots
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class Settings:
    """Everything that shapes a run, as kept in its record."""

    task: str = "push"
    seed: int = 1
    minutes: float = 12.0
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


MANIFEST = LAYOUTS["rrc2022-push"]


class Teacher:
    """The published expert: its scaling, its network and its torque limit, as its tensors give them."""

    def __init__(self, path: Path) -> None:
        self._w = {name: tensor.float() for name, tensor in load_file(path).items()}

    @torch.no_grad()
    def act(self, observation: torch.Tensor) -> torch.Tensor:
        """Torques (n, 9) in N m for observations (n, 54)."""
        w = self._w
        x = 2 * (observation - w["observation_low"]) / (w["observation_high"] - w["observation_low"]) - 1
        x = ((x - w["running_mean"]) / torch.sqrt(w["running_var"] + 1e-5)).clamp(-5, 5)
        layers = sum(name.endswith(".weight") for name in w)
        for index in range(layers):
            x = x @ w[f"layer{index}.weight"].T + w[f"layer{index}.bias"]
            if index < layers - 1:
                x = nn.functional.elu(x)
        return x.clamp(-1, 1) * w["torque_limit_nm"]


class Student(nn.Module):
    """A smaller network with the same inputs; its inputs are normalised by the first samples it has seen."""

    mean: torch.Tensor
    variance: torch.Tensor

    def __init__(self, inputs: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        sizes = (inputs, *hidden, 9)
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("variance", torch.ones(inputs))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions in units of the torque limit, before clipping."""
        x = ((observation - self.mean) / torch.sqrt(self.variance + 1e-5)).clamp(-5, 5)
        for layer in self.layers[:-1]:
            x = nn.functional.elu(layer(x))
        return self.layers[-1](x)

    @torch.no_grad()
    def act(self, observation: torch.Tensor) -> torch.Tensor:
        """Torques (n, 9), N m."""
        return self(observation).clamp(-1, 1) * c.MAX_TORQUE_NM


def begin(settings: Settings, physics: Physics, seeds: range) -> Episode:
    """Start one trial on each of n robots."""
    driver = SimulatedDriver(robots=physics.n, threads=2, physics_step_s=settings.physics_step_s, physics=physics)
    tracker = Tracker(physics_step_s=settings.physics_step_s, physics=physics)
    episode = Episode(driver, tracker, MANIFEST, physics_step_s=settings.physics_step_s)
    drawn = [draw_trial(TASKS[settings.task], seed) for seed in seeds]
    start = replace(stack_starts([start for start, _ in drawn]), noise_seed=np.array(seeds, dtype=float))
    episode.begin(start, stack_goals([goal for _, goal in drawn]))
    return episode


def train(settings: Settings, teacher: Teacher) -> tuple[Student, dict]:
    """DAgger until the time is over; returns the student and what the run did."""
    torch.manual_seed(settings.seed)
    rng = np.random.default_rng(settings.seed)
    ranges = load_ranges(settings.physics)
    student = Student(MANIFEST.observation_size, settings.hidden)
    optimizer = torch.optim.Adam(student.parameters(), lr=settings.learning_rate)
    seen = torch.empty((settings.largest_memory, MANIFEST.observation_size))
    wanted = torch.empty((settings.largest_memory, 9))
    count, first_seed, loss_value = 0, settings.seed * 1_000_000, float("nan")
    periods = TASKS[settings.task].steps // MANIFEST.period_steps
    started_s, limit_s, step = time.monotonic(), settings.minutes * 60, 0
    episode, expert_acts = None, np.zeros(settings.robots, dtype=bool)
    while (elapsed := (time.monotonic() - started_s) / limit_s) < 1:
        if episode is None or step % periods == 0:
            physics = draw_robots(ranges, rng, settings.robots)
            episode = begin(settings, physics, range(first_seed, first_seed + settings.robots))
            first_seed += settings.robots
            expert_acts = rng.random(settings.robots) < max(0.0, 1 - elapsed / settings.expert_share_until)
        observation = torch.from_numpy(episode.observe()).float()
        label = teacher.act(observation)
        rows = (count + np.arange(settings.robots)) % settings.largest_memory
        seen[rows], wanted[rows] = observation, label / c.MAX_TORQUE_NM
        count += settings.robots
        action = torch.where(torch.from_numpy(expert_acts)[:, None], label, student.act(observation))
        episode.advance(action.double().numpy())
        step += 1
        if step % periods == 0 and step <= periods:
            student.mean.copy_(seen[:count].mean(0))
            student.variance.copy_(seen[:count].var(0))
        if step % settings.steps_between_updates == 0:
            share = min(1.0, elapsed)
            rate = settings.learning_rate * (settings.final_learning_rate / settings.learning_rate) ** share
            optimizer.param_groups[0]["lr"] = rate
            for _ in range(settings.updates):
                batch = torch.from_numpy(rng.integers(min(count, settings.largest_memory), size=settings.batch))
                loss = nn.functional.mse_loss(student(seen[batch]), wanted[batch].clamp(-1, 1))
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                loss_value = loss.item()
        if step % (10 * periods) == 0:
            print(f"{elapsed:4.0%}  samples {count}  loss {loss_value:.4f}  expert acts {expert_acts.mean():.0%}", flush=True)
    return student, {"samples": count, "final_loss": loss_value, "wall_s": time.monotonic() - started_s}


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
