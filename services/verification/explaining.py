"""Starts the replays that tell why a trial failed, waits for them, and reads what they found."""

import json
import math
from pathlib import Path

from api_schemas.why import Why
from jail.level import JailLevel
from services.child_process import ChildKilledError, run_module

EXPLAINING = "robot_farm.explaining"
"""By name alone: the services know no physics."""


class CannotExplainError(Exception):
    """There is no answer; the message says why, and tells nothing of the robot."""


async def explain(folder: Path, least: JailLevel, deadline_s: float) -> Why:
    """Simulates a trial again and again, in a child process that is as closed as its policy's is.

    Args:
        folder: with ``log.mcap``, ``truth.mcap`` and ``graph.onnx``.
        least: a policy whose jail does not reach this level is not run.
        deadline_s: for the whole of it, wall time and CPU time.

    Raises:
        CannotExplainError: it took too long, or the trial cannot be explained.
    """
    graph = str((folder / "graph.onnx").absolute())
    files = ("log.mcap", "--truth", "truth.mcap", "--graph", graph)
    confined = ("--confined", str(math.ceil(deadline_s)), "--jail-level", least.value)
    try:
        ended = await run_module(EXPLAINING, *files, *confined, folder=folder, deadline_s=deadline_s)
    except ChildKilledError as error:
        raise CannotExplainError(f"the replays were ended: {error}") from error
    try:
        said = json.loads(ended.said)
        if ended.status == 0:
            return Why.model_validate(said)
        raise CannotExplainError(str(said["error"]))
    except (ValueError, KeyError, TypeError) as error:
        raise CannotExplainError(f"the process of the replays {ended.how}; the farm's operator can try it") from error
