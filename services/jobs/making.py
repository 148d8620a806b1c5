"""The rows of trials are made: all of a job's with the job, or a page of them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import JSON, Column, ColumnElement, TableValuedAlias, Text, cast, func, insert, literal, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import TrialState
from services.database import postgres
from services.database.tables import trial
from services.jobs.goals import TrialDraw


@dataclass(frozen=True)
class OfJob:
    """What all trials of a job have in common; ``priority`` is a rank."""

    job_id: str
    number: int
    seed: int
    owner: str
    priority: int


async def make(
    tx: AsyncConnection,
    of: OfJob,
    draws: Sequence[TrialDraw],
    *,
    first: int = 0,
    state: TrialState = TrialState.QUEUED,
    named: str | None = None,
) -> None:
    """Inserts trials of a job, numbered from ``first`` on; those of a ``named`` robot wait for it from the start.

    What differs from trial to trial goes to the database as one text. With a row of values for each, preparing these would take
    most of the time in which nobody else can write to SQLite.
    """
    pinned_order = json.dumps([named] if named else [])
    each = [
        (f"{of.job_id}-{at:03d}", at, draw.seed_of(of.seed, at), draw.excitation, draw.own_goal, draw.order or pinned_order)
        for at, draw in enumerate(draws, first)
    ]
    rows, part = _unpacked(json.dumps(each), in_postgres=postgres.is_postgres(tx))
    values: dict[str, ColumnElement[Any]] = {
        "trial_id": part(0, trial.c.trial_id),
        "job_number": literal(of.number, trial.c.job_number.type),
        "owner": literal(of.owner, trial.c.owner.type),
        "priority": literal(of.priority, trial.c.priority.type),
        "ordinal": part(1, trial.c.ordinal),
        "state": literal(state, trial.c.state.type),
        "seed": part(2, trial.c.seed),
        "excitation": part(3, trial.c.excitation),
        "own_goal": part(4, trial.c.own_goal),
        "robot_order": part(5, trial.c.robot_order),
        "first_choice": literal(named, trial.c.first_choice.type),
    }
    typed = [cast(value, trial.c[name].type).label(name) for name, value in values.items()]
    await tx.execute(insert(trial).from_select(list(values), select(*typed).select_from(rows)))


def _unpacked(document: str, *, in_postgres: bool) -> tuple[TableValuedAlias, Callable[[int, Column[Any]], ColumnElement[Any]]]:
    """A table with a row for each list within a list in JSON, and the part of a row by its place, null where it is null."""
    text = literal(document, Text)
    if in_postgres:
        rows = func.json_array_elements(cast(text, JSON)).table_valued("value")
        return rows, lambda place, column: cast(rows.c.value.op("->>")(place), column.type)
    rows = func.json_each(text).table_valued("value")
    return rows, lambda place, column: cast(func.json_extract(rows.c.value, f"$[{place}]"), column.type)
