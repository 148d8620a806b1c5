"""What a step, a trial, a job, a robot and a sample of training cost on this machine: ``make bench``.

    python -m tests.benchmarks.bench [--out FILE] [--keep] [--parts bare full farm memory training] [--quick]

Parts: ``bare``, physics alone; ``full``, the full path on one core against it; ``farm``, from submission to report of a 40-trial
push job on a nominal farm of 4 robots, against what all cores could do by the rate of the full path in the same run; ``memory``,
what a robot takes of it; ``training``, samples per second of one core. The table has what is wanted beside each figure, and what
was kept last of a machine of the same kind (``results/bench/KIND.json``), which ``--keep`` writes. Microseconds are the
processor's; the farm's time is the clock's, as is the rate that it is compared with. Ends with 1 if a figure is not as wanted.
"""

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from tests.benchmarks import machine
from tests.benchmarks.against import measured
from tests.benchmarks.full_path import REFERENCE, TRIAL_S
from tests.benchmarks.robots_of_a_host import cost
from tests.end_to_end.farm import Farm

ROOT = Path(__file__).resolve().parent.parent.parent
KEPT = ROOT / "results" / "bench"
PARTS = ("bare", "full", "farm", "memory", "training")
SMALL_PPO = {"robots": 16, "steps": 4, "minibatch": 64}


@dataclass(frozen=True)
class Figure:
    """How a figure is shown; ``least`` and ``most`` are what is wanted of it, None where nothing is."""

    title: str
    digits: int = 2
    least: float | None = None
    most: float | None = None

    def holds(self, value: float) -> bool:
        """Whether it is as wanted."""
        return (self.least is None or value >= self.least) and (self.most is None or value <= self.most)

    def wanted(self) -> str:
        """What is wanted, in words."""
        return f">= {self.least:g}" if self.least is not None else f"<= {self.most:g}" if self.most is not None else ""


FIGURES = {
    "bare_held_us": Figure("bare step, fingers held, us"),
    "bare_push_us": Figure("bare step, push trial, us"),
    "full_nominal_us": Figure("full path, nominal, us a step"),
    "full_nominal_ratio": Figure("  rate as a share of bare", least=0.65),
    "full_real_us": Figure("full path, real, us a step"),
    "full_real_ratio": Figure("  rate as a share of bare", least=0.55),
    "farm_s": Figure("40 trials from submit to report, s", 1),
    "farm_factor": Figure("  times all cores' ideal", most=1.15),
    "robot_pss_mb": Figure("memory of a robot (PSS), MB", 1, most=100.0),
    "training_samples_per_s": Figure("training, samples/s of a core", 0),
}


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    trials: int = 8
    jobs: int = 3
    robots_held: int = 16
    job_trials: int = 40
    iterations: int = 4
    idle_s: float = 1.0
    ppo: dict[str, int] | None = None


QUICK = Size(trials=1, jobs=1, robots_held=2, job_trials=4, iterations=1, idle_s=0.1, ppo=SMALL_PPO)


def bare(size: Size, core: int) -> dict[str, float]:
    """Physics alone."""
    found = measured(ROOT, "bare", core, count=min(size.trials, 4))
    return {"bare_held_us": found["held"]["cpu"], "bare_push_us": found["push"]["cpu"]}


def full(size: Size, core: int) -> dict[str, float]:
    """The full path on one core, and physics alone over the same trials."""
    figures = {}
    for physics in ("nominal", "real"):
        found = measured(ROOT, physics, core, count=size.trials)
        path_us, alone_us = found["full"]["cpu"], found["alone"]["cpu"]
        figures |= {f"full_{physics}_us": path_us, f"full_{physics}_ratio": alone_us / path_us}
    return figures


