"""A child's log is begun anew when it has grown large, while the child writes on."""

import sys
import time
from pathlib import Path

import pytest

from client_cli.embedded import child_process
from client_cli.embedded.child_process import LOGS_KEPT, child_environment, clone_command, start_child
from client_cli.terminal.errors import UsageProblem

WRITES = """
import sys, time
for number in range(10**6):
    sys.stderr.write(f"{number:06d}\\n")
    time.sleep(0.002)
"""

HAS_A_CHILD = """
import signal, subprocess, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
takes_long_to_go = "import time; held = bytearray(500_000_000); print('held', flush=True); time.sleep(60)"
own = subprocess.Popen([sys.executable, "-c", takes_long_to_go])
print(own.pid, flush=True)
own.wait()
"""


@pytest.fixture
def child(tmp_path):
    log = tmp_path / "logs" / "services.log"
    log.parent.mkdir()
    log.write_text("of an earlier start\n" * 100)
    started = start_child("services", [sys.executable, "-c", WRITES], child_environment(), log)
    yield started
    started.kill()
    started.wait_for_all(120)


def grown(child, size):
    ends_s = time.monotonic() + 120
    while child.log.stat().st_size < size:
        assert time.monotonic() < ends_s
        time.sleep(0.02)


def test_a_large_log_is_put_aside_and_older_ones_go(child):
    grown(child, 2100)
    child.rotate(10_000)
    assert not child.log.with_name("services.log.1").exists(), "it was not large yet"
    kept = []
    for _ in range(LOGS_KEPT + 2):
        grown(child, 200)
        child.rotate(100)
        kept.append(child.log.with_name("services.log.1").read_text())
    assert kept[0].startswith("of an earlier start")
    grown(child, 70)
    assert child.log.read_text().split("\n")[0].isdigit(), "it writes on at the file's beginning, not behind a hole"
    assert child.tail().split("\n")[-1].isdigit() and "earlier" not in child.tail()
    aside = sorted(each.name for each in child.log.parent.iterdir())
    assert aside == ["services.log", *(f"services.log.{number}" for number in range(1, LOGS_KEPT + 1))]
    assert [child.log.with_name(f"services.log.{number}").read_text() for number in (3, 2, 1)] == kept[-3:]


def test_whoever_is_killed_has_gone_with_its_own_children(tmp_path):
    log = tmp_path / "child.log"
    started = start_child("robots", [sys.executable, "-c", HAS_A_CHILD], child_environment(), log)
    ends_s = time.monotonic() + 120
    while len(log.read_text().split()) < 2:
        assert time.monotonic() < ends_s
        time.sleep(0.02)
    own = next(word for word in log.read_text().split() if word.isdigit())
    started.ask_to_end()
    started.wait(0.2)
    assert not started.has_ended(), "it does not listen"
    started.kill()
    started.wait_for_all(120)
    assert started.has_ended()
    assert not Path("/proc", own).exists()


def test_nobody_waits_for_ever(tmp_path):
    started = start_child("robots", [sys.executable, "-c", "import time; time.sleep(600)"], child_environment(), tmp_path / "log")
    begun_s = time.monotonic()
    started.wait_for_all(0.3)
    assert 0.2 < time.monotonic() - begun_s < 300, "it goes on for longer"
    assert not started.has_ended()
    started.kill()
    started.wait_for_all(120)


def test_a_package_of_the_same_name_in_an_environment_is_not_that_of_a_clone(monkeypatch, tmp_path):
    assert clone_command("chaos", "run")[-3:] == ["-m", "chaos", "run"]
    (tmp_path / "chaos").mkdir()
    monkeypatch.setattr(child_process, "ROOT", tmp_path)
    with pytest.raises(UsageProblem, match="'chaos' is part of trifarm's repository, not of the installed package"):
        clone_command("chaos", "run")
