"""Gathers the evidence of a run: histories, every row, every file with its hash, and what unended jobs say that they wait for."""

import hashlib
import json
from pathlib import Path

from sqlalchemy import select

from chaos import history
from chaos.farm import Farm
from chaos.promises import Attempt, Evidence, Job, Report, Trial
from services.database.database import Database, address
from services.database.tables import attempt, job, report, trial
from services.files.homes import open_home
from services.files.store import FileStore
from services.jobs.clock import FarmClock
from services.settings import Settings


async def gather(farm: Farm, scratch: Path) -> Evidence:
    """All that is known of a farm; its API answers.

    Where it is not at rest, what was said is read before the rows, and rows before files: what is read later may only have more.
    """
    lines = history.read(farm.evidence)
    told = {name.removeprefix("TRIFARM_").lower(): value for name, value in (farm.home.settings if farm.home else {}).items()}
    data = farm.disk / farm.services[0]
    settings = Settings(data=data, **told)
    store = FileStore(data / "files" if farm.home is None else scratch / "files", open_home(settings))
    database, clock = Database(address(settings.truth_url)), FarmClock.start()
    try:
        if database.is_shared:
            await clock.set_by(database)
        async with database.read() as connection:
            jobs = (await connection.execute(select(job))).all()
            trials = (await connection.execute(select(trial))).all()
            attempts = (await connection.execute(select(attempt))).all()
            reports = (
                await connection.execute(select(report, job.c.job_id).join(job, job.c.number == report.c.job_number))
            ).all()
        now_s = clock.now_s()
    finally:
        await database.close()
    names = {row.number: row.job_id for row in jobs}
    files = {kept.sha256: await _is_whole(store, kept.sha256) async for kept in store.all()}
    return Evidence(
        lines=lines,
        jobs={row.job_id: _job(row, farm) for row in jobs},
        trials=tuple(_trial(row, names) for row in trials),
        attempts=tuple(Attempt(row.trial_id, row.fence, row.robot, row.state) for row in attempts),
        reports={row.job_id: _report(row) for row in reports},
        files=files,
        now_s=now_s,
        grace_s=3 * settings.sweep_every_s + 1.0,
    )


async def _is_whole(store: FileStore, sha256: str) -> bool:
    hashed = hashlib.sha256()
    async for chunk in store.read(sha256):
        hashed.update(chunk)
    return hashed.hexdigest() == sha256


def _job(row, farm: Farm) -> Job:
    said = None if row.state in {"succeeded", "failed", "cancelled"} else farm.ask("GET", f"/v1/jobs/{row.job_id}")
    return Job(
        job_id=row.job_id,
        owner=row.owner,
        key=row.idempotency_key,
        state=row.state,
        trials=row.trials,
        trials_done=row.trials_done,
        successes=row.successes,
        because=None if said is None else said["waiting_because"],
    )


def _trial(row, names: dict[int, str]) -> Trial:
    return Trial(
        trial_id=row.trial_id,
        job_id=names[row.job_number],
        state=row.state,
        fence=row.fence,
        seed=row.seed,
        lease_until_s=row.lease_until_s,
        outcome=None if row.outcome is None else json.loads(row.outcome)["kind"],
        log_sha256=row.log_sha256,
    )


def _report(row) -> Report:
    said = json.loads(row.body)
    return Report(row.job_id, row.sha256, hashlib.sha256(row.body).hexdigest(), said["trials"], said["successes"])
