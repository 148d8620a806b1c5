"""A backup that is repeated looks at what it copied before."""

import hashlib
import json
import os
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import pytest

from services.upkeep import __main__ as program
from services.upkeep.backup import back_up, restore
from services.upkeep.folder import UpkeepError, object_path, references
from tests.disk_steps import noted_steps

LOG = b"what a robot measured"
SHA256 = hashlib.sha256(LOG).hexdigest()


@pytest.fixture
def data(tmp_path):
    """A farm's folder with one log, no more of a database than backups read, and a file of physics."""
    data = tmp_path / "farm"
    log = object_path(data, SHA256)
    log.parent.mkdir(parents=True)
    log.write_bytes(LOG)
    with sqlite3.connect(data / "farm.sqlite") as database:
        for table, columns in (
            ("policy", "weights_sha256, graph_sha256"),
            ("trial", "job_number, log_sha256, truth_sha256"),
            ("attempt", "log_sha256, truth_sha256"),
            ("alembic_version", "version_num"),
            ("job", "number, state"),
            ("report", "number"),
        ):
            database.execute(f"CREATE TABLE {table} ({columns})")
        database.execute("INSERT INTO job VALUES (1, 'succeeded')")
        database.execute("INSERT INTO trial VALUES (1, ?, NULL)", (SHA256,))
        database.execute("INSERT INTO attempt VALUES (?, NULL)", (SHA256,))
        database.execute("INSERT INTO alembic_version VALUES ('0001')")
    database.close()
    (data / "physics").mkdir()
    (data / "physics" / "mine.toml").write_text("about = 'mine'")
    return data


def counts(made):
    return made["files"], made["copied"], made["mended"], made["missing"]


def test_a_damaged_copy_is_replaced_and_that_is_said(data, tmp_path):
    assert counts(back_up(data, tmp_path / "backup")) == (1, 1, 0, 0)
    assert counts(back_up(data, tmp_path / "backup")) == (1, 0, 0, 0)
    copy = object_path(tmp_path / "backup", SHA256)
    copy.write_bytes(b"?" + LOG[1:])  # of the same length
    assert counts(back_up(data, tmp_path / "backup")) == (1, 1, 1, 0)
    assert copy.read_bytes() == LOG
    copy.write_bytes(LOG[:-1])
    assert counts(back_up(data, tmp_path / "backup")) == (1, 1, 1, 0)
    restore(tmp_path / "backup", tmp_path / "new")
    assert object_path(tmp_path / "new", SHA256).read_bytes() == LOG
    assert (tmp_path / "new" / "physics" / "mine.toml").read_text() == "about = 'mine'"


@pytest.mark.parametrize(("state", "is_needed"), [("failed", True), ("cancelled", False)])
def test_a_log_that_retention_may_take_is_not_needed(data, state, is_needed):
    with sqlite3.connect(data / "farm.sqlite") as database:
        database.execute("UPDATE job SET state = ?", (state,))
        found = references(database)
    database.close()
    assert (found.needed, found.others) == (
        (frozenset({SHA256}), frozenset()) if is_needed else (frozenset(), frozenset({SHA256}))
    )


def test_a_damaged_source_is_named_with_the_command_that_finds_all(data, tmp_path):
    object_path(data, SHA256).write_bytes(b"?" + LOG[1:])
    with pytest.raises(UpkeepError, match=f"doctor --deep --data {data}'"):
        back_up(data, tmp_path / "backup")


@pytest.mark.parametrize("inside", ["sub", "files/deep/sub"])
def test_a_backup_inside_the_farms_folder_is_refused(data, inside):
    with pytest.raises(UpkeepError, match="name a folder elsewhere"):
        back_up(data, data / inside)
    assert not (data / inside).exists()


def add_log(data, content):
    """One more job with a log; gives the log's path."""
    sha256 = hashlib.sha256(content).hexdigest()
    log = object_path(data, sha256)
    log.parent.mkdir(parents=True, exist_ok=True)
    log.write_bytes(content)
    with sqlite3.connect(data / "farm.sqlite") as database:
        number = database.execute("SELECT count(*) + 1 FROM job").fetchone()[0]
        database.execute("INSERT INTO job VALUES (?, 'succeeded')", (number,))
        database.execute("INSERT INTO trial VALUES (?, ?, NULL)", (number, sha256))
    database.close()
    return log


