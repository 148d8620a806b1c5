"""The supervisor with real child processes: two tiny programs of the same module names and flags, first on the path."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import time

import pytest

from api_schemas.environment import OF_SERVICES, OF_THE_COMMAND_LINE
from client_cli.embedded.services_settings import DECIDED, PASSED_ON
from tests import ROOT
from tests.integration.farm_process import PATIENCE_S
from tests.processes import lives
from tests.stalls import stalls

SERVICES = """
import argparse, json, os, pathlib, sys
parser = argparse.ArgumentParser()
parser.add_argument("command", choices=["serve"])
for flag in ("--data", "--host", "--port", "--bus", "--farm", "--physics"):
    parser.add_argument(flag, required=True)
flags = parser.parse_args()
assert not {"TRIFARM_TOKEN", "TRIFARM_ADMIN_TOKEN"} & set(os.environ)
if flags.physics == "file:broken":
    sys.exit("no such physics: broken")
from http.server import BaseHTTPRequestHandler, HTTPServer
import signal
if flags.physics == "file:stubborn":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
data = pathlib.Path(flags.data)
(data / "services-told").write_text(json.dumps({n: v for n, v in os.environ.items() if n.startswith("TRIFARM_")}))
(data / "tokens.json").write_text(json.dumps({"admin": "the-admin", "robot": "the-robot"}))
class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        known = [name.name.removesuffix(".pid") for name in data.glob("robot-*.pid")]
        rows = [{"robot": r, "state": "idle", "pid": 1, "host": "h", "trial": None, "reason": None} for r in known]
        rows += [rows[0] | {"robot": name.stem, "state": "lost"} for name in data.glob("*.lost") if rows]
        body = json.dumps({"robots": rows}).encode()
        self.send_response(200)
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
    def do_DELETE(self):
        (data / f"{self.path.rpartition('/')[2]}.lost").unlink()
        self.send_response(204)
        self.end_headers()
print("serving", flush=True)
HTTPServer((flags.host, int(flags.port)), Handler).serve_forever()
"""
ROBOTS = """
import argparse, os, pathlib, subprocess, sys, time
parser = argparse.ArgumentParser()
for flag in ("--robots", "--api", "--bus", "--farm", "--data", "--physics"):
    parser.add_argument(flag, required=True)
parser.add_argument("--reset")
parser.add_argument("--fault", action="append")
flags = parser.parse_args()
(pathlib.Path(flags.data) / "told").write_text(
    repr((flags.physics, os.environ.get("TRIFARM_FARM_SEED"), flags.reset, flags.fault))
)
assert os.environ["TRIFARM_ROBOT_TOKEN"] == "the-robot"
(pathlib.Path(flags.data) / "robots-told").write_text("\\n".join(n for n in os.environ if n.startswith("TRIFARM_")))
for n in range(int(flags.robots)):
    # Robots that do not notice the end of their parent, so that the supervisor has to see to it.
    robot = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
    (pathlib.Path(flags.data) / f"robot-{n}.pid").write_text(str(robot.pid))
while not (pathlib.Path(flags.data) / "go-away").exists():
    time.sleep(0.02)
sys.exit("the robots went away")
"""
CHECKING = """
import sys
if "no-fault" in sys.argv:
    print("no-fault is no fault")
    sys.exit(2)
