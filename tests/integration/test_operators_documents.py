"""The operators' pages as they are followed: their commands in their own order, at the addresses of this machine."""

import os
import re
import secrets
import shlex
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from robot_farm import settings as robot_settings
from services.__main__ import parsed
from tests.integration.farm_process import PATIENCE_S, ROOT, free_ports, until

PAGES = ("scale.md", "running-a-farm.md", "jail.md")
PYTHON = "python -m "


def blocks(page):
    """Lines of the page's blocks of commands, without comments."""
    text = (ROOT / "docs" / page).read_text()
    found = re.findall(r"^```(?:console|sh)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [[line.partition(" #")[0].rstrip() for line in block.splitlines() if line.strip()] for block in found]


def split(line):
    """Variables and words of a command."""
    words = shlex.split(line)
    given = []
    while words and re.match(r"[A-Z_]+=", words[0]):
        given.append(words.pop(0))
    return dict(each.split("=", 1) for each in given), words


COMMANDS = [line for page in PAGES for block in blocks(page) for line in block if PYTHON in line]


def test_the_pages_have_commands():
    assert len(COMMANDS) >= 8


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_can_be_given(line, monkeypatch):
    given, words = split(line)
    for name in [each for each in os.environ if each.startswith("TRIFARM_")]:
        monkeypatch.delenv(name)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    module, arguments = words[2], words[3:]
    if module == "services":
        assert parsed(arguments)[0] in {"serve", "dispatch", "router", "bus-key"}
    else:
        assert module == "robot_farm" and robot_settings.parse(arguments).api.startswith("http")


class Shell:
    """One terminal in which a page is followed; owner of what was exported and of what runs."""

    def __init__(self, folder: Path, instead: dict[str, str]) -> None:
        self.folder, self.instead, self.running = folder, instead, []
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
        self.environment["PYTHONPATH"] = str(ROOT)

    def say(self, line: str, **blanks: str) -> subprocess.Popen | None:
        """Exports, or starts what goes on; ``blanks`` are what the page leaves to the reader."""
        for there, here in self.instead.items():
            line = line.replace(there, here)
        given, words = split(line.removeprefix("export "))
        given = {name: blanks.get(name, value) for name, value in given.items()}
        assert "…" not in "".join([*given.values(), *words]), line
        if not words:
            self.environment |= given
            return None
        log = (self.folder / f"{len(self.running)}.log").open("wb")
        command = [sys.executable, *words[1:]]
        with log:
            process = subprocess.Popen(command, env=self.environment | given, cwd=self.folder, stdout=log, stderr=log)
        self.running.append(process)
        return process

    def ask(self, *arguments: str) -> subprocess.CompletedProcess:
        """Runs a command to its end."""
        told = {"env": self.environment, "cwd": self.folder, "capture_output": True, "text": True, "timeout": PATIENCE_S}
        return subprocess.run([sys.executable, *arguments], check=False, **told)

    def logs(self) -> str:
        """What all said."""
        return "\n".join(path.read_text() for path in sorted(self.folder.glob("*.log")))

    def close(self) -> None:
        """Ends what runs, the last first."""
        for process in reversed(self.running):
            process.terminate()
            process.wait(PATIENCE_S)


def test_robots_on_other_hosts_in_the_pages_own_order(tmp_path):
    bus_port, port = free_ports(2)
    robots, services = (each for each in blocks("scale.md") if "TRIFARM_FARM_SEED" in each[0] or "TRIFARM_FARM_KEY" in each[0])
    instead = {"farm.example.org": "localhost", "0.0.0.0:7447": f"127.0.0.1:{bus_port}", ":7447": f":{bus_port}"}
    instead |= {"https://": "http://", ":8787": f":{port}", "/data": str(tmp_path / "data")}
    token = f"trifarm_page.robot_{secrets.token_hex(32)}"
    shell = Shell(tmp_path, instead)
    try:
        shell.say(robots[0], TRIFARM_FARM_SEED="7")
        shell.say(f"{robots[1]} --robots 1 --physics nominal --data {tmp_path / 'robots'}", TRIFARM_ROBOT_TOKEN=token)
        shell.say(services[0], TRIFARM_FARM_KEY=secrets.token_hex(32))
        shell.say(services[1])
        shell.say(services[2], TRIFARM_BUS_KEY=shell.ask("-m", "services", "bus-key").stdout.strip())
        shell.environment |= {"TRIFARM_ROBOT_TOKEN": token, "TRIFARM_ADMIN_TOKEN": token.replace("robot", "admin")}
        shell.say(f"{services[3]} --host localhost --port {port}")
        own = {"Authorization": f"Bearer {token.replace('robot', 'admin')}"}
        with httpx.Client(base_url=f"http://localhost:{port}", headers=own, trust_env=False) as client:
            until(lambda: _in_service(client) == ["robot-4"], PATIENCE_S, f"the robot to join: {shell.logs()}")
    finally:
        shell.close()
    assert "Traceback" not in shell.logs(), shell.logs()


def _in_service(client):
    try:
        return [each["robot"] for each in client.get("/v1/robots").json()["robots"] if each["state"] == "idle"]
    except httpx.TransportError:
        time.sleep(0.2)
        return []


def test_a_router_that_is_not_there_is_a_sentence(tmp_path):
    (bus_port,) = free_ports(1)
    shell = Shell(tmp_path, {})
    where = ("--data", str(tmp_path / "d"), "--bus-connect", f"tcp/127.0.0.1:{bus_port}", "--port", "0")
    sooner = "from services.dispatcher import bus; bus.ROUTER_WITHIN_S = 1.0; from services.__main__ import main; main()"
    ended = shell.ask("-c", sooner, "serve", *where)
    assert ended.returncode == 1 and "Traceback" not in ended.stderr
    assert "nobody answered on the bus" in ended.stderr and "services router" in ended.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("serve", "--port", "99999"), "TRIFARM_PORT: input should be less than or equal to 65535"),
        (("router", "--bus", "nonsense"), "the bus cannot listen"),
    ],
)
def test_a_wrong_setting_is_a_sentence(tmp_path, arguments, words):
    ended = Shell(tmp_path, {}).ask("-m", "services", *arguments)
    assert ended.returncode in {1, 2} and "Traceback" not in ended.stderr and words in ended.stderr
