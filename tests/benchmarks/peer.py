"""The published experts in the published simulation and on our full path, in turns: ``python -m tests.benchmarks.peer``.

    python -m tests.benchmarks.peer [--episodes 10] [--tasks push lift] [--out FILE]

The published simulation (PyBullet, 1 kHz, ``trifinger-rl-datasets``) gets an environment of its own, which is made once in the
user's cache. Our side is a nominal robot with the expert in its jailed process, safety, tracker and 1 kHz log. Each episode has a
process of its own, all on one core; counted is the processor's time, of the policy's process, too, without what comes before an
episode. Goals are drawn by each side for itself. Says why and ends with 0 where the environment or the experts cannot be had.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
import safetensors.numpy

from api_schemas.job import TaskName
from api_schemas.policy import LAYOUTS
from api_schemas.robot import Lease
from api_schemas.trial import OutcomeKind
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import prepare_plainly
from robot_farm.trial import log_channels, run_trial
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.tasks import TASKS
from tests.benchmarks import machine, own_environment
from tests.benchmarks.in_checkout import Clocks, live_as_robots

ROOT = Path(__file__).resolve().parent.parent.parent
EXPERTS = ROOT.parent / "shared/data/policies"
PACKAGES = ("trifinger-rl-datasets==1.0.3", "pybullet==3.2.7")
PYTHON = own_environment.python_of("peer")
WANTED = {"push": 16.0, "lift": 13.0}
PERIOD_S = 0.02
FIRST_SEED = 600


def missing(experts: Path, *, make: bool = True) -> str | None:
    """Why the published simulation cannot be run here; None if it can. Makes its environment where there is none.

    Args:
        experts: the folder with their weights.
        make: False looks only.
    """
    if not experts.is_dir():
        return f"the published experts are not in {experts}; give their folder by --experts"
    if not make and own_environment.missing("peer", PACKAGES, make=False):
        return "the published simulation is not installed; 'python -m tests.benchmarks.peer' installs it"
    return own_environment.missing("peer", PACKAGES)


def theirs(task: str, asked: argparse.Namespace, seed: int) -> dict:
    """An episode in the published simulation; see ``peer_episode``."""
    steps = asked.steps or round(TASKS[task].steps * 0.001 / PERIOD_S) - 1  # its reset makes the first one
    with tempfile.TemporaryDirectory() as folder:
        weights = Path(folder) / "expert.npz"
        tensors: dict = safetensors.numpy.load_file(asked.experts / f"{task}_expert.safetensors")
        np.savez(weights, **tensors)
        program = str(Path(__file__).with_name("peer_episode.py"))
        command = [str(PYTHON), "-W", "ignore", program, task, str(weights), str(seed), str(asked.core), str(steps)]
        one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        return _last_line(command, {"PATH": os.environ["PATH"], "HOME": folder} | one_thread)


def ours(task: str, asked: argparse.Namespace, seed: int) -> dict:
    """A trial on our full path, from a process of its own."""
    settings = {"ours": task, "seed": seed, "core": asked.core, "experts": asked.experts}
    words = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    return _last_line([sys.executable, "-m", "tests.benchmarks.peer", *words], os.environ | {"PYTHONPATH": str(ROOT)})


def _last_line(command: list[str], env: dict[str, str]) -> dict:
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"an episode failed ({' '.join(command[:4])} …): {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def trial(task: str, experts: Path, seed: int, core: int) -> dict:
    """A trial on the full path in this process; one before it warms everything up."""
    os.sched_setaffinity(0, {core})
    manifest, simulated_s = LAYOUTS[f"rrc2022-{task}"], 0.001 * TASKS[task].steps
    lease = Lease(
        trial_id=f"jpeer-{seed}",
        job_id="jpeer",
        ordinal=0,
        fence=1,
        robot="robot-0",
        policy="0" * 64,
        manifest=manifest,
        graph_sha256="0" * 64,
        task=TaskName(task),
        seed=seed,
    )
    driver, channels = SimulatedDriver(), log_channels()
    with tempfile.TemporaryDirectory() as folder:
        wanted, graph = Path(folder) / "manifest.json", Path(folder) / "expert.onnx"
        wanted.write_text(manifest.model_dump_json())
        files = [str(experts / f"{task}_expert.safetensors"), str(wanted), str(graph)]
        command = [sys.executable, "-m", "services.policies.conversion", *files, "none"]
        subprocess.run(command, check=True, capture_output=True, cwd=folder)
        with JailedPolicy("expert", graph) as policy:
            policy.reset()
            for name in ("warm", "timed"):
                ready, path = prepare_plainly(lease, TASKS), Path(folder) / f"{name}.mcap"
                clocks = Clocks(policy.pid)
                outcome = run_trial(lease, policy, driver, channels, path, stop_reason=lambda: None, prepared=ready)
                took = clocks.us(1e6)
                live_as_robots()
    success = outcome.kind is OutcomeKind.SUCCEEDED
    return {"cpu_s": took["cpu"], "wall_s": took["wall"], "simulated_s": simulated_s, "success": success}


def summary(pairs: list[tuple[dict, dict]]) -> dict:
    """How many times more of the processor a simulated second takes there, with the quartiles of the pairs' own ratios."""
    their_s, our_s = (np.array([pair[side]["cpu_s"] / pair[side]["simulated_s"] for pair in pairs]) for side in (0, 1))
    quartiles = [round(float(edge), 2) for edge in np.quantile(their_s / our_s, [0.25, 0.75])]
    return {
        "episodes": len(pairs),
        "their_cpu_s_for_a_second": round(median(their_s), 4),
        "our_cpu_s_for_a_second": round(median(our_s), 4),
        "ratio": round(median(their_s) / median(our_s), 2),
        "quartiles": quartiles,
        "their_successes": sum(pair[0]["success"] for pair in pairs),
        "our_successes": sum(pair[1]["success"] for pair in pairs),
    }


