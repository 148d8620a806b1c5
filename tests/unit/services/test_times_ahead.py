"""After the clock has gone back nobody waits until it is there again."""

import asyncio

import pytest
from sqlalchemy import insert, select, update

from api_schemas.trial import TrialState
from services import serve, times_ahead
from services.database.tables import job, physics, policy, robot, trial, turn, webhook, why
from services.jobs import physics as physics_of_jobs
from services.jobs.explainer import SPARE_S
from services.settings import Settings
from services.times_ahead import bring_back
from tests.unit.services.dispatcher.conftest import JOB, POLICY
from tests.unit.services.dispatcher.conftest import add_trials as add

NOW_S, DAY_S = 1e9, 86400.0
TIMES = (trial.c.passed_over_s, turn.c.served_s, robot.c.canary_s, physics.c.told_s, why.c.due_s, webhook.c.due_s)


async def fill(database, at_s):
    """One row of each table with a time, that time."""
    async with database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(job).values(JOB))
    await add(database, [["a"]])
    async with database.write() as tx:
        await tx.execute(update(trial).values(passed_over_s=at_s))
        await tx.execute(insert(turn).values(owner="ann", served_s=at_s))
        await tx.execute(insert(robot).values(robot="a", canary_s=at_s, first_seen_at="then"))
        await tx.execute(insert(physics).values(name="real", digest="d", form="f", first_told_at="then", told_s=at_s))
        asked = {"owner": "ann", "robot": "a", "counted": True, "state": "running", "asked_s": 0.0, "tries": 1}
        await tx.execute(insert(why).values(trial_id="j1-000", due_s=at_s, **asked))
        await tx.execute(insert(webhook).values(job_number=1, url="http://a", tries=1, due_s=at_s))


async def times(database):
    async with database.read() as connection:
        return [(await connection.execute(select(column))).scalar_one() for column in TIMES]


async def test_times_ahead_are_brought_to_now_or_to_the_longest_wait(new_database, tmp_path):
    settings = Settings(data=tmp_path)
    await fill(new_database, NOW_S + DAY_S)
    assert await bring_back(new_database, NOW_S, settings)
    assert await times(new_database) == [NOW_S] * 4 + [NOW_S + settings.why_deadline_s + SPARE_S, NOW_S + 3600.0]


async def test_times_that_may_be_are_left_alone(new_database, tmp_path):
    await fill(new_database, NOW_S)
    await bring_back(new_database, NOW_S - 20.0, Settings(data=tmp_path))
    assert await times(new_database) == [NOW_S - 20.0] * 4 + [NOW_S] * 2
    await bring_back(new_database, NOW_S + 20.0, Settings(data=tmp_path))
    assert await times(new_database) == [NOW_S - 20.0] * 4 + [NOW_S] * 2


async def test_the_farms_physics_is_that_which_was_told_last_also_when_several_were_told_ahead(new_database, tmp_path):
    told = ((NOW_S - 1.0, "before"), (NOW_S + DAY_S, "last"), (NOW_S + 1.0, "first"))
    async with new_database.write() as tx:
        for at_s, name in told:
            await tx.execute(insert(physics).values(name=name, digest="d", form="f", first_told_at="then", told_s=at_s))
    assert await bring_back(new_database, NOW_S, Settings(data=tmp_path))
    async with new_database.read() as connection:
        now = select(physics.c.name, physics.c.told_s).where(physics.c.number == physics_of_jobs.NOW)
        assert (await connection.execute(now)).one() == ("last", NOW_S)


async def test_a_lease_is_shortened_whatever_becomes_of_the_rest(new_database, tmp_path, monkeypatch):
    await fill(new_database, NOW_S + DAY_S)
    async with new_database.write() as tx:
        await tx.execute(update(trial).values(state=TrialState.RUNNING, robot="a", lease_until_s=NOW_S + DAY_S))

    def failing(*_):
        raise OSError("away")

    monkeypatch.setattr(times_ahead, "_ahead", failing)
    settings = Settings(data=tmp_path)
    with pytest.raises(OSError, match="away"):
        await bring_back(new_database, NOW_S, settings)
    async with new_database.read() as connection:
        assert (await connection.execute(select(trial.c.lease_until_s))).scalar_one() == NOW_S + settings.lease_s


async def test_whoever_changes_a_row_meanwhile_is_not_waited_for(new_database, tmp_path):
    if not new_database.is_shared:
        pytest.skip("SQLite has one writer")
    await fill(new_database, NOW_S + DAY_S)
    settings = Settings(data=tmp_path)
    async with new_database.write() as tx:
        await tx.execute(update(turn).values(served_s=NOW_S + 1.0))
        await tx.execute(update(trial).values(passed_over_s=NOW_S + 1.0))
        assert not await asyncio.wait_for(bring_back(new_database, NOW_S, settings), 60.0)
    assert (await times(new_database))[:4] == [NOW_S + 1.0] * 2 + [NOW_S] * 2
    assert await bring_back(new_database, NOW_S, settings)
    assert (await times(new_database))[:4] == [NOW_S] * 4


async def test_a_farm_that_starts_by_an_earlier_clock_brings_them_back(tmp_path):
    settings = Settings(data=tmp_path / "farm")
    async with serve.open_farm(settings) as farm:
        ahead_s = farm.clock.now_s() + DAY_S
        await fill(farm.database, ahead_s)
    async with serve.open_farm(settings) as farm:
        assert max(await times(farm.database)) < ahead_s
