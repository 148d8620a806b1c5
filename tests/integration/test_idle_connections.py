"""Connections on which no request comes are closed, whoever opened them; what is under way lives on."""

import socket
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.integration.farm_process import PATIENCE_S, services, until
from tests.integration.pace import kept_open
from tests.integration.test_bodies import answer_of

HEAD_S = 1.0
MANY, FEW_FILES = 400, 256
FEW = ("sh", "-c", f'ulimit -Sn {FEW_FILES} && exec "$@"', "sh")
WHOLE = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
LONG_BODY = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 5000000\r\n\r\n"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    settings = {"head_within_s": HEAD_S, "anonymous_requests_per_s": 0}
    with services(tmp_path_factory.mktemp("idle") / "farm", through=FEW, **settings) as running:
        yield running


def connected(farm):
    return socket.create_connection(("127.0.0.1", farm.port), timeout=PATIENCE_S)


def ended(connection):
    """What is still said on a connection that the farm closes; that it does is waited for, however slow the machine."""
    said = b""
    try:
        while part := connection.recv(65536):
            said += part
    except ConnectionResetError:  # something was sent that nobody read
        pass
    return said


@pytest.mark.parametrize("sent", [b"", b"\r\n", b"G", WHOLE[:-2]])
def test_a_connection_without_a_whole_head_is_closed(farm, sent):
    began_s = time.monotonic()
    with connected(farm) as connection:
        connection.sendall(sent)
        assert ended(connection) == b""
    assert time.monotonic() - began_s > 0.9 * HEAD_S


def test_a_head_that_comes_byte_by_byte_gains_no_time(farm):
    """It goes on for longer than any machine stalls."""
    with connected(farm) as connection, pytest.raises(OSError, match=r"(?i)reset|broken pipe"):
        for byte in WHOLE[:-2] + b"X: " + b"x" * 500:
            connection.sendall(bytes([byte]))
            time.sleep(0.1)


@pytest.mark.parametrize("then", [b"\r\n", b"G", WHOLE[:-2]])
def test_a_connection_that_was_good_once_is_closed_too(farm, then):
    began_s = time.monotonic()
    with connected(farm) as connection:
        connection.sendall(WHOLE)
        assert answer_of(connection)[0] == 200
        connection.sendall(then)  # ends uvicorn's own wait for the next request
        assert ended(connection) == b""
    assert time.monotonic() - began_s > 0.9 * HEAD_S


def test_the_rest_of_a_body_that_was_answered_is_waited_for_only_while_it_comes(farm):
    with connected(farm) as connection:
        connection.sendall(LONG_BODY)
        assert answer_of(connection)[0] == 413
        with kept_open(farm, HEAD_S) as pace:
            for _ in range(10):
                connection.sendall(b"x" * 1000)
                pace.rest(0.3 * HEAD_S)
        assert ended(connection) == b""


def test_so_many_silent_connections_are_gone_and_the_farm_answers(farm):
    soft, hard = next(line.split()[3:5] for line in limits(farm) if line.startswith("Max open files"))
    assert soft == hard
    assert int(hard) > FEW_FILES + MANY, "the machine allows too few for this test"
    folder = Path(f"/proc/{farm.process.pid}/fd")
    before = len(list(folder.iterdir()))
    with ExitStack() as opened:
        for _ in range(MANY):
            opened.enter_context(connected(farm))
        assert farm.admin.get("/v1/status").status_code == 200
        until(lambda: len(list(folder.iterdir())) < before + 20, PATIENCE_S, "silent connections to be closed")


def limits(farm):
    return Path(f"/proc/{farm.process.pid}/limits").read_text().splitlines()


def test_streams_and_slow_bodies_and_used_connections_live_on(farm):
    job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
    token = f"Authorization: Bearer {farm.tokens['admin']}\r\n"
    with connected(farm) as used, connected(farm) as slow, farm.admin.stream("GET", f"/v1/jobs/{job_id}/events") as stream:
        lines = stream.iter_lines()
        assert "job_queued" in next(lines)
        head = f"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{token}Content-Length: 9\r\n\r\n"
        slow.sendall(head.encode())
        with kept_open(farm, HEAD_S) as pace:
            for byte in b'{"a": 1}\n':
                used.sendall(WHOLE)
                assert answer_of(used)[0] == 200
                slow.sendall(bytes([byte]))
                pace.rest(0.4 * HEAD_S)
            assert answer_of(slow)[0] == 422
        farm.admin.post(f"/v1/jobs/{job_id}/cancel")
        assert any("job_ended" in line for line in lines)
