"""Re-simulates a trial from its log.

Started as ``python -m sim_backend.replays.replay LOG [--verify] [--truth FILE [--original FILE]] [--json]``.

A robot that is like all others is simulated from its log alone: the recorded applied torques drive the nominal model from the
recorded start. A robot with physics of its own needs the truth about the trial: what its policy or its excitation asked for goes
through the whole pipeline again, effects, tracker and all. A true log gives the same numbers, bit for bit. With the farm's own
log as original, nothing of the given log drives the simulation: it is only compared.
Exit codes: 0 same (or shown), 6 the numbers differ, 10 they differ and the log is of another form of the scene, which says
nothing against it, 7 the truth is needed, 2 the log or its truth cannot be used.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.trial import Verification as Shown
from sim_backend.replays.comparison import (
    Comparison,
    NotRepeatableError,
    Verification,
    check_complete,
    shape_of_log,
    verification,
)
from trial_logs.reader import LogUnreadableError, TrialLog, read_log, read_truth

EXIT_UNREADABLE = 2
EXIT_DIFFERS = 6
EXIT_NEEDS_TRUTH = 7
EXIT_OTHER_FORM = 10
LONGEST_REASON = 300
"""Characters of an error's text: a log can name its trial, and so the reason, as long as it likes."""


class TruthNeededError(Exception):
    """The log is of a robot with physics of its own; it can be simulated again only with the truth about the trial."""


def prepare() -> None:
    """Compile, or load what an earlier process compiled, while this one can still reach it: ``main`` may run in a jail."""
    from sim_backend import warm_up

    warm_up.main()


def verify(log: TrialLog) -> Verification:
    """Compare a log's joint states and true cube poses with a new simulation of its applied torques.

    Raises:
        LogUnreadableError: the log has gaps or no start, so that there is nothing to compare.
        TruthNeededError: the log holds no truth, as those of robots with physics of their own.
    """
    from sim_backend.driver.driver import Start
    from sim_backend.driver.simulated import SimulatedDriver

    check_complete(log)
    if not len(log.cube_steps):
        raise TruthNeededError("the robot has physics of its own that this log does not tell; the farm can verify it")
    if log.cube_steps[0] != 0:
        raise LogUnreadableError("the log has no true cube pose at the start, so that it cannot be simulated again")
    driver = SimulatedDriver(safety=False, shape=shape_of_log(log))
    driver.reset(Start(log.joint_position_rad[:1], log.cube_position_world_m[:1], log.cube_quat_wxyz[:1]))
    segment = driver.advance_torques(np.ascontiguousarray(log.applied_torque_nm[None]))
    found = Comparison()
    found.compare(log.joint_steps, log.joint_position_rad, segment.joint_position_rad[0], "joint")
    found.compare(log.joint_steps, log.joint_velocity_rad_s, segment.joint_velocity_rad_s[0])
    found.compare(log.cube_steps, log.cube_position_world_m, segment.cube_position_world_m[0][log.cube_steps], "cube")
    found.compare(log.cube_steps, log.cube_quat_wxyz, segment.cube_quat_wxyz[0][log.cube_steps])
    return verification(log, log, found)


def _summary(log: TrialLog) -> dict:
    return {
        "trial": _unfolded(log.metadata),
        "outcome": _unfolded(log.outcome),
        "simulated_s": len(log.joint_steps) / 1000,
        "joint_states": len(log.joint_steps),
        "tracked_poses": len(log.capture_s),
        "messages": log.message_counts,
    }


def _unfolded(record: Mapping[str, str]) -> dict[str, Any]:
    """A metadata record, of which MCAP has texts alone, with the lists and objects that were written as JSON."""
    return {name: _parsed(text) for name, text in record.items()}


def _parsed(text: str) -> Any:
    if not text.startswith(("{", "[")):
        return text
    try:
        return json.loads(text)
    except ValueError:  # a text that begins like one
        return text


def _verified(log: TrialLog, truth: Path | None, original: Path | None) -> Verification:
    if truth is None:
        return verify(log)
    from sim_backend.replays.with_truth import verify_with_truth

    if original is None:
        return verify_with_truth(log, read_truth(truth))
    try:
        own = read_truth(truth), read_log(original)
    except LogUnreadableError as error:
        raise NotRepeatableError(str(error)) from error
    return verify_with_truth(log, *own)


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="trifarm replay", description="Show a trial's log, or simulate it again and compare.")
    parser.add_argument("log", type=Path, help="an MCAP file written by a robot of the farm")
    parser.add_argument("--verify", action="store_true", help="simulate the trial again and compare every number")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="the truth about the trial, from an operator of the farm")
    parser.add_argument("--original", type=Path, metavar="FILE", help="the farm's own log, which then drives the simulation")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    if options.original is not None and options.truth is None:
        parser.error("--original needs --truth")
    try:
        log = read_log(options.log)
        if not options.verify:
            print(json.dumps(_summary(log), indent=None if options.json else 2))
            return 0
        result = _verified(log, options.truth, options.original)
    except LogUnreadableError as error:
        return _refused(str(error), EXIT_UNREADABLE, as_json=options.json)
    except NotRepeatableError as error:
        return _refused("the trial cannot be simulated again", EXIT_UNREADABLE, as_json=options.json, hidden=str(error))
    except TruthNeededError as error:
        return _refused(str(error), EXIT_NEEDS_TRUTH, as_json=options.json)
    shown = Shown(**asdict(result))
    print(json.dumps(asdict(result)) if options.json else shown.in_words(options.log.name))
    if result.same:
        return 0
    return EXIT_OTHER_FORM if shown.is_of_other_form else EXIT_DIFFERS


def _refused(reason: str, code: int, *, as_json: bool, hidden: str | None = None) -> int:
    """Say why there is no verdict; ``hidden`` may tell of the robot's physics, and whoever passes it on has to know to whom."""
    reason = reason[:LONGEST_REASON]
    if as_json:
        print(json.dumps({"error": reason} | ({} if hidden is None else {"hidden": hidden[:LONGEST_REASON]})))
    else:
        print(f"error: {reason}" + ("" if hidden is None else f": {hidden[:LONGEST_REASON]}"), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
