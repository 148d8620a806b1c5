"""Heads of requests have bounds, whoever sends them; what they are made of is not kept."""

import socket
import ssl
import time

import pytest

from services.connection import MOST_HEAD_BYTES, MOST_HEADERS, MOST_PIPELINED
from tests.integration.farm_process import PATIENCE_S, services
from tests.integration.test_bodies import answer_of
from tests.integration.test_idle_connections import ended
from tests.integration.test_tls import self_signed

HEAD_S = 1.0
LINE = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heads")
    certificate, key = self_signed(folder, "farm")
    settings = {"head_within_s": HEAD_S, "anonymous_requests_per_s": 0, "tls_certificate": certificate, "tls_key": key}
    with services(folder / "farm", **settings) as running:
        yield running


def connected(farm):
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    return trusting.wrap_socket(socket.create_connection(("127.0.0.1", farm.port), timeout=PATIENCE_S))


def of_size(size):
    rest = size - len(LINE) - len(b"\r\n")
    lines = [b"X-%03d: %b\r\n" % (number, b"x" * 991) for number in range(rest // 1000)]
    return LINE + b"".join(lines) + b"\r\n"


@pytest.mark.parametrize(
    "head",
    [
        of_size(MOST_HEAD_BYTES + 2000),
        LINE + b"".join(b"a%d: \r\n" % number for number in range(MOST_HEADERS)) + b"\r\n",
        LINE + b"X: " + b"x" * (MOST_HEAD_BYTES + 1),
        b"GET /" + b"x" * (MOST_HEAD_BYTES + 1),
    ],
    ids=["bytes", "count", "a header without end", "an address without end"],
)
def test_a_head_that_is_too_large_is_refused_before_it_ends(farm, head):
    with connected(farm) as connection:
        connection.sendall(head)
        status, headers, problem = answer_of(connection)
        assert ended(connection) == b""
    assert (status, headers["connection"], problem["type"]) == (431, "close", "/problems/head-too-large")


def test_a_head_that_is_large_enough_for_everybody_is_taken(farm):
    with connected(farm) as connection:
        for size in (MOST_HEAD_BYTES - 1000, 5000, 5000, 5000, 5000):
            connection.sendall(of_size(size))
            assert answer_of(connection)[0] == 200


def test_requests_that_wait_on_one_connection_are_few(farm):
    wanted = b"GET /v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with connected(farm) as connection:
        connection.sendall(wanted * (1 + MOST_PIPELINED))
        assert [answer_of(connection)[0] for _ in range(1)] == [401]
    with connected(farm) as connection:
        connection.sendall(wanted * 1000)
        assert b"431" in ended(connection)


def test_a_connection_that_does_not_shake_hands_is_closed(farm):
    began_s = time.monotonic()
    with socket.create_connection(("127.0.0.1", farm.port), timeout=PATIENCE_S) as silent:
        ended(silent)
    assert time.monotonic() - began_s > 0.9 * HEAD_S
    assert farm.admin.get("/v1/status").status_code == 200
