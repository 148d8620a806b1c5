"""Workers and learner of a training on Ray are killed again and again: ``python -m tests.benchmarks.killed_workers --out FILE``.

A Ray of three nodes, all on this machine's loopback, has a worker on each. The recipe is trained twice: undisturbed in one
process per worker without Ray, and on Ray while a worker is killed every 20 s and the learner at a third and at two thirds, to go
on with ``--resume``. What is to hold: every sample that was asked for was used once or dropped with a reason, and the policy is
the same bits as that of the undisturbed run, so that its success is the same, too.
"""

import argparse
import hashlib
import json
import os
import random
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sim_backend.training.ledger import LEDGER, account
from tests.benchmarks.machine import kind

NODES, POLL_S = 3, 0.5
ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # else Ray listens on all interfaces
    "OMP_NUM_THREADS": "1",
}
STORE_BYTES = 256 * 2**20
RECIPE = """
about = "push, for workers that are killed"
task = "push"
layout = "push"
episode_s = 5.0
samples = {samples}
checkpoint_minutes = {checkpoint_minutes}

[reward]
approach = 1000.0

[networks]
actor = [128, 128]
critic = [256, 128]
privileged = true

[ppo]
robots = 1020
steps = 16
slices = 6
minibatch = 4080
learning_rate = 5e-4
final_learning_rate = 1e-4

[evaluation]
every_samples = 100_000_000
trials = 64
physics = ["nominal"]
"""


@contextmanager
def three_nodes() -> Iterator[str]:
    """A Ray of three nodes with one core each; its address."""
    from ray.cluster_utils import Cluster  # of the extra, which need not be installed

    node = {"num_cpus": 1, "object_store_memory": STORE_BYTES, "node_ip_address": "127.0.0.1"}
    cluster = Cluster(initialize_head=True, head_node_args=node | {"include_dashboard": False})
    try:
        for _ in range(NODES - 1):
            cluster.add_node(**node)
        yield str(cluster.address)
    finally:
        cluster.shutdown()


def begin(recipe: Path, out: Path, *more: str) -> subprocess.Popen:
    """The training as a user starts it."""
    command = [sys.executable, "-m", "client_cli", "train", str(recipe), "--out", str(out), "--threads", "1", *more]
    with out.with_suffix(".log").open("ab") as log:
        return subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | ENVIRONMENT)


def workers() -> list[int]:
    """Processes in which Ray runs the actors of this user's trainings."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            name = (process / "cmdline").read_bytes()
        except OSError:
            continue  # it has ended meanwhile
        if name.startswith(b"ray::_Actor"):
            found.append(int(process.name))
    return found


def used(out: Path) -> int:
    """Samples that are in the policy so far, those of a learner that was killed counted as often as they were used."""
    ledger = out / LEDGER
    lines = ledger.read_text().splitlines(keepends=True) if ledger.exists() else []
    rows = [json.loads(line) for line in lines if line.endswith("\n")]
    return sum(row["samples"] for row in rows if row["what"] == "used")


def disturbed(recipe: Path, out: Path, address: str, samples: int, kill_every_s: float, rng: random.Random) -> dict[str, Any]:
    """Trains on Ray to the end, and kills on the way."""
    on_ray = ("--workers", str(NODES), "--cluster", address)
    running, began_s, killed, learners = begin(recipe, out, *on_ray), time.monotonic(), 0, 0
    next_s = began_s + kill_every_s
    while running.poll() is None:
        time.sleep(POLL_S)
        if learners < 2 and used(out) > samples * (learners + 1) / 3:
            running.send_signal(signal.SIGKILL)
            running.wait()
            learners += 1
            running = begin(recipe, out, *on_ray, "--resume")
        elif time.monotonic() > next_s and (there := workers()):
            os.kill(rng.choice(there), signal.SIGKILL)
            killed, next_s = killed + 1, time.monotonic() + kill_every_s
    assert running.returncode == 0, out.with_suffix(".log").read_text()[-2000:]
    return {"took_s": round(time.monotonic() - began_s), "workers_killed": killed, "learners_killed": learners}


def told(out: Path) -> dict[str, Any]:
    """What became of a run: its samples one by one, its policy's digest and its success."""
    found, record = account(out), json.loads((out / "record.json").read_text())
    (policy,) = out.glob("*.safetensors")
    return {
        "asked": found.asked,
        "used": found.used,
        "dropped": found.dropped,
        "adds_up": found.adds_up,
        "policy": hashlib.sha256(policy.read_bytes()).hexdigest()[:16],
        "success": record["evaluations"][-1:],
        "workers": record["workers"],
    }


def main() -> None:
    """Runs both and prints one document; exits with 1 where it does not hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=2_000_000)
    parser.add_argument("--kill-every-s", type=float, default=20.0)
    parser.add_argument("--checkpoint-minutes", type=float, default=0.5)
    parser.add_argument("--seed", type=int, default=29)
    asked = parser.parse_args()
    os.environ.update(ENVIRONMENT)
    with tempfile.TemporaryDirectory() as name:
        recipe = Path(name, "killed.toml")
        recipe.write_text(RECIPE.format(samples=asked.samples, checkpoint_minutes=asked.checkpoint_minutes))
        whole, broken = Path(name, "whole"), Path(name, "broken")
        with three_nodes() as address:
            how = disturbed(recipe, broken, address, asked.samples, asked.kill_every_s, random.Random(asked.seed))
        began_s = time.monotonic()
        running = begin(recipe, whole, "--workers", "2")
        assert running.wait() == 0, whole.with_suffix(".log").read_text()[-2000:]
        document: dict[str, Any] = {
            "machine": kind(),
            "samples": asked.samples,
            "nodes": NODES,
            "kill_every_s": asked.kill_every_s,
        }
        document |= {"disturbed": how | told(broken), "undisturbed": told(whole) | {"took_s": round(time.monotonic() - began_s)}}
    document["same_policy"] = document["disturbed"]["policy"] == document["undisturbed"]["policy"]
    asked.out.write_text(json.dumps(document, indent=1) + "\n")
    print(json.dumps(document))
    holds = document["same_policy"] and document["disturbed"]["adds_up"] and how["learners_killed"] == 2
    sys.exit(0 if holds else 1)


if __name__ == "__main__":
    main()
