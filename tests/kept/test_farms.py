"""Farms of earlier versions open on both homes: jobs, trials, reports, logs and pages are there, and work goes on."""

import sqlite3
from contextlib import contextmanager

import httpx
import pytest
from sqlalchemy import MetaData, create_engine, func, select, text
from sqlalchemy.ext.asyncio import create_async_engine

from services.database.database import migrate
from services.upkeep.doctor import look_through
from tests.homes import now
from tests.integration.farm_process import services
from tests.kept.versions import FARMS, told, unpacked

HOMES = ("sqlite", "postgresql")
CASES = [(home, *farm) for home in HOMES for farm in FARMS]


async def moved(database, url):
    """Brings the rows of a SQLite file into an empty PostgreSQL database of the same form; the form stays what it was."""
    with sqlite3.connect(database) as connection:
        form = connection.execute("SELECT version_num FROM alembic_version").fetchone()[0]
    connection.close()
    await migrate(url, form)
    source, engine = create_engine(f"sqlite:///{database}"), create_async_engine(url)
    theirs, ours = MetaData(), MetaData()
    theirs.reflect(source)
    async with engine.begin() as connection:
        await connection.run_sync(ours.reflect)
        tables = [table for table in ours.sorted_tables if table.name != "alembic_version"]
        with source.connect() as kept:
            for table in tables:
                rows = [dict(row) for row in kept.execute(theirs.tables[table.name].select()).mappings()]
                if rows:
                    await connection.execute(table.insert(), rows)
        for column in (column for table in tables for column in table.columns):
            await _go_on(connection, column)
    await engine.dispose()
    source.dispose()


async def _go_on(connection, column):
    """What a column draws by itself begins after what is there."""
    names = {"table": column.table.name, "column": column.name}
    sequence = (await connection.execute(text("SELECT pg_get_serial_sequence(:table, :column)"), names)).scalar()
    if sequence is not None:
        highest = func.coalesce(func.max(column), 0) + 1
        await connection.execute(select(func.setval(sequence, highest, False)))


@contextmanager
def opened(home, version, physics, folder, postgres):
    """A services process of today on a version's farm."""
    unpacked(version, physics, folder)
    settings = {}
    if home == "postgresql":
        settings["database_url"] = now(postgres().empty())
        now(moved(folder / "farm" / "farm.sqlite", settings["database_url"]))
        (folder / "farm" / "farm.sqlite").unlink()
    with services(folder / "farm", physics=physics, **settings) as running:
        yield running


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def farm(request, tmp_path_factory):
    """(The running farm, its folder with what was fetched, the ids of its jobs)."""
    home, version, physics = request.param
    folder = tmp_path_factory.mktemp("-".join(request.param))
    with opened(home, version, physics, folder, lambda: request.getfixturevalue("postgres")) as running:
        yield running, folder, told(version, "jobs")[physics]


def jobs_of(running):
    return {job["job_id"]: job for job in running.admin.get("/v1/jobs").json()["jobs"]}


def test_all_jobs_are_listed_as_they_ended(farm):
    running, folder, ids = farm
    found = jobs_of(running)
    for name, job_id in ids.items():
        if name != "ladder":
            assert found[job_id]["state"] == ("cancelled" if name == "cancelled" else "succeeded"), name
    fetched = {path.name for path in (folder / "fetched").iterdir()}
    assert fetched == {job_id for name, job_id in ids.items() if name not in ("ladder", "cancelled")}


def test_reports_logs_and_truths_are_served_byte_for_byte(farm):
    running, folder, _ = farm
    for kept in (folder / "fetched").iterdir():
        assert running.admin.get(f"/v1/jobs/{kept.name}/report").content == (kept / "report.json").read_bytes()
        trials = running.admin.get(f"/v1/jobs/{kept.name}/trials").json()["trials"]
        assert len(trials) == jobs_of(running)[kept.name]["trials"]
        for trial in trials:
            log = kept / f"trial-{trial['ordinal']:03d}.mcap"
            assert trial["state"] == "done" and len(trial["attempts"]) == 1
            assert running.admin.get(f"/v1/trials/{trial['trial_id']}/log").content == log.read_bytes()
            truth = log.with_suffix(".truth.mcap")
            assert trial["has_truth"] == truth.exists()
            if truth.exists():
                path = f"/v1/jobs/{kept.name}/trials/{trial['ordinal']}/truth"
                assert running.admin.get(path).content == truth.read_bytes()


def test_ladders_and_tokens_are_there(farm):
    running, _, ids = farm
    tokens = {token["owner"]: token for token in running.admin.get("/v1/tokens").json()["tokens"]}
    assert {"operator", "farm"} <= tokens.keys()
    if "ladder" in ids:
        rungs = running.admin.get(f"/v1/ladders/{ids['ladder']}").json()["rungs"]
        assert len(rungs) == 2
        assert tokens["alice"]["revoked_at"] is None and tokens["bob"]["revoked_at"] is not None


def test_pages_show_them(farm):
    running, _, ids = farm
    jobs = [job_id for name, job_id in ids.items() if name != "ladder"]
    ladders = [f"/ladders/{ids['ladder']}"] if "ladder" in ids else []
    with httpx.Client(base_url=running.api, timeout=120) as client:
        assert client.post("/sign-in", data={"token": running.tokens["admin"], "then": "/jobs"}).status_code == 303
        of_jobs = [path for job_id in jobs for path in (f"/jobs/{job_id}", f"/trials/{job_id}-000")]
        for path in ("/", "/jobs", "/ladders", "/leaderboard", "/studies", *of_jobs, *ladders):
            assert client.get(path).status_code == 200, path
        report = client.get(f"/jobs/{ids['push']}/report")
        assert report.status_code == 200 and ids["push"] in report.text
        assert all(job_id in client.get("/jobs").text for job_id in jobs)


def test_a_kept_policy_is_queued_again(farm):
    running, _, ids = farm
    policy = jobs_of(running)[ids["push"]]["policy"]
    answer = running.submit(policy, trials=2)
    assert answer.status_code == 201, answer.text
    job_id = answer.json()["job_id"]
    assert running.job(job_id)["state"] == "queued"
    running.admin.post(f"/v1/jobs/{job_id}/cancel")


@pytest.mark.parametrize(("version", "physics"), FARMS)
def test_the_doctor_finds_a_kept_farm_well_before_and_after_it_ran(version, physics, tmp_path):
    unpacked(version, physics, tmp_path)
    assert_well(look_through(tmp_path / "farm", deep=True))
    with services(tmp_path / "farm", physics=physics):
        pass
    assert_well(look_through(tmp_path / "farm", deep=True))


def assert_well(found):
    assert found["healthy"], found
    assert {finding["what"] for finding in found["findings"] if finding["level"] == "note"} <= {"form"}, found
