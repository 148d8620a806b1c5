"""Bodies that are too large, that never end or that stop coming: refused to anybody, before they fill memory or disk."""

import json
import socket
import time
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from services.api.bodies import MAX_BODY_BYTES, WHOLE_WITHIN
from services.api.paging import encode
from tests.integration.farm_process import PATIENCE_S, services, small_policy
from tests.integration.pace import kept_open

STALL_S = 0.8
HUGE = 300 * 1024**2
FORM = "multipart/form-data; boundary=b"
PART = b'--b\r\nContent-Disposition: form-data; name="token"; filename="t"\r\n\r\n'
ROUTES = {  # the type of a body, and how such a body begins
    "POST /v1/jobs": ("application/json", b'{"policy": "'),
    "POST /v1/leases/x-000/outcome": ("application/json", b'{"robot": "'),
    "POST /sign-in": (FORM, PART),
    "POST /jobs/x/cancel": ("application/x-www-form-urlencoded", b"csrf="),
}
DIGEST = "0" * 64


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("bodies") / "farm", anonymous_requests_per_s=0) as running:
        yield running


@pytest.fixture(scope="module")
def impatient(tmp_path_factory):
    """A farm that soon gives up on a body; no other test should send it one, since we may stall ourselves."""
    settings = {"body_stall_s": STALL_S, "anonymous_requests_per_s": 0}
    with services(tmp_path_factory.mktemp("impatient") / "farm", **settings) as running:
        yield running


@contextmanager
def begun(farm, route, *headers):
    with socket.create_connection(("127.0.0.1", farm.port), timeout=PATIENCE_S) as connection:
        lines = (f"{route} HTTP/1.1", "Host: localhost", *headers, "", "")
        connection.sendall("\r\n".join(lines).encode())
        yield connection


def answer_of(connection):
    """(status, headers, problem) of the answer, which comes although the body has not ended."""
    got = b""
    while b"\r\n\r\n" not in got:
        got += (part := connection.recv(65536))
        if not part:
            raise EOFError(f"the connection was closed after {got!r}")
    head, _, body = got.partition(b"\r\n\r\n")
    status, *lines = head.decode().split("\r\n")
    headers = dict(line.lower().split(": ", 1) for line in lines)
    while len(body) < int(headers["content-length"]):
        body += connection.recv(65536)
    is_problem = headers["content-type"] == "application/problem+json"
    return int(status.split()[1]), headers, json.loads(body) if is_problem else {}


def resident_bytes(farm):
    return int(Path(f"/proc/{farm.process.pid}/statm").read_text().split()[1]) * 4096


def lines_of(route):
    return f"Content-Type: {ROUTES[route][0]}", "Connection: keep-alive"


@pytest.mark.parametrize("route", ROUTES)
def test_an_announced_body_is_refused_before_it_comes(farm, route):
    with begun(farm, route, *lines_of(route), f"Content-Length: {HUGE}") as connection:
        status, _, problem = answer_of(connection)
    assert (status, problem["type"]) == (413, "/problems/body-too-large")
    assert str(MAX_BODY_BYTES) in problem["detail"]


@pytest.mark.parametrize("route", ROUTES)
def test_a_body_of_unknown_length_is_counted(farm, route):
    before = resident_bytes(farm)
    with begun(farm, route, *lines_of(route), "Transfer-Encoding: chunked") as connection:
        for content in (ROUTES[route][1], *[b"x" * 65536] * (2 * MAX_BODY_BYTES // 65536)):
            connection.sendall(b"%x\r\n%b\r\n" % (len(content), content))
        status, _, problem = answer_of(connection)
        for _ in range(32 * MAX_BODY_BYTES // 65536):  # what is still sent is thrown away
            connection.sendall(b"10000\r\n%b\r\n" % (b"x" * 65536))
    assert (status, problem["type"]) == (413, "/problems/body-too-large")
    assert resident_bytes(farm) - before < 16 * MAX_BODY_BYTES


@pytest.mark.parametrize("route", ["POST /v1/jobs", "POST /sign-in", f"PUT /v1/policies/{DIGEST}", "POST /v1/policies"])
def test_a_body_that_stops_coming_is_not_waited_for(impatient, route):
    media_type, start = ROUTES.get(route, (FORM, PART))
    token, began_s = f"Authorization: Bearer {impatient.tokens['admin']}", time.monotonic()
    with begun(impatient, route, f"Content-Type: {media_type}", token, "Content-Length: 1000") as connection:
        connection.sendall(start)
        status, headers, problem = answer_of(connection)
        waited_s = time.monotonic() - began_s
        assert connection.recv(1) == b""
    assert (status, problem["type"], headers["connection"]) == (408, "/problems/body-too-slow", "close")
    assert waited_s > 0.9 * STALL_S
    assert f"{len(start)} bytes" in problem["detail"]


def test_a_slow_body_that_goes_on_coming_is_taken(impatient):
    token, body = f"Authorization: Bearer {impatient.tokens['admin']}", b'{"a": 1}'
    head = ("POST /v1/jobs", "Content-Type: application/json", token, f"Content-Length: {len(body)}")
    with begun(impatient, *head) as connection, kept_open(impatient, STALL_S, WHOLE_WITHIN * STALL_S) as pace:
        for byte in body:
            pace.rest(2 * STALL_S / len(body))
            connection.sendall(bytes([byte]))
        status, _, problem = answer_of(connection)
        if status == 408:
            raise EOFError(problem)
        assert (status, problem["type"]) == (422, "/problems/invalid-request")


def test_files_may_be_larger_but_only_under_a_token(farm):
    with begun(farm, f"PUT /v1/policies/{DIGEST}", f"Content-Type: {FORM}", f"Content-Length: {HUGE}") as connection:
        assert answer_of(connection)[0] == 401
    answer = farm.upload(b"x" * 3 * MAX_BODY_BYTES, small_policy()[1])
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/weights-malformed")
    token = f"Authorization: Bearer {farm.tokens['admin']}"
    with begun(farm, f"PUT /v1/policies/{DIGEST}", f"Content-Type: {FORM}", token, f"Content-Length: {HUGE}") as connection:
        status, _, problem = answer_of(connection)
    assert (status, problem["type"]) == (413, "/problems/weights-too-large")


def test_values_that_no_database_can_look_for_are_refused(farm):
    job_id = farm.submit(farm.policy()).json()["job_id"]
    answer = farm.admin.get(f"/v1/jobs/{job_id}/trials", params={"cursor": encode(10**17)})
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/bad-cursor")
    with httpx.Client(base_url=farm.api) as browser:
        browser.post("/sign-in", data={"token": farm.tokens["admin"]})
        for path in ("/jobs?q=%00", "/compare?jobs=%00,b", "/compare?job=%00"):
            assert browser.get(path).status_code == 422, path
        assert browser.get("/jobs?q=a%0Ab").status_code == 200
        assert browser.get(f"/compare?job={job_id}").status_code == 200
