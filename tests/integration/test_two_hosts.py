"""Robots on one host, services on the other, with an address and a token between them: https, a guarded bus, access rules."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from tests.integration.farm_process import PATIENCE_S, ROOT, services, until
from tests.integration.two_hosts import hosts, https_files  # noqa: F401  a fixture

SCRIPTED = Path(__file__).parent / "scripted_robot.py"
ATTACK = """
import json, sys, time, zenoh
from api_schemas import bus
from tests.integration.scripted_robot import admitted

api, token, ca = sys.argv[1:]
session = zenoh.open(zenoh.Config.from_json5(admitted(api, token, "robot-0", ca)))
forged = bus.Heartbeat(robot="robot-7", instance="forged", pid=1, host="x", state="idle").model_dump_json()
own = forged.replace("robot-7", "robot-0")
alive = session.liveliness().declare_token(bus.alive_key("farm", "robot-7"))
for _ in range(20):
    session.put(bus.heartbeat_key("farm", "robot-7"), forged)
    session.put(bus.heartbeat_key("farm", "robot-0"), own)
    time.sleep(0.05)
session.close()
"""


@contextmanager
def robots(farm, begin, ca, token, count):
    """Scripted robots on the other host, which are told an address and a token."""
    environment = os.environ | {"TRIFARM_ROBOT_TOKEN": token, "TRIFARM_CA": str(ca)}
    command = [*begin, sys.executable, str(SCRIPTED)]
    running = [
        subprocess.Popen([*command, f"robot-{number}", "--api", farm.api], cwd=ROOT, env=environment, stderr=subprocess.PIPE)
        for number in range(count)
    ]
    try:
        yield running
    finally:
        for each in running:
            each.terminate()
        for each in running:
            each.communicate(timeout=PATIENCE_S)


def test_robots_of_another_host_do_a_job_and_strangers_get_nothing(hosts, tmp_path):  # noqa: F811
    https = https_files(tmp_path, hosts.address)
    with services(tmp_path / "farm", host=hosts.address, link="tls", through=hosts.services, bus_robots=10, **https) as farm:
        ca = https["tls_certificate"]
        with robots(farm, hosts.robots, ca, "trifarm_x_wrong", 1) as (refused,):
            assert refused.wait(PATIENCE_S) != 0
            assert b"401" in refused.stderr.read()
        assert farm.admin.get("/v1/robots").json()["robots"] == []

        own = farm.client(farm.tokens["robot"]).post("/v1/robots/robot-0/token").json()["secret"]
        attack = [*hosts.robots, sys.executable, "-c", ATTACK, farm.api, own, str(ca)]
        subprocess.run(attack, cwd=ROOT, check=True, timeout=120)
        until(lambda: farm.robots_in("lost", "idle") > 0, PATIENCE_S, "what robot-0 said of itself to be heard")
        assert [each["robot"] for each in farm.admin.get("/v1/robots").json()["robots"]] == ["robot-0"]

        with robots(farm, hosts.robots, ca, farm.tokens["robot"], 2):
            until(lambda: farm.robots_in("idle") == 2, PATIENCE_S, "two robots")
            ended = farm.wait_for_end(farm.submit(farm.policy(), trials=12).json()["job_id"])
        assert ended["state"] == "succeeded"
        report = farm.admin.get(f"/v1/jobs/{ended['job_id']}/report").json()
        assert len(report["per_trial"]) == 12
        assert {row["robot"] for row in report["per_trial"]} == {"robot-0", "robot-1"}, json.dumps(report["per_trial"])
