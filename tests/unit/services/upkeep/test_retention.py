"""Logs go by age and size; what a report refers to, or may come to refer to, never does."""

import asyncio
import time

import pytest
from sqlalchemy import insert

from services.database.tables import attempt, job, policy, trial
from services.files.homes import open_home
from services.files.store import FileStore, Kept
from services.upkeep import retention
from services.upkeep.retention import DAY_S, YOUNG_S, Removed, Rules, tidy, to_remove
from tests.homes import s3_home_settings
from tests.unit.services.database.test_migrations import DONE, JOB, POLICY

LATER_S = 10 * DAY_S


@pytest.fixture(params=["local", "s3"])
def files(request, tmp_path):
    home = None if request.param == "local" else open_home(s3_home_settings(request.getfixturevalue("s3")))
    return FileStore(tmp_path / "files", home)


async def put(files, text):
    async def body():
        yield text.encode()

    return (await files.put(body(), limit_bytes=100)).sha256


async def fill(database, files):
    """Files of every standing, by the name that says which: their hashes."""
    names = (
        "weights",
        "graph",
        "report log",
        "report truth",
        "running log",
        "open log",
        "fault log",
        "failed log",
        "cancelled log",
        "nobody's",
    )
    sha = {name: await put(files, name) for name in names}
    jobs = {1: "succeeded", 2: "running", 3: "failed", 4: "cancelled"}
    attempts = [
        (1, "accepted", "report log", "report truth"),
        (1, "platform_fault", "fault log", None),
        (2, "accepted", "running log", None),
        (2, "open", "open log", None),
        (3, "accepted", "failed log", None),
        (4, "accepted", "cancelled log", None),
    ]
    async with database.write() as tx:
        named = {"digest": sha["weights"], "weights_sha256": sha["weights"], "graph_sha256": sha["graph"]}
        await tx.execute(insert(policy).values(POLICY | named))
        for number, state in jobs.items():
            own = {"number": number, "job_id": f"j{number}", "state": state, "policy": sha["weights"]}
            await tx.execute(insert(job).values(JOB | own))
        for ordinal, (number, state, log, truth) in enumerate(attempts):
            own = {"trial_id": f"t{ordinal}", "job_number": number, "ordinal": ordinal, "owner": "ann"}
            await tx.execute(insert(trial).values(DONE | own))
            kept = {"log_sha256": sha[log], "truth_sha256": sha.get(truth)}
            row = {"trial_id": f"t{ordinal}", "fence": 1, "job_number": number, "robot": "r", "state": state, "started_at": "now"}
            await tx.execute(insert(attempt).values(row | kept))
    return sha


async def left(files, sha):
    there = {each.sha256 async for each in files.all()}
    return {name for name, digest in sha.items() if digest in there}


async def test_what_a_report_refers_to_or_may_is_kept_however_old(new_database, files):
    sha = await fill(new_database, files)
    removed = await tidy(new_database, files, Rules(days=9, size=None), time.time() + LATER_S)
    assert await left(files, sha) == set(sha) - {"fault log", "cancelled log", "nobody's"}
    assert removed == Removed(3, len("fault log" + "cancelled log" + "nobody's"))


async def test_nothing_goes_that_is_young_or_that_no_rule_lets_go(new_database, files):
    sha = await fill(new_database, files)
    assert await tidy(new_database, files, Rules(days=None, size=0), time.time() + YOUNG_S / 2) == Removed(0, 0)
    assert await tidy(new_database, files, Rules(days=None, size=None), time.time() + LATER_S) == Removed(0, 0)
    assert await tidy(new_database, files, Rules(days=11, size=30), time.time() + LATER_S) == Removed(0, 0)
    assert await left(files, sha) == set(sha)


async def test_what_comes_again_while_it_is_to_go_is_kept_though_its_row_is_still_on_the_way(new_database, files, monkeypatch):
    sha256, look = await put(files, "graph"), retention._referred_to

    async def looked(connection, some):
        found = await look(connection, some)
        if some == [sha256] and not listing:
            await asyncio.sleep(1.1)  # S3 counts seconds
            await put(files, "graph")
        listing.clear()
        return found

    listing = ["the first time of all"]
    monkeypatch.setattr(retention, "_referred_to", looked)
    assert await tidy(new_database, files, Rules(days=9, size=None), time.time() + LATER_S) == Removed(0, 0)
    assert await left(files, {"graph": sha256}) == {"graph"}


async def test_what_comes_again_between_the_last_look_and_the_removal_is_there_afterwards(new_database, files, monkeypatch):
    sha256, find, coming = await put(files, "graph"), files.find, []

    async def found(name):
        was = await find(name)
        if not coming:
            coming.append(asyncio.create_task(put(files, "graph")))
            await asyncio.wait(coming, timeout=0.5)
        return was

    monkeypatch.setattr(files, "find", found)
    await tidy(new_database, files, Rules(days=9, size=None), time.time() + LATER_S)
    await asyncio.gather(*coming)
    assert await left(files, {"graph": sha256}) == {"graph"}


def test_the_oldest_go_until_the_rest_is_small_enough():
    kept = [Kept(name, 10, stored_s) for name, stored_s in (("new", 3 * DAY_S), ("old", 1 * DAY_S), ("middle", 2 * DAY_S))]

    def going(days, size):
        return [each.sha256 for each in to_remove(kept, Rules(days, size), 4 * DAY_S)]

    assert going(None, 30) == []
    assert going(None, 29) == ["old"]
    assert going(None, 0) == ["old", "middle", "new"]
    assert going(1.5, 30) == ["old", "middle"]
    assert going(1.5, 5) == ["old", "middle", "new"]