def test_a_backup_outlives_a_later_one_that_meets_a_damaged_log(data, tmp_path):
    back_up(data, tmp_path / "backup")
    add_log(data, b"more").write_bytes(b"?ore")
    with pytest.raises(UpkeepError, match="is damaged"):
        back_up(data, tmp_path / "backup")
    assert restore(tmp_path / "backup", tmp_path / "new")["jobs"] == 1


def damage(database):
    """Writes over all pages behind the first."""
    whole = database.read_bytes()
    database.write_bytes(whole[:4096] + b"?" * (len(whole) - 4096))


def test_a_damaged_database_is_not_copied_over_a_whole_one(data, tmp_path):
    back_up(data, tmp_path / "backup")
    damage(data / "farm.sqlite")
    with pytest.raises(UpkeepError, match=f"'trifarm doctor --data {data}'"):
        back_up(data, tmp_path / "backup")
    assert restore(tmp_path / "backup", tmp_path / "new")["jobs"] == 1


def test_what_a_record_vouches_for_is_on_the_disk_before_it(data, tmp_path, monkeypatch):
    steps = noted_steps(monkeypatch)
    monkeypatch.setattr(os, "sync", lambda: steps.append(("synced", "all")))
    back_up(data, tmp_path / "backup")
    named = [step for step in steps if step[0] == "named" or step == ("synced", "all")]
    assert named[-3:] == [("synced", "all"), ("named", "backup.json"), ("named", "farm.sqlite")]
    assert ("named", SHA256) in named[:-3]


def full_sqlite():
    """SQLite's own error of a full disk."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("PRAGMA max_page_count = 1")
        with pytest.raises(sqlite3.OperationalError) as raised:
            database.execute("CREATE TABLE too_much (number)")
    return raised.value


BACKUP, RESTORE = ("backup", "back_up", "--to"), ("restore", "restore", "--from")


@pytest.mark.parametrize(
    ("command", "error", "said", "is_of_backup"),
    [
        (BACKUP, full_sqlite(), "the disk of {} is full", True),
        (BACKUP, OSError(28, "No space left on device", "a", None, "b"), "the disk of {} is full", True),
        (RESTORE, full_sqlite(), "the disk of {} is full", False),
        (RESTORE, sqlite3.OperationalError("disk I/O error"), "disk I/O error; see that the backup {} can be read", True),
        (BACKUP, sqlite3.OperationalError("disk I/O error"), "disk I/O error; 'trifarm doctor --data {}' says", False),
    ],
)
def test_the_folder_that_is_at_fault_is_named(command, error, said, is_of_backup, tmp_path, monkeypatch, capsys):
    def failing(*_):
        raise error

    monkeypatch.setattr(program, command[1], failing)
    data, backup = tmp_path / "farm", tmp_path / "backup"
    monkeypatch.setattr(sys, "argv", ["upkeep", command[0], "--data", str(data), command[2], str(backup)])
    assert program.main() == 1
    told = json.loads(capsys.readouterr().out)["error"]
    named, other = (backup, data) if is_of_backup else (data, backup)
    assert said.format(named) in told
    assert str(other) not in told


def test_what_sqlite_refuses_is_said_as_an_error(data, tmp_path, monkeypatch, capsys):
    (data / "farm.sqlite").unlink()
    with sqlite3.connect(data / "farm.sqlite") as database:
        database.execute("CREATE TABLE of_another_program (number)")
    database.close()
    monkeypatch.setattr(sys, "argv", ["upkeep", "backup", "--data", str(data), "--to", str(tmp_path / "backup")])
    assert program.main() == 1
    assert "no such table" in json.loads(capsys.readouterr().out)["error"]


@pytest.mark.parametrize("cut_off_at", range(4))
def test_a_backup_that_is_cut_off_anywhere_leaves_one_that_can_be_restored(data, tmp_path, monkeypatch, cut_off_at):
    back_up(data, tmp_path / "backup")
    add_log(data, b"more")
    replace, names = Path.replace, []

    def cut_off(path, target):
        if len(names) == cut_off_at:
            raise KeyboardInterrupt
        names.append(target.name)
        return replace(path, target)

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Path, "replace", cut_off)
        back_up(data, tmp_path / "backup")
    assert restore(tmp_path / "backup", tmp_path / "new")["jobs"] == (2 if "backup.json" in names else 1)
    assert back_up(data, tmp_path / "backup")["files"] == 2
    assert not (tmp_path / "backup" / "farm.new").exists()
    assert restore(tmp_path / "backup", tmp_path / "newer")["jobs"] == 2
