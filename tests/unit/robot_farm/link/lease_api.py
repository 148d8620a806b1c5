"""The API as a robot with a lease meets it, on loopback: it answers as a test tells it, and notes what it was asked."""

import json
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from api_schemas.robot import Lease
from robot_farm.link import lease_keeper
from robot_farm.link.api_link import ApiLink
from robot_farm.link.bus_link import Accepted
from robot_farm.link.lease_keeper import TrialStoppedError

LEASE_S = 1.5


class SilentBus:
    """Notes what the robot says it does."""

    def __init__(self):
        self.said = []

    def __getattr__(self, name):
        return lambda *_: self.said.append(name)


class LeaseApi:
    """Renewals are answered with ``status`` and ``cancel``, files and outcomes with ``of_files``; 0 is no answer at all."""

    def __init__(self, url):
        self.url, self.status, self.of_files, self.cancel = url, 200, 200, False
        self.asked, self.outcomes = [], []
        self.over = threading.Event()

    def times(self, what):
        """When it was asked for this, on the monotonic clock."""
        return [at_s for at_s, path in self.asked if path.endswith(what)]


@contextmanager
def lease_api():
    """A running one."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            api.asked.append((time.monotonic(), self.path))
            status = api.of_files if self.path.endswith(("/log", "/truth", "/graph")) else api.status
            if status == 0:
                api.over.wait(300)
                return
            if status == 200 and self.path.endswith("/outcome"):
                api.outcomes.append(json.loads(body))
            said = {"lease_s": LEASE_S, "cancel": api.cancel} if self.path.endswith("/renew") else {}
            if self.path.endswith(("/log", "/truth")):
                said = {"sha256": self.headers["X-Content-SHA256"], "bytes": len(body), "new": True}
            self.send_response(status)
            self.end_headers()
            self.wfile.write(json.dumps(said).encode())

        do_PUT = do_GET = do_POST

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    api = LeaseApi(f"http://127.0.0.1:{server.server_port}")
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield api
    finally:
        api.over.set()
        server.shutdown()
        thread.join()
        server.server_close()


def excitation_lease(fence=1):
    """A lease that needs no policy."""
    return Lease(
        trial_id="j1-000", job_id="j1", ordinal=0, fence=fence, robot="robot-0", task="identify", excitation="slow_ramps", seed=1,
        lease_s=LEASE_S,
    )  # fmt: skip


def wait_until(condition, within_s=120.0):
    """Wait for something that another thread does."""
    give_up_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < give_up_s, "it did not happen"
        time.sleep(0.02)


@contextmanager
def serving(robot, api, lease=None):
    """A robot that serves a lease in a thread of its own; waits for its end."""
    with ApiLink(api.url, "token") as link:
        arguments = (Accepted(lease or excitation_lease(), lease_keeper.time.monotonic()), link, SilentBus(), threading.Event())
        thread = threading.Thread(target=robot._serve, args=arguments)
        thread.start()
        try:
            yield thread
        finally:
            thread.join(120)
            assert not thread.is_alive()


def endless_trial(steps: list[float]):
    """A trial that would go on for ever, asking in each step whether it may; ``steps`` gets when it did, by the lease's clock."""

    def run(_lease, _policy, _driver, _channels, log, *, stop_reason, **_):
        log.write_bytes(b"half a log")
        while (reason := stop_reason()) is None:
            steps.append(lease_keeper.time.monotonic())
            time.sleep(0.01)
        raise TrialStoppedError(reason)

    return run
