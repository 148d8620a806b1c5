"""A robot, and an API beside it that does as a test tells it."""

import pytest

from robot_farm.link import api_link, lease_keeper
from robot_farm.robot import Robot
from robot_farm.settings import TOKEN_VARIABLE, parse
from tests.stalls import steady_clock
from tests.unit.robot_farm.link.lease_api import lease_api


@pytest.fixture
def clock(monkeypatch):
    """That of leases and of requests: what a machine stalls ends none of them."""
    with steady_clock() as clock:
        monkeypatch.setattr(lease_keeper, "time", clock)
        monkeypatch.setattr(api_link, "time", clock)
        yield clock


@pytest.fixture
def api():
    with lease_api() as api:
        yield api


@pytest.fixture
def robot(api, clock, tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    given = ["--api", api.url, "--data", str(tmp_path), "--physics", "nominal", "--robot", "robot-0"]
    return Robot("robot-0", parse(given), print)
