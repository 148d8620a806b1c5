"""A child's log is begun anew when it has grown large, while the child writes on."""

import sys
import time

import pytest

from client_cli.child_process import LOGS_KEPT, child_environment, start_child

WRITES = """
import sys, time
for number in range(10**6):
    sys.stderr.write(f"{number:06d}\\n")
    time.sleep(0.002)
"""


@pytest.fixture
def child(tmp_path):
    log = tmp_path / "logs" / "services.log"
    log.parent.mkdir()
    log.write_text("of an earlier start\n" * 100)
    started = start_child("services", [sys.executable, "-c", WRITES], child_environment(), log)
    yield started
    started.end_now()


def grown(child, size):
    ends_s = time.monotonic() + 20
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
