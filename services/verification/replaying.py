"""Starts the replay of a log with its truth, waits for it, and reads its verdict."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from api_schemas.trial import Verification
from services.child_process import ChildSaidTooMuchError, ChildTimedOutError, Ended, run_module
from services.errors import Refused, Unavailable

REPLAY = "sim_backend.replays.replay"
VERDICTS = frozenset({0, 6, 10})
"""Exit codes of a replay that compared all numbers: the same, different, or of another form of the scene."""


@dataclass(frozen=True)
class Compared:
    """The files of a verification: a log that anyone may have made, and what the farm keeps of its trial."""

    log: Path
    truth: Path
    original: Path


async def verify(files: Compared, deadline_s: float, *, tell_all: bool) -> Verification:
    """Simulates the trial again from what the farm keeps, and compares the log with it.

    Args:
        files: all in one folder.
        deadline_s: for the whole of it.
        tell_all: also tell what may be known of the hidden robot only to operators.

    Raises:
        Refused: the log cannot be read, or is not one of this truth.
        Unavailable: it took too long, or the farm's own files cannot be simulated, or the replay broke.
    """
    # By name alone: the process owns the folder, but perhaps may not pass those above it.
    compared = (files.log.name, "--verify", "--truth", files.truth.name, "--original", files.original.name, "--json")
    arguments = (str(math.ceil(deadline_s)), REPLAY, *compared)
    try:
        ended = await run_module("services.verification.confined", *arguments, folder=files.log.parent, deadline_s=deadline_s)
    except ChildTimedOutError as error:
        raise Unavailable("verification-timed-out", f"The log could not be simulated again: {error}.") from error
    except ChildSaidTooMuchError as error:
        raise Unavailable("verification-failed", f"The log could not be simulated again: {error}.") from error
    return _read(ended, tell_all)


def _read(ended: Ended, tell_all: bool) -> Verification:
    try:
        said = json.loads(ended.said)
        if ended.status in VERDICTS:
            return Verification.model_validate(said)
        problem, hidden = said["error"], said.get("hidden")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        detail = f"The log could not be simulated again: the replaying process {ended.how}. The farm's operator can try it."
        raise Unavailable("verification-failed", detail) from error
    if hidden is not None:
        why = hidden if tell_all else "the farm's operator can find out why"
        raise Unavailable("verification-failed", f"The farm's own log cannot be compared with: {problem}; {why}.")
    raise Refused("log-unfit", f"The log cannot be simulated again: {problem}")
