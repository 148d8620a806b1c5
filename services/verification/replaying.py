"""Starts the replay of a log with its truth, waits for it, and reads its verdict."""

import json
import math
from pathlib import Path

from pydantic import ValidationError

from api_schemas.verification import Verification
from services.child import ChildTimedOutError, Ended, run_module
from services.errors import Refused, Unavailable

REPLAY = "sim_backend.replay"
VERDICTS = frozenset({0, 6})
"""Exit codes of a replay that compared all numbers: the same, or different."""


async def verify(log: Path, truth: Path, deadline_s: float) -> Verification:
    """Simulates the log again with what the truth file holds.

    Raises:
        Refused: the log cannot be read, or is not one of this truth.
        Unavailable: it took too long, or the replay broke.
    """
    arguments = (str(math.ceil(deadline_s)), REPLAY, str(log), "--verify", "--truth", str(truth), "--json")
    try:
        ended = await run_module("services.verification.confined", *arguments, folder=log.parent, deadline_s=deadline_s)
    except ChildTimedOutError as error:
        raise Unavailable("verification-timed-out", f"The log could not be simulated again: {error}.") from error
    return _read(ended)


def _read(ended: Ended) -> Verification:
    try:
        said = json.loads(ended.said)
        if ended.status in VERDICTS:
            return Verification.model_validate(said)
        problem = said["error"]
    except (ValueError, KeyError, TypeError, ValidationError) as error:
        detail = f"The log could not be simulated again: the replaying process {ended.how}. The farm's operator can try it."
        raise Unavailable("verification-failed", detail) from error
    raise Refused("log-unfit", f"The log cannot be simulated again: {problem}")
