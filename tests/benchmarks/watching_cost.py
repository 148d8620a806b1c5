"""What it costs a robot to be watched: ``python -m`` it from the root.

A robot shows itself ten times a second whether anybody looks or not; this is what one showing takes, as a share of the core that
the trial runs on, what it takes the services to pass one on to a viewer, and whether the physics are the same bits without it.
"""

import argparse
import hashlib
import json
import os
import statistics
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from api_schemas.robot import Lease
from robot_farm.health import WatchedHealth
from robot_farm.ideal_life import IdealLife
from robot_farm.policy.jail import JailedPolicy
from robot_farm.run import Progress, live_state
from robot_farm.trial import log_channels, run_trial
from services.dashboard.watch_page import message
from sim_backend.driver.simulated import SimulatedDriver
from tests.graphs import linear
from tests.unit.conftest import lease
from trial_logs.reader import read_log

EVERY_S = 0.1
REPEATED = 2000


def cpu_us(work) -> float:
    """CPU time of one call, the median of five runs of many."""
    runs = []
    for _ in range(5):
        began_s = time.thread_time()
        for _ in range(REPEATED // 5):
            work()
        runs.append((time.thread_time() - began_s) / (REPEATED // 5))
    return round(1e6 * statistics.median(runs), 1)


def trial(folder: Path, policy: JailedPolicy, driver: SimulatedDriver, channels, *, shown: bool) -> dict:
    """A trial of 15 s, with a thread that shows it or without; its CPU time and the digest of what it measured."""
    progress, over, shows = Progress(), threading.Event(), []

    def show() -> None:
        leased = lease()
        while not over.wait(EVERY_S):
            shows.append(_shown(leased, progress))

    watcher = threading.Thread(target=show, daemon=True)
    path = folder / f"{time.monotonic_ns()}.mcap"
    began_s = time.process_time()
    if shown:
        watcher.start()
    run_trial(lease(), policy, driver, channels, path, stop_reason=lambda: None, progress=progress)
    over.set()
    if shown:
        watcher.join()
    spent_s, log = time.process_time() - began_s, read_log(path)
    digest = hashlib.sha256(np.ascontiguousarray(log.joint_position_rad).tobytes() + log.applied_torque_nm.tobytes()).hexdigest()
    return {"cpu_s": round(spent_s, 3), "shown": len(shows), "sha256": digest, "progress": progress}


def _shown(leased: Lease, progress: Progress) -> str | None:
    """What the robot sends for one showing."""
    state = live_state(leased, progress)
    return None if state is None else state.model_dump_json()


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    parser.add_argument("--pairs", type=int, default=3, help="trials that are not shown, and as many that are")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, JailedPolicy("linear", linear(Path(name) / "linear.onnx")) as policy:
        folder, driver, channels = Path(name), SimulatedDriver(), log_channels()
        trial(folder, policy, driver, channels, shown=False)  # compiled, and in every cache
        runs = [
            (trial(folder, policy, driver, channels, shown=False), trial(folder, policy, driver, channels, shown=True))
            for _ in range(given.pairs)
        ]
    progress = runs[-1][1]["progress"]
    leased = lease()
    state = live_state(leased, progress)
    assert state is not None
    one_us = cpu_us(lambda: _shown(leased, progress))
    found = {
        "load_before": os.getloadavg()[0],
        "robot_us_for_one_showing": one_us,
        "robot_share_of_a_core_at_10_hz": round(10 * one_us / 1e6, 5),
        "robot_us_for_its_health_once_a_second": cpu_us(WatchedHealth(lambda: progress, IdealLife()).health),
        "services_us_for_one_message_to_one_viewer": cpu_us(lambda: message(state)),
        "bytes_of_a_message_to_a_viewer": len(message(state)),
        "trial_cpu_s_not_shown_and_shown": [[alone["cpu_s"], shown["cpu_s"]] for alone, shown in runs],
        "showings_in_a_trial": [shown["shown"] for _, shown in runs],
        "same_bits": len({each["sha256"] for pair in runs for each in pair}) == 1,
    }
    text = json.dumps(found, indent=1)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