def farm(size: Size) -> dict[str, float]:
    """Jobs on a farm, policy processes and all; the ideal is the full path's rate on every core."""
    before, times_s = _rate(size.trials), []
    with tempfile.TemporaryDirectory() as name, Farm(Path(name), robots=4) as running:
        for index in range(size.jobs):
            started_s = time.perf_counter()
            job = running.submit(REFERENCE, trials=size.job_trials, seed=100 + index, wait=True)
            times_s.append(time.perf_counter() - started_s)
            report = running.report(job)
            assert report["trials"] == size.job_trials, report
    rate = median([before, _rate(size.trials)])
    ideal_s = size.job_trials * TRIAL_S / (machine.cores() * rate)
    return {"farm_s": median(times_s), "farm_factor": median(times_s) / ideal_s}


def memory(size: Size) -> dict[str, float]:
    """What each of some idle robots takes."""
    if os.getuid() != 0:
        print("memory: left out, since nobody but root may look into a robot")
        return {}
    return {"robot_pss_mb": cost(size.robots_held, "nominal", size.idle_s).robot_pss_mb}


def training(size: Size, core: int) -> dict[str, float]:
    """PPO with the recipe ``push``."""
    if importlib.util.find_spec("torch") is None:
        print("training: left out, since torch is not installed (the extra 'learning')")
        return {}
    recipe = measured(ROOT, "recipe", core)
    recipe["ppo"] |= size.ppo or {}
    sample = measured(ROOT, "training", core, count=size.iterations, recipe=json.dumps(recipe))
    return {"training_samples_per_s": 1e6 / sample["sample"]["cpu"]}


def _rate(trials: int) -> float:
    """Simulated seconds per second by the clock, on one core, from a process of its own."""
    command = [sys.executable, str(Path(__file__).with_name("full_path.py")), "--trials", str(trials)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)["full_path_rate"]


def table(figures: dict[str, float], kept: dict[str, float]) -> str:
    """One line a figure: now, wanted, and kept with the change since."""
    lines = [f"{'':36s} {'now':>10s} {'wanted':>9s} {'kept':>10s} {'change':>7s}"]
    for name, value in figures.items():
        shown, before = FIGURES[name], kept.get(name)
        since = "" if before is None else f"{before:10.{shown.digits}f} {100 * (value / before - 1):+6.0f}%"
        missed = "" if shown.holds(value) else "   not as wanted"
        lines.append(f"{shown.title:36s} {value:10.{shown.digits}f} {shown.wanted():>9s} {since}{missed}".rstrip())
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, compare, keep."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.bench", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--quick", action="store_true", help="a few seconds for each part; says that it works and no more")
    parser.add_argument("--out", type=Path, help="also write the figures as JSON")
    parser.add_argument("--keep", action="store_true", help="keep the figures for later runs to compare with")
    asked = parser.parse_args(arguments)
    if asked.quick and asked.keep:
        parser.error("--quick measures too little to be kept")
    size, core = QUICK if asked.quick else Size(), max(os.sched_getaffinity(0))
    parts = {
        "bare": lambda: bare(size, core),
        "full": lambda: full(size, core),
        "farm": lambda: farm(size),
        "memory": lambda: memory(size),
        "training": lambda: training(size, core),
    }
    load = round(os.getloadavg()[0], 1)
    figures: dict[str, float] = {}
    for part in PARTS:
        if part in asked.parts:
            figures |= parts[part]()
    place = KEPT / f"{machine.kind()}.json"
    kept = json.loads(place.read_text())["figures"] if place.exists() else {}
    print(f"{machine.cpu_model()}, {machine.cores()} cores, load {load} before", table(figures, kept), sep="\n")
    if not kept:
        print(f"nothing is kept of machines of this kind; --keep writes results/bench/{place.name}")
    found = {"cpu": machine.cpu_model(), "cores": machine.cores(), "load_before": load, "figures": figures}
    if asked.out:
        asked.out.write_text(json.dumps(found, indent=2) + "\n")
    if asked.keep:
        place.parent.mkdir(exist_ok=True)
        place.write_text(json.dumps(found | {"figures": kept | figures}, indent=2) + "\n")
    return 0 if asked.quick or all(FIGURES[name].holds(value) for name, value in figures.items()) else 1


if __name__ == "__main__":
    sys.exit(main())
