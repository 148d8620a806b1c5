"""The bus of an embedded farm: a stranger on the same machine can neither pretend to be a robot nor add one."""

import errno
import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from client_cli.embedded.private_bus import private_bus
from tests.integration.farm_process import PATIENCE_S, Services, until

NOBODY = 65534
ATTACK = """
import os, socket, sys, time
import zenoh
from api_schemas import bus

endpoint, uid, robot = sys.argv[1], int(sys.argv[2]), sys.argv[3]
if uid:
    os.setgroups([])
    os.setgid(uid)
    os.setuid(uid)
    with socket.socket(socket.AF_UNIX) as raw:
        print(raw.connect_ex(endpoint.partition("/")[2]), flush=True)
config = zenoh.Config.from_json5(bus.session_config_json(mode="client", connect=[endpoint]))
config.insert_json5("connect/timeout_ms", "1000" if uid else "100000")  # whoever is let in is waited for
with zenoh.open(config) as session:
    token = session.liveliness().declare_token(bus.alive_key("farm", robot))
    beat = bus.Heartbeat(robot=robot, instance="stranger", pid=1, host="elsewhere", state="idle")
    for _ in range(8):
        session.put(bus.heartbeat_key("farm", robot), beat.model_dump_json())
        time.sleep(0.25)
"""


def attack(endpoint: str, uid: int, robot: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-c", ATTACK, endpoint, str(uid), robot]
    return subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=PATIENCE_S, check=False)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_user_cannot_join_the_bus_and_ours_can():
    with tempfile.TemporaryDirectory() as folder, private_bus(Path(folder) / "data") as endpoint:
        data = Path(folder) / "data"
        data.mkdir()
        for each in (Path(folder), data):
            each.chmod(0o755)  # others may look in: the socket itself keeps them out
        services = Services(data)
        services.bus = endpoint
        services.start()
        try:
            assert attack(endpoint, 0, "robot-8").returncode == 0, "the attack works where it is let in"
            until(lambda: "robot-8" in seen(services), PATIENCE_S, "the robot that our own user added")
            told = seen(services)["robot-8"]
            for robot in ("robot-8", "robot-9"):
                refused = attack(endpoint, NOBODY, robot)
                assert (refused.returncode, refused.stdout.strip()) == (1, str(errno.EACCES)), refused.stderr
            assert set(seen(services)) == {"robot-8"} and seen(services)["robot-8"]["last_seen_at"] == told["last_seen_at"]
        finally:
            services.close()


def seen(services: Services) -> dict:
    return {each["robot"]: each for each in services.admin.get("/v1/robots").json()["robots"]}


def test_a_path_that_no_socket_can_have_gets_a_private_folder(tmp_path):
    for data in (tmp_path / ("long" * 25), tmp_path / "a,b#c"):
        data.mkdir()
        with private_bus(data) as endpoint:
            folder = Path(endpoint.partition("/")[2]).parent
            assert len(endpoint) < 108 and folder != data
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert not folder.exists()
