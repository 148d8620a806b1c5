"""Leases are renewed while their attempt goes on, and left to end when it hangs or does not stop."""

import threading
import time

import pytest

from robot_farm.link import lease_keeper
from robot_farm.link.api_link import PART_BYTES, ApiLink
from robot_farm.link.lease_keeper import CANCELLED, LeaseKeeper
from robot_farm.policy.jail import ACTION_WALL_S, START_WALL_S
from tests.unit.robot_farm.link.lease_api import LEASE_S, excitation_lease, serving, wait_until


@pytest.fixture
def keeper(api, clock):
    with ApiLink(api.url, "token") as link, LeaseKeeper(link, excitation_lease(), clock.monotonic()) as keeper:
        yield keeper


def renewals(api):
    return len(api.times("/renew"))


def no_more_renewals(api):
    count = renewals(api)
    time.sleep(1.5 * LEASE_S / 3)  # there is one every third of it
    return renewals(api) == count


def test_an_attempt_that_asks_is_renewed_and_one_that_hangs_is_not(api, keeper, clock, monkeypatch):
    monkeypatch.setattr(lease_keeper, "SILENT_FOR_S", 1.0)
    goes_on_until_s = clock.monotonic() + 1.5
    while clock.monotonic() < goes_on_until_s or renewals(api) < 3:
        assert keeper.stop_reason() is None
        time.sleep(0.05)
    assert keeper.hangs is None
    wait_until(lambda: keeper.hangs is not None)
    assert no_more_renewals(api)
    assert "hung for 1 s" in keeper.stop_reason() and not keeper.cancelled


def test_one_that_sends_a_file_does_not_hang(keeper, clock, monkeypatch):
    monkeypatch.setattr(lease_keeper, "SILENT_FOR_S", 1.0)
    goes_on_until_s = clock.monotonic() + 1.7
    while clock.monotonic() < goes_on_until_s:
        assert keeper.holds()
        time.sleep(0.05)
    assert keeper.hangs is None


def test_a_cancelled_attempt_has_only_so_long_to_stop_however_often_it_is_told(api, keeper, monkeypatch):
    monkeypatch.setattr(lease_keeper, "STOPS_WITHIN_S", 1.0)
    api.cancel = True
    wait_until(lambda: keeper.stop_reason() == CANCELLED)
    assert not keeper.holds()
    while keeper.hangs is None:
        assert keeper.stop_reason() == CANCELLED, "it asks, and goes on"
        keeper.cancel()
        time.sleep(0.05)
    assert "cancellation" in keeper.hangs and keeper.cancelled
    assert no_more_renewals(api)


def test_the_start_of_a_policy_is_no_hanging():
    assert lease_keeper.SILENT_FOR_S > 2 * START_WALL_S + ACTION_WALL_S


@pytest.mark.parametrize("is_cancelled", [False, True])
def test_a_run_that_blocks_loses_its_lease(api, robot, monkeypatch, is_cancelled):
    monkeypatch.setattr(lease_keeper, "STOPS_WITHIN_S" if is_cancelled else "SILENT_FOR_S", 0.75)
    disk_is_back = threading.Event()

    def blocked(*_, **__):
        assert disk_is_back.wait(60)
        raise OSError("the disk was away")

    monkeypatch.setattr("robot_farm.robot.run_trial", blocked)
    with serving(robot, api):
        try:
            wait_until(lambda: renewals(api) >= 1)
            if is_cancelled:
                robot._cancel("j1-000", 1)
            wait_until(lambda: robot._keeper is not None and robot._keeper.hangs is not None)
            assert no_more_renewals(api)
        finally:
            disk_is_back.set()


def test_each_part_of_a_file_that_is_sent_and_of_a_graph_that_is_fetched_is_noticed(api, tmp_path):
    log, noticed = tmp_path / "log.mcap", []
    log.write_bytes(bytes(5 * PART_BYTES))
    with ApiLink(api.url, "token") as link:
        link.upload_log(excitation_lease(), log, noticed.append)
        assert len(noticed) >= 5
        noticed.clear()
        with pytest.raises(ValueError, match="SHA-256"):
            link.fetch_graph("1" * 64, "2" * 64, tmp_path, noticed.append)
        assert len(noticed) >= 2, "before the try, and with what came"
