"""What the seeds of a job's trials stand for, asked of a child process: services load no physics."""

import json
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from api_schemas.goal import JobGoals, OwnGoal, TrialGoal
from services.child_process import ChildKilledError, run_module
from services.database.rows import AnyRow
from services.errors import Unavailable
from services.turns import Turns

DRAWING = "sim_backend.tasks.drawn"
AT_ONCE = 300
"""Seeds of one child; what it says of more would be too long."""
DEADLINE_S = 30.0
KEPT = 64
"""Jobs."""
Drawn = list[list[Any]]
"""For each seed the numbers of its goal and start, each a list or null."""


@dataclass
class DrawnGoals:
    """The goals of the jobs that were asked for last; owns what was drawn, so that the same seeds cost one child.

    One asks at a time, and owners take turns: children that draw for many readers at once would take the services' cores.
    """

    _kept: OrderedDict[tuple[str, ...], Drawn] = field(default_factory=OrderedDict)
    _turns: Turns = field(default_factory=Turns)

    async def of_job(self, job: AnyRow, trials: Sequence[AnyRow], reader: str) -> JobGoals:
        """The goals of trials of a policy's job; ``reader`` is the owner who asks.

        Raises:
            Unavailable: the child did not answer.
            TooMany: too many of the reader's requests wait.
        """
        seeds = [str(row.seed) for row in trials]
        async with self._turns.of(reader):
            drawn = await self._drawn((job.task, *seeds))
        goals = tuple(_shown(row, *values) for row, values in zip(trials, drawn, strict=True))
        return JobGoals(job_id=job.job_id, task=job.task, goals=goals)

    async def _drawn(self, asked: tuple[str, ...]) -> Drawn:
        if asked not in self._kept:
            task, seeds, drawn = asked[0], asked[1:], []
            for first in range(0, len(seeds), AT_ONCE):
                drawn += await _drawn(task, seeds[first : first + AT_ONCE])
            self._kept[asked] = drawn
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(asked)
        return self._kept[asked]


async def _drawn(task: str, seeds: Sequence[str]) -> Drawn:
    try:
        ended = await run_module(DRAWING, task, *seeds, folder=Path("/"), deadline_s=DEADLINE_S)
        return json.loads(ended.said)
    except (ChildKilledError, ValueError) as error:
        raise Unavailable("goals-not-drawn", f"The goals could not be drawn: {error}. Ask again in a moment.") from error


def _shown(
    row: AnyRow,
    position_m: list[float] | None,
    quat_wxyz: list[float] | None,
    tips_m: list[float] | None,
    start_m: list[float],
    start_quat_wxyz: list[float],
) -> TrialGoal:
    shown = TrialGoal.model_validate(
        {
            "trial": row.ordinal,
            "seed": row.seed,
            "is_own": row.own_goal is not None,
            "position_m": position_m,
            "quat_wxyz": quat_wxyz,
            "fingertip_position_m": tips_m,
            "start_position_m": start_m,
            "start_quat_wxyz": start_quat_wxyz,
        }
    )
    if row.own_goal is None:
        return shown
    own = OwnGoal.model_validate_json(row.own_goal)
    shown = shown.model_copy(update={"position_m": own.position_m, "quat_wxyz": own.quat_wxyz})
    if own.start is None:
        return shown
    half = own.start.yaw_rad / 2
    placed = (*own.start.position_m, shown.start_position_m[2])
    return shown.model_copy(update={"start_position_m": placed, "start_quat_wxyz": (math.cos(half), 0.0, 0.0, math.sin(half))})
