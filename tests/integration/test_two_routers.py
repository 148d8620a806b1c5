"""Two routers that know each other: robots at one are heard at the other, and where one is gone its clients go to the other."""

import os
import secrets
import subprocess
import sys
from contextlib import ExitStack, contextmanager

import pytest

from services.joining.session import bus_key
from services.settings import Settings
from tests.homes import scale_settings
from tests.integration.farm_process import PATIENCE_S, ROOT, Services, free_ports, until


@contextmanager
def router(said, own, other, key):
    """A guarded router of its own process, which is killed in the end if it is still there."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
    environment |= {"TRIFARM_BUS_KEY": key, "TRIFARM_BUS_ROBOTS": "4"}
    command = [sys.executable, "-m", "services", "router", "--bus", own, "--bus-routers", other]
    with said.open("wb") as errors:
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=errors)
    try:
        until(lambda: '"routing"' in said.read_text(), PATIENCE_S, "the router")
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def farm(postgres, s3, tmp_path):
    """Services at the first of two routers, robots at the second: (services, the first router)."""
    ends = [f"tls/127.0.0.1:{port}" for port in free_ports(2)]
    settings = scale_settings(postgres, s3) | {"farm_key": secrets.token_hex(32), "renew_every_s": 0.5, "bus_robots": 4}
    key = bus_key(Settings(data=tmp_path, farm_key=settings["farm_key"]))
    with ExitStack() as stack:
        first, _ = (
            stack.enter_context(router(tmp_path / f"router-{at}.txt", own, other, key))
            for at, (own, other) in enumerate((ends, ends[::-1]))
        )
        told = {"bus_connect": ",".join(ends), "bus_addresses": ",".join(reversed(ends))}
        running = Services(tmp_path / "farm", link="tls", **settings, **told)
        stack.callback(running.close)
        running.start()
        running.bus = None  # robots come with what the API tells them
        yield running, first


def test_a_farm_outlives_one_of_its_routers(farm):
    running, first = farm
    running.start_robots(2, trial_s=0.3)
    job_id = running.submit(running.policy(), trials=40).json()["job_id"]
    until(lambda: running.job(job_id)["trials_done"] > 4, PATIENCE_S, "some trials to be done")
    first.kill()
    first.wait()
    assert running.wait_for_end(job_id)["state"] == "succeeded"
    report = running.admin.get(f"/v1/jobs/{job_id}/report").json()
    trials = [row["trials"] for row in report["per_robot"]]
    assert sum(trials) == 40 and min(trials) >= 12, "both are heard; a trial may leave one that comes back late"
    assert report["attempts"] == 40 + report["platform_faults"]
