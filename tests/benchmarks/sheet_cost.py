"""What the small pictures of a job's trials cost its robots, as a share of a trial's own time: ``python -m`` it.

A robot chooses ten poses after each trial, which go with its outcome; a browser draws them. Trials of push run
one after the other, and the processor's time of that choice and of its packing is compared with that of the whole trial.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from robot_farm import trial
from robot_farm.policy.jail import JailedPolicy
from sim_backend.driver.simulated import SimulatedDriver
from tests.graphs import linear
from tests.unit.conftest import lease

SHEET = 40


def main() -> None:
    """Runs the trials and prints what was measured."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    chosen_s, packed_bytes, whole_s = [], [], []
    glimpse = trial._glimpse

    def timed(*arguments: Any) -> Any:
        began_s = time.process_time()
        made = glimpse(*arguments)
        text = "" if made is None else made.model_dump_json()
        chosen_s.append(time.process_time() - began_s)
        packed_bytes.append(len(text))
        return made

    trial._glimpse = timed  # pyrefly: ignore[bad-assignment] - it is called by place
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        driver, channels = SimulatedDriver(), trial.log_channels()
        with JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
            for number in range(given.trials):
                wanted = lease(task="push").model_copy(update={"seed": number})
                began_s = time.process_time()
                trial.run_trial(wanted, policy, driver, channels, folder / f"{number}.mcap", stop_reason=lambda: None)
                whole_s.append(time.process_time() - began_s)
    found = {
        "cores": os.cpu_count(),
        "load_before": os.getloadavg()[0],
        "trials": given.trials,
        "cpu_s_of_a_trial": round(sum(whole_s) / len(whole_s), 3),
        "cpu_ms_of_its_poses": round(1e3 * sum(chosen_s) / len(chosen_s), 2),
        "share": round(sum(chosen_s) / sum(whole_s), 5),
        "bytes_of_its_poses": round(sum(packed_bytes) / len(packed_bytes)),
        "kilobytes_of_a_sheet": round(SHEET * sum(packed_bytes) / len(packed_bytes) / 1e3, 1),
    }
    text = json.dumps(found, indent=2)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
