"""A small program in the place of the replay: does what the log's first word says, beside a truth of any content."""

import json
import os
import resource
import sys
import time
from pathlib import Path


def prepare() -> None:
    """Needs nothing."""


def main(arguments: list[str]) -> int:
    log, verify, truth_flag, truth, original_flag, original, as_json = arguments
    assert (verify, truth_flag, original_flag, as_json) == ("--verify", "--truth", "--original", "--json")
    assert Path(original).read_text() == "the original"
    does = Path(log).read_text()
    answer = {"trial_id": Path(truth).read_text(), "steps": 9, "same": does == "same", "first_difference_step": 3}
    answer |= {"largest_joint_difference_rad": 0.5, "largest_cube_difference_m": 0.25}
    if does == "same":
        answer |= {"first_difference_step": None, "largest_joint_difference_rad": 0.0, "largest_cube_difference_m": 0.0}
    if does == "hang":
        time.sleep(600)
    elif does == "crash":
        sys.exit(3)
    elif does == "garbage":
        print("{")
    elif does == "limits":
        limits = [resource.getrlimit(each)[0] for each in (resource.RLIMIT_CPU, resource.RLIMIT_CORE)]
        memory_gib = resource.getrlimit(resource.RLIMIT_AS)[0] / 1024**3
        print(json.dumps({"error": f"limits {limits}, memory {memory_gib} GiB, niceness {os.getpriority(os.PRIO_PROCESS, 0)}"}))
        sys.exit(1)
    elif does == "shout":
        while True:
            print("x" * 4096)
    elif does == "diverge":
        print(json.dumps({"error": "it cannot be simulated again", "hidden": "PhysicsDivergedError: at step 421"}))
        sys.exit(1)
    elif does == "unreadable":
        print(json.dumps({"error": "the log has gaps"}))
        sys.exit(1)
    else:
        print(json.dumps(answer))
        sys.exit(0 if does == "same" else 6)
    return 0
