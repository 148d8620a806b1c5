"""What a proxy or another server answers in the API's place is no answer of the API, and ends no robot."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from api_schemas.trial import Fault, Outcome, OutcomeKind
from robot_farm import farm
from robot_farm.link import api_link
from robot_farm.link.api_link import ApiLink, ApiUnreachableError, own_token
from robot_farm.link.bus_access import ask_access
from robot_farm.settings import TOKEN_VARIABLE, parse
from tests.unit.robot_farm.link.lease_api import excitation_lease

PAGE = b"<html><body>Sign in to this network</body></html>"
FOREIGN = pytest.mark.parametrize(
    ("status", "headers"),
    [
        (308, {"Location": "https://elsewhere.example/"}),
        (302, {"Location": "/sign-in"}),
        (200, {"Content-Type": "text/html"}),
        (200, {"Content-Encoding": "gzip"}),
    ],
)


@contextmanager
def answering(status, headers):
    """A server that answers all alike; gives its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(PAGE)))
            self.end_headers()
            self.wfile.write(PAGE)

        do_PUT = do_POST

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


@FOREIGN
def test_an_answer_that_is_none_of_the_apis_counts_as_none(status, headers, tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    with answering(status, headers) as url:
        with pytest.raises(ApiUnreachableError, match="POST /v1/robots/robot-0/token"):
            own_token(url, "token", "robot-0")
        settings = parse(["--api", url, "--data", str(tmp_path), "--robots", "1"])
        with ApiLink(url, "token") as link, pytest.raises(ApiUnreachableError, match="POST /v1/robots/robot-0/bus"):
            ask_access(link, "robot-0", settings)


@FOREIGN
def test_it_renews_no_lease_and_takes_no_log_and_no_outcome(status, headers, tmp_path, monkeypatch):
    monkeypatch.setattr(api_link, "RETRY_FOR_S", 0.0)
    log, lease = tmp_path / "log.mcap", excitation_lease()
    log.write_bytes(b"a log")
    recorded = Outcome(kind=OutcomeKind.RECORDED, fault=Fault.NONE, reason="recorded")
    with answering(status, headers) as url, ApiLink(url, "token") as link:
        for ask in (
            lambda: link.renew("j1-000", "robot-0", 1),
            lambda: link.upload_log(lease, log),
            lambda: link.upload_truth(lease, log),
            lambda: link.report_outcome(lease, recorded, None),
        ):
            with pytest.raises(ApiUnreachableError, match="/v1/leases/j1-000/"):
                ask()


@FOREIGN
def test_the_robots_of_a_machine_outlive_it(status, headers, tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    said, started = [], []
    place = farm._Place("robot-0")
    with answering(status, headers) as url:
        settings = parse(["--api", url, "--data", str(tmp_path), "--robots", "1"])
        farm._look_after(place, settings, lambda *robot: started.append(robot), said.append)
    assert (len(said), started) == (1, [])
    assert "cannot join the farm yet" in said[0]
    assert place.start_at_s > farm.time.monotonic()
