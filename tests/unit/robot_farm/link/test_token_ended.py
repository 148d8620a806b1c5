"""A robot whose token is revoked in the middle of a trial stops at once and ends, and brings nothing home."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from api_schemas.robot import Lease
from robot_farm.link.api_link import ApiLink, TokenEndedError
from robot_farm.link.bus_link import Accepted
from robot_farm.robot import Robot
from robot_farm.settings import TOKEN_VARIABLE, parse
from tests.unit.robot_farm.link.lease_api import SilentBus, endless_trial

LEASE_S = 1.5


class Api(BaseHTTPRequestHandler):
    """Renews a lease until the trial has begun, and then knows the token no more."""

    asked: list
    steps: list

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.asked.append(self.path)
        status, body = (200, {"lease_s": LEASE_S, "cancel": False}) if not self.steps else (401, {"detail": "revoked"})
        self.send_response(status)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    do_PUT = do_POST

    def log_message(self, *_):
        pass


@pytest.fixture
def api():
    handler = type("Asked", (Api,), {"asked": [], "steps": []})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", handler.asked, handler.steps
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_token_that_ends_in_the_middle_of_a_trial_ends_trial_and_robot(api, clock, tmp_path, monkeypatch):
    url, asked, steps = api
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    settings = parse(["--api", url, "--data", str(tmp_path), "--physics", "nominal", "--robot", "robot-0"])
    said, bus = [], SilentBus()
    robot = Robot("robot-0", settings, said.append)
    monkeypatch.setattr("robot_farm.robot.run_trial", endless_trial(steps))
    lease = Lease(
        trial_id="j1-000", job_id="j1", ordinal=0, fence=1, robot="robot-0", task="identify", excitation="slow_ramps", seed=1,
        lease_s=LEASE_S,
    )  # fmt: skip
    with ApiLink(url, "token") as link, pytest.raises(TokenEndedError, match="401"):
        robot._serve(Accepted(lease, clock.monotonic()), link, bus, threading.Event())
    assert steps and steps[-1] - steps[0] < LEASE_S, "it stopped before its lease ran out"
    assert set(asked) == {"/v1/leases/j1-000/renew"}, "nothing was uploaded or reported"
    assert bus.said[-1] == "free" and not list(tmp_path.rglob("*.mcap"))
