"""Backup while the farm runs, restore elsewhere, the same reports; and a doctor who finds what was broken."""

import json
import os
import subprocess
import sys

import pytest

from services.upkeep.__main__ import PRIVATE
from services.upkeep.backup import back_up, restore
from services.upkeep.doctor import look_through
from services.upkeep.folder import UpkeepError
from tests.integration.farm_process import PATIENCE_S, ROOT, services, until

MANY = 160
"""Trials of a job that lasts more than a minute: it has not ended when two backups have been made, however slow a
machine is at them."""


def trifarm(*arguments, code=0):
    """What a command says, which starts two processes; what it has them do is done by :func:`upkeep`, too."""
    ran = subprocess.run(
        [sys.executable, "-m", "client_cli", *map(str, arguments), "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == code, ran.stdout + ran.stderr
    return json.loads(ran.stdout)


def upkeep(work, *folders, **how):
    """What the services' program does when a command asks for it, here."""
    before = os.umask(PRIVATE)
    try:
        return work(*folders, **how)
    finally:
        os.umask(before)


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("upkeep") / "farm") as running:
        running.start_robots(2, trial_s=1.0, log_bytes=5000, truth=True)
        yield running


@pytest.fixture(scope="module")
def done(farm):
    job_id = farm.submit(farm.policy(), trials=4).json()["job_id"]
    farm.wait_for_end(job_id)
    return job_id


def test_a_backup_of_a_running_farm_is_restored_elsewhere_with_the_same_reports_and_goes_on(farm, done, tmp_path):
    running = farm.submit(farm.policy(), trials=MANY, seed=2).json()["job_id"]
    until(lambda: farm.job(running)["trials_done"] > 2, PATIENCE_S, "some trials to be done")
    first = trifarm("backup", "--data", farm.data, "--to", tmp_path / "backup")
    already = farm.job(running)["trials_done"]
    until(lambda: farm.job(running)["trials_done"] > already + 2, PATIENCE_S, "more trials to be done")
    second = upkeep(back_up, farm.data, tmp_path / "backup")
    farm.admin.post(f"/v1/jobs/{running}/cancel")
    assert (first["missing"], second["missing"]) == (0, 0)
    assert 0 < second["copied"] < second["files"]
    report = farm.admin.get(f"/v1/jobs/{done}/report").content
    log = farm.admin.get(f"/v1/trials/{done}-003/log").content
    made = trifarm("restore", "--from", tmp_path / "backup", "--data", tmp_path / "elsewhere")
    assert (made["jobs"], made["reports"]) == (2, 1)
    assert trifarm("doctor", "--data", tmp_path / "elsewhere", "--deep")["healthy"]
    with services(tmp_path / "elsewhere", lease_s=1) as restored:
        assert restored.tokens == farm.tokens
        assert restored.admin.get(f"/v1/jobs/{done}/report").content == report
        assert restored.admin.get(f"/v1/trials/{done}-003/log").content == log
        assert restored.admin.get(f"/v1/jobs/{done}/trials/3/truth").status_code == 200
        # What ran at the time of the backup runs on: its robots are gone, and others take their trials.
        kept = restored.job(running)["trials_done"]
        assert kept > already
        trials = restored.admin.get(f"/v1/jobs/{running}/trials").json()["trials"]
        ran = [each["trial_id"] for each in trials if each["attempts"] and each["state"] != "done"]

        def state_of(trial_id):
            return restored.admin.get(f"/v1/trials/{trial_id}").json()["state"]

        for number in range(4):
            restored.start_robot(f"robot-{number}", trial_s=0.02)
        until(lambda: restored.job(running)["trials_done"] > kept + 10, PATIENCE_S, "others to go on")
        until(lambda: {state_of(each) for each in ran} <= {"done"}, PATIENCE_S, "others to take what ran")


def test_folders_that_cannot_be_used_are_refused_with_a_sentence(farm, done, tmp_path):
    def refused(work, *folders):
        with pytest.raises(UpkeepError) as refusal:
            upkeep(work, *folders)
        return str(refusal.value)

    said = trifarm("backup", "--data", tmp_path, "--to", tmp_path / "b", code=2)["error"]["detail"]
    assert "there is no database" in said
    assert "is not empty and no backup" in refused(back_up, farm.data, farm.data)
    (tmp_path / "half").mkdir()
    assert "is no whole backup" in refused(restore, tmp_path / "half", tmp_path / "new")
    upkeep(back_up, farm.data, tmp_path / "whole")
    assert "is not empty; restore to a new folder" in refused(restore, tmp_path / "whole", farm.data)
    log = next((tmp_path / "whole" / "files" / "sha256").glob("*/*"))
    log.write_bytes(log.read_bytes()[:-1] + b"?")
    assert "is damaged" in refused(restore, tmp_path / "whole", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_doctor_finds_what_was_broken(farm, done, tmp_path):
    def problems(deep=False):
        found = upkeep(look_through, tmp_path / "sick", deep=deep)["findings"]
        return {each["what"] for each in found if each["level"] == "problem"}

    upkeep(back_up, farm.data, tmp_path / "backup")
    upkeep(restore, tmp_path / "backup", tmp_path / "sick")
    assert problems(deep=True) == set()
    trial = farm.admin.get(f"/v1/jobs/{done}/trials").json()["trials"][0]
    log = tmp_path / "sick" / "files" / "sha256" / trial["log_sha256"][:2] / trial["log_sha256"]
    log.write_bytes(b"x" * log.stat().st_size)
    assert problems() == set()
    assert problems(deep=True) == {"content"}
    log.unlink()
    (tmp_path / "sick" / "tokens.json").chmod(0o644)
    assert problems() == {"files", "privacy"}
    import sqlite3

    with sqlite3.connect(tmp_path / "sick" / "farm.sqlite") as connection:
        connection.execute("UPDATE report SET body = body || ' '")
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    assert problems() == {"files", "privacy", "reports", "form"}
    assert not trifarm("doctor", "--data", tmp_path / "sick", code=1)["healthy"]


def test_the_doctor_sees_a_farm_that_services_serve(farm):
    found = {each["what"]: each["text"] for each in upkeep(look_through, farm.data, deep=False)["findings"]}
    assert found["farm"] == "runs"
