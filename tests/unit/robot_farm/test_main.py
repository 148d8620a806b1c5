"""The processes of robots keep to themselves what they know."""

import json
import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from robot_farm.settings import FARM_SEED_VARIABLE, TOKEN_VARIABLE

NEEDED = ["--api", "http://127.0.0.1:1", "--bus", "tcp/127.0.0.1:1"]
WITHIN_S = 120.0
_LOOK = """
import ctypes, os, sys
from robot_farm import __main__ as main, robot

class Robot:
    def __init__(self, name, settings, say):
        open(settings.data / "written", "w").close()
        print("mode", oct((settings.data / "written").stat().st_mode & 0o777), "dumpable", ctypes.CDLL(None).prctl(3))
        print("seed", settings.farm_seed)
        print("left", sorted(name for name in os.environ if "RESERV_" in name))

    def live_until(self, stop):
        pass

robot.Robot = Robot
sys.exit(main.main())
"""


def test_a_robots_files_and_memory_are_its_own(tmp_path):
    """The process as it is started, with a robot in it that only says what it sees."""
    command = [sys.executable, "-c", _LOOK, "--robot", "robot-0", *NEEDED, "--data", str(tmp_path), "--physics", "nominal"]
    environment = os.environ | {TOKEN_VARIABLE: "token", FARM_SEED_VARIABLE: "41", "TRIFARM_ROBOT_RESERV_BYTES": "0"}
    said = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=WITHIN_S, check=True).stdout
    assert "mode 0o600 dumpable 0" in said
    assert "seed 41" in said
    assert "no program of trifarm reads TRIFARM_ROBOT_RESERV_BYTES; did you mean TRIFARM_ROBOT_RESERVE_BYTES?" in said
    assert "left []" in said, "a supervisor's robots would say it again"


def test_no_command_line_of_a_robot_has_the_farms_seed(tmp_path):
    """Real robots under a real supervisor; what anybody on the machine can read of them."""
    flags = ["--farm-seed", "907711", "--farm-seed=907712"]
    with (
        _api() as url,
        subprocess.Popen(
            [sys.executable, "-m", "robot_farm", "--robots", "2", *NEEDED, "--api", url, "--data", str(tmp_path), *flags],
            env=os.environ | {TOKEN_VARIABLE: "token"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as supervisor,
    ):
        try:
            lines = _children(supervisor.pid, 2)
        finally:
            supervisor.terminate()
    assert sum(" -m robot_farm --robot robot-" in line for line in lines) == 2
    assert len(lines) == 3, "the warm parent and two robots"
    assert not any("90771" in line or "--farm-seed" in line for line in lines)


class _Joining(BaseHTTPRequestHandler):
    """Gives each robot that joins a token."""

    def do_POST(self):
        token = {"token_id": "t", "owner": "farm", "scopes": ["robot"], "created_at": "now", "secret": "trifarm_t_secret"}
        body = json.dumps(token | {"expires_at": None, "last_used_at": None, "revoked_at": None}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


@contextmanager
def _api():
    with ThreadingHTTPServer(("127.0.0.1", 0), _Joining) as server:
        serving = threading.Thread(target=server.serve_forever, daemon=True)
        serving.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        serving.join()


def _children(pid: int, count: int) -> list[str]:
    give_up_s = time.monotonic() + WITHIN_S
    while time.monotonic() < give_up_s:
        pids = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        lines = [Path(f"/proc/{child}/cmdline").read_text().replace("\0", " ") for child in pids]
        if sum("--robot robot-" in line for line in lines) == count:
            return lines
        time.sleep(0.05)
    raise AssertionError("the robots were not started")
