"""Frames between a robot and its policy process are read whole, in however many pieces they come."""

import os
import threading

import numpy as np
import pytest

from api_schemas import policy_link as link

OBSERVATION = np.arange(1200, dtype=np.float32)
"""Longer than what is read at once."""
ACTION = np.arange(9, dtype=np.float32).tobytes()


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


def written(fd: int, data: bytes, pieces: int) -> threading.Thread:
    size = -(-len(data) // pieces)
    parts = [data[first : first + size] for first in range(0, len(data), size)]
    writer = threading.Thread(target=lambda: [os.write(fd, part) for part in parts])
    writer.start()
    return writer


@pytest.mark.parametrize("pieces", [1, 2, 700])
def test_a_request_is_read_whole(pipe, pieces):
    writer = written(pipe[1], link.pack_request(link.ACT, OBSERVATION), pieces)
    kind, data = link.read_request(pipe[0])
    writer.join()
    assert kind == link.ACT
    np.testing.assert_array_equal(np.frombuffer(data, np.float32), OBSERVATION)


@pytest.mark.parametrize("expected_bytes", [0, len(ACTION)])
@pytest.mark.parametrize("pieces", [1, 2, 40])
@pytest.mark.parametrize(("status", "payload"), [(link.OK, ACTION), (link.FAILED, b"x" * 900), (link.FAILED, b"no")])
def test_a_reply_is_read_whole(pipe, status, payload, pieces, expected_bytes):
    writer = written(pipe[1], link.pack_reply(status, payload, 7), pieces)
    assert link.read_reply(pipe[0], expected_bytes) == (status, payload, 7)
    writer.join()


def test_two_replies_at_once_are_no_reply(pipe):
    os.write(pipe[1], 2 * link.pack_reply(link.FAILED, b"no"))
    with pytest.raises(link.LinkClosedError, match="more follow"):
        link.read_reply(pipe[0], len(ACTION))


@pytest.mark.parametrize("half", [b"", b"123", link.pack_reply(link.OK, ACTION)[:-1]])
def test_what_ends_in_the_middle_is_closed(pipe, half):
    os.write(pipe[1], half)
    os.close(pipe[1])
    with pytest.raises(link.LinkClosedError, match="ended"):
        link.read_reply(pipe[0], len(ACTION))
