"""Readers of a job's events, half of them on a host whose cable is pulled out: what the API had open for them is closed."""

import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.integration.farm_process import PATIENCE_S, services, until
from tests.integration.two_hosts import hosts  # noqa: F401  a fixture

READERS = """
import socket, sys, time
host, port, path, token, count = sys.argv[1:]
streams = []
for _ in range(int(count)):  # each asks at once: a connection that waits with its request is closed
    stream = socket.create_connection((host, int(port)), timeout=60)
    streams.append(stream)
    stream.sendall(f"GET {path} HTTP/1.1\\r\\nHost: {host}\\r\\nAuthorization: Bearer {token}\\r\\n\\r\\n".encode())
    answer = stream.recv(4096)
    assert answer.startswith(b"HTTP/1.1 200"), f"no stream, but {answer[:300]!r}"
print("open", flush=True)
time.sleep(600)
"""
A_FEW = 30
"""Connections to the database stay open for those who come next."""
LEFT_OPEN_AT_MOST_S = 30


@contextmanager
def readers(begin, farm, address, path, count):
    """Readers on a host, who have seen the begin of the stream."""
    given = [address, farm.api.rpartition(":")[2], path, farm.tokens["admin"], str(count)]
    process = subprocess.Popen([*begin, sys.executable, "-c", READERS, *given], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "open\n"
        yield
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("half", [60, pytest.param(250, marks=pytest.mark.scale)])
def test_streams_of_a_host_that_is_cut_off_are_closed_and_the_others_go_on(hosts, tmp_path, half):  # noqa: F811
    """`test_streams_of_a_host_that_is_cut_off_are_closed_and_the_others_go_on` has 2 times 60 readers without scale."""
    at = {"host": hosts.address, "through": hosts.services, "requests_per_s": 0, "anonymous_requests_per_s": 0}
    with services(tmp_path / "farm", **at) as farm:
        path = f"/v1/jobs/{farm.submit(farm.policy(), trials=1).json()['job_id']}/events"
        streams = (farm, hosts.address, path, half)

        def open_now():
            return len(list(Path(f"/proc/{farm.process.pid}/fd").iterdir()))

        before = open_now()
        with readers(hosts.services, *streams), readers(hosts.robots, *streams):
            assert open_now() >= before + 2 * half
            hosts.cut_off_robots()
            until(lambda: open_now() <= before + half + A_FEW, PATIENCE_S, "half of them to be closed")
            assert open_now() >= before + half, "those who still read were not cut off"
        until(lambda: open_now() <= before + A_FEW, PATIENCE_S, "all to be closed")