def main(arguments: list[str] | None = None) -> int:
    """Measure in turns, print, keep."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.peer", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--episodes", type=int, default=10, help="of each task on each side")
    parser.add_argument("--tasks", nargs="+", choices=list(WANTED), default=list(WANTED))
    parser.add_argument("--experts", type=Path, default=EXPERTS, help="folder of push_expert and lift_expert.safetensors")
    parser.add_argument("--steps", type=int, help="control periods of an episode there, fewer than it has")
    parser.add_argument("--core", type=int, default=max(os.sched_getaffinity(0)), help="the core that all run on")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--ours", metavar="TASK", choices=list(WANTED), help="only a trial on our full path, as JSON")
    parser.add_argument("--out", type=Path, help="also write the episodes and ratios as JSON")
    asked = parser.parse_args(arguments)
    if asked.ours:
        print(json.dumps(trial(asked.ours, asked.experts, asked.seed, asked.core)))
        return 0
    if (reason := missing(asked.experts)) is not None:
        print(f"skipped: {reason}")
        return 0
    found: dict = {"cpu": machine.cpu_model(), "cores": machine.cores(), "packages": PACKAGES, "ratios": {}, "episodes": {}}
    print(f"{'':5s} episodes    there     here  ratio     quartiles  wanted   (the processor's s for a simulated s)")
    for task in asked.tasks:
        pairs = []
        for index in range(asked.episodes):
            seed = asked.seed + index
            first, second = theirs(task, asked, seed), ours(task, asked, seed)
            pairs.append((first, second))
        found["ratios"][task] = row = summary(pairs)
        found["episodes"][task] = [{"theirs": first, "ours": second} for first, second in pairs]
        amounts = f"{row['their_cpu_s_for_a_second']:8.4f} {row['our_cpu_s_for_a_second']:8.4f} {row['ratio']:6.2f}"
        low, high = row["quartiles"]
        print(f"{task:5s} {row['episodes']:8d} {amounts} {low:6.2f} {high:6.2f} {WANTED[task]:7.0f}", flush=True)
        if asked.out:
            asked.out.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
