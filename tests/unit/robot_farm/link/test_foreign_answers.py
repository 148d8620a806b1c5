"""What a proxy or another server answers in the API's place is no answer of the API, and ends no robot."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from robot_farm import farm
from robot_farm.link.api_link import ApiLink, ApiUnreachableError, own_token
from robot_farm.link.bus_access import ask_access
from robot_farm.settings import TOKEN_VARIABLE, parse

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
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(PAGE)))
            self.end_headers()
            self.wfile.write(PAGE)

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
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