"""


@pytest.fixture
def environment(tmp_path):
    for package, program in (("services", SERVICES), ("robot_farm", ROBOTS)):
        folder = tmp_path / "path" / package
        folder.mkdir(parents=True)
        (folder / "__init__.py").touch()
        (folder / "__main__.py").write_text(program)
    (tmp_path / "path" / "robot_farm" / "checking.py").write_text(CHECKING)
    given = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
    paths = f"{tmp_path / 'path'}{os.pathsep}{ROOT}"
    return given | {"PYTHONPATH": paths, "TRIFARM_HOME": str(tmp_path / "home"), "TRIFARM_TOKEN": "mine"}


class Up:
    """A running ``trifarm up``."""

    def __init__(self, environment, tmp_path, *flags):
        self.data = tmp_path / "data"
        tmp_path.mkdir(exist_ok=True)
        for name in ("broken", "stubborn", "short"):
            (tmp_path / f"{name}.toml").touch()
        command = [sys.executable, "-m", "client_cli", "up", "--robots", "2", "--data", str(self.data), "--json", *flags]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, env=environment, cwd=tmp_path, **pipes)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.terminate()
        self.process.communicate(timeout=PATIENCE_S)

    def document(self):
        lines = []
        for line in self.process.stdout:
            lines.append(line)
            if line == "}\n":
                break
        return json.loads("".join(lines))

    def end(self, number):
        """What it says at its end, which comes within five seconds of its being told, where the machine does not stall."""
        start_s = time.monotonic()
        self.process.send_signal(number)
        with stalls() as stalled:
            out, err = self.process.communicate(timeout=PATIENCE_S)
        assert time.monotonic() - start_s < 5 + stalled.seconds
        return out, err

    def robot_is_alive(self, name):
        return lives(int((self.data / f"{name}.pid").read_text()))


def test_robots_that_the_folder_had_the_last_time_are_forgotten(environment, tmp_path):
    (tmp_path / "data").mkdir(mode=0o700)
    for name in ("robot-1", "robot-2", "robot-3"):
        (tmp_path / "data" / f"{name}.lost").touch()
    with Up(environment, tmp_path, "--port", "0") as up:
        assert up.document()["physics"] == "real", "the default"
        assert (up.data / "told").read_text() == repr(("real", None, None, None)), "and a secret seed"
        assert [path.stem for path in up.data.glob("*.lost")] == ["robot-1"], "which is one of two, and comes again"


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.scale), signal.SIGHUP])
def test_a_farm_comes_up_and_goes_down(environment, tmp_path, number):
    """`test_a_second_farm_says_whose_place_it_takes_and_gives_it_back` ends two with SIGTERM."""
    with Up(environment, tmp_path, "--port", "0") as up:
        document = up.document()
        settings = tmp_path / "home" / "settings.json"
        assert document["settings"] == str(settings)
        assert json.loads(settings.read_text()) == {"url": document["url"], "token": "the-admin"}
        assert stat.S_IMODE(settings.stat().st_mode) == 0o600
        assert document["pid"] == up.process.pid
        assert not [path for path in up.data.rglob("*") if path.stat().st_mode & 0o077], "made by us and by the children"
        assert stat.S_IMODE(up.data.stat().st_mode) == 0o700
        assert up.robot_is_alive("robot-0")
        out, err = up.end(number)
        assert up.process.returncode == 0
        assert out == ""
        assert "the farm is stopped" in err
        give_up_s = time.monotonic() + PATIENCE_S  # a grandchild's end may come a moment after its parent's
        while (up.robot_is_alive("robot-0") or up.robot_is_alive("robot-1")) and time.monotonic() < give_up_s:
            time.sleep(0.01)
        assert not up.robot_is_alive("robot-0")
        assert not up.robot_is_alive("robot-1")
    assert "serving" in (tmp_path / "data" / "logs" / "services.log").read_text()


def test_a_second_farm_says_whose_place_it_takes_and_gives_it_back(environment, tmp_path):
    settings = tmp_path / "home" / "settings.json"
    with Up(environment, tmp_path / "first", "--port", "0") as first:
        first.document()
        before = settings.read_text()
        with Up(environment, tmp_path / "second", "--port", "0") as second:
            url = second.document()["url"]
            assert json.loads(settings.read_text())["url"] == url
            _, err = second.end(signal.SIGTERM)
        assert f"no longer the one at {json.loads(before)['url']}, which still answers" in err
        assert settings.read_text() == before
        assert stat.S_IMODE(settings.stat().st_mode) == 0o600
        _, err = first.end(signal.SIGTERM)
        assert "still answers" not in err


def test_a_child_that_will_not_end_is_killed_within_five_seconds(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0", "--physics", "stubborn.toml") as up:
        up.document()
        up.end(signal.SIGTERM)
        assert up.process.returncode == 0


def test_what_the_robots_are_told_is_passed_on_and_kept_but_not_shown(environment, tmp_path):
    flags = ("--physics", "short.toml", "--farm-seed", "7", "--reset", "placement", "--fault", "a", "--fault", "b")
    with Up(environment, tmp_path, "--port", "0", *flags) as up:
        assert up.document()["physics"] == "file:short"
        told = (up.data / "told").read_text()
    copy = up.data / "physics" / "short.toml"
    assert told == repr((str(copy), "7", "placement", ["a", "b"])), "robots have a copy, which stays when the file is moved"
    record = up.data / "up.json"
    assert json.loads(record.read_text()) == {"physics": "physics/short.toml", "farm_seed": 7}
    assert stat.S_IMODE(record.stat().st_mode) == stat.S_IMODE(copy.stat().st_mode) == 0o600


def test_a_fault_that_cannot_be_is_refused_before_anything_starts(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0", "--fault", "no-fault") as up:
        out, err = up.process.communicate(timeout=PATIENCE_S)
    assert up.process.returncode == 2
    assert json.loads(out)["error"] == {"title": "wrong usage", "detail": "no-fault is no fault", "exit_code": 2}
    assert "error: no-fault is no fault" in err and "usage" not in err
    assert not up.data.exists()


def test_settings_of_the_services_reach_the_services_alone(environment, tmp_path):
    chosen = {"TRIFARM_WEBHOOKS": "true", "TRIFARM_REQUESTS_PER_S": "7"}
    decided = {"TRIFARM_DATABASE_URL": "postgresql://elsewhere", "TRIFARM_ADMIN_TOKEN": "x", "TRIFARM_WEBHOKS": "true"}
    with Up(environment | chosen | decided, tmp_path, "--port", "0") as up:
        up.document()
        assert json.loads((up.data / "services-told").read_text()) == chosen
        assert (up.data / "robots-told").read_text() == "TRIFARM_ROBOT_TOKEN"
        _, err = up.end(signal.SIGTERM)
    assert "not used here" in err and all(name in err for name in decided)
    warned = "warning: no program of trifarm reads TRIFARM_WEBHOKS; did you mean TRIFARM_WEBHOOKS?"
    assert warned in err
    assert not any(name in err.replace(warned, "") for name in (*chosen, "TRIFARM_HOME", "TRIFARM_TOKEN"))


def test_every_setting_of_the_services_is_either_passed_on_or_decided_here():
    assert DECIDED <= OF_SERVICES
    assert not PASSED_ON & (DECIDED | OF_THE_COMMAND_LINE)


def test_an_unknown_physics_is_refused_before_anything_starts(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0", "--physics", "absent") as up:
        _, err = up.process.communicate(timeout=PATIENCE_S)
    assert up.process.returncode == 2
    assert "choose from nominal, mild, real" in err
    assert not up.data.exists()


def test_a_second_farm_on_the_same_folder_is_refused(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0") as up:
        up.document()
        with Up(environment, tmp_path, "--port", "0") as second:
            out, err = second.process.communicate(timeout=PATIENCE_S)
            assert second.process.returncode == 2
            assert f"process {up.process.pid}" in err
            assert "already runs on" in json.loads(out)["error"]["detail"]
        assert up.process.poll() is None


def test_a_busy_port_is_named(environment, tmp_path):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        with Up(environment, tmp_path, "--port", str(port)) as up:
            _, err = up.process.communicate(timeout=PATIENCE_S)
    assert up.process.returncode == 2
    assert f"port {port} of 127.0.0.1 cannot be used" in err
    assert "--port" in err


def test_a_child_that_dies_at_start_shows_its_last_words(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0", "--physics", "broken.toml") as up:
        out, err = up.process.communicate(timeout=PATIENCE_S)
    assert up.process.returncode == 1
    assert "the services ended with code 1" in err
    assert "no such physics: broken" in json.loads(out)["error"]["detail"]


def test_a_child_that_dies_later_ends_the_farm(environment, tmp_path):
    with Up(environment, tmp_path, "--port", "0", "--physics", "short.toml") as up:
        document = up.document()
        (up.data / "go-away").touch()
        out, err = up.process.communicate(timeout=PATIENCE_S)
        assert document["robots"] == 2
        assert out == ""
        assert up.process.returncode == 1
        assert "the robots ended with code 1" in err
        assert "the robots went away" in err
        assert not up.robot_is_alive("robot-0")
