"""A job of many pages on real processes: its services are killed again and again while trials are made, and nothing is amiss."""

import signal

import pytest
from sqlalchemy import func, select

from services.database.database import Database, address
from services.database.tables import attempt, job, trial
from services.jobs.order import trial_seed
from tests.homes import now
from tests.integration.farm_process import Services, until

PAGE, TRIALS, KILLS = 5, 60, 2


@pytest.fixture(params=["sqlite", "postgres"])
def home(request, tmp_path):
    """The settings of a home, and the address of its database."""
    if request.param == "sqlite":
        return {}, f"sqlite:///{tmp_path / 'farm/farm.sqlite'}"
    url = now(request.getfixturevalue("postgres").new())
    return {"database_url": url}, url


async def read(url, wanted):
    database = Database(address(url))
    try:
        async with database.read() as connection:
            return (await connection.execute(wanted)).all()
    finally:
        await database.close()


def test_services_that_are_killed_while_trials_are_made_lose_none_and_make_none_twice(home, tmp_path):
    settings, url = home
    farm = Services(tmp_path / "farm", trials_page=PAGE, **settings)
    try:
        farm.start()
        job_id = farm.submit(farm.policy(), trials=TRIALS, seed=11).json()["job_id"]
        farm.start_robots(2, trial_s=0.02)
        for kill in range(1, KILLS + 1):
            wanted = kill * TRIALS // (KILLS + 2)
            until(lambda least=wanted: farm.job(job_id)["trials_done"] >= least, 120, f"{wanted} trials done")
            assert farm.process is not None
            farm.process.send_signal(signal.SIGKILL)
            farm.process.wait(10)
            farm.start()
        ended = farm.wait_for_end(job_id, 240)
        assert (ended["state"], ended["trials_done"]) == ("succeeded", TRIALS)
        rows = now(read(url, select(trial.c.ordinal, trial.c.seed, trial.c.state).order_by(trial.c.ordinal)))
        assert [tuple(row) for row in rows] == [(at, trial_seed(11, at), "done") for at in range(TRIALS)]
        accepted = select(func.count(), func.count(attempt.c.trial_id.distinct())).where(attempt.c.state == "accepted")
        assert [tuple(row) for row in now(read(url, accepted))] == [(TRIALS, TRIALS)]
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert (report["trials"], len(report["per_trial"]), report["ended_at"]) == (TRIALS, TRIALS, ended["ended_at"])
        table = farm.admin.get(f"/v1/jobs/{job_id}/trials.csv").text
        assert table.count("\n") == TRIALS + 1
        (row,) = now(read(url, select(job.c.outcomes, job.c.trials_made)))
        assert (len(row.outcomes), row.trials_made) == (TRIALS, TRIALS)
    finally:
        farm.close()


def test_a_user_asks_for_no_more_trials_than_the_farm_allows(tmp_path):
    farm = Services(tmp_path / "farm", max_trials_per_job=50)
    try:
        farm.start()
        made = farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()
        ann = farm.client(made["secret"])
        policy = farm.policy(ann)
        answer = farm.submit(policy, ann, trials=51)
        assert (answer.status_code, answer.json()["limit"]) == (422, 50)
        assert "may have 50 trials, not 51" in answer.json()["detail"]
        assert farm.submit(policy, ann, trials=50).status_code == 201
        assert farm.submit(policy, trials=100_000).status_code == 201, "operators are not bounded"
        assert farm.submit(policy, trials=100_001).status_code == 422
    finally:
        farm.close()
