"""Frames between a robot and its policy process: fixed headers, float32 numbers, nothing that could be code.

Request: kind, count of numbers, then the observation (float32), or those of all trials that are under way, one after the
other; a reset may say how many trials begin. Reply: status, count, inference time in ns, then nine float32 numbers for each
trial or a text of ``count`` bytes: an error, or the layers of the jail that the process has closed around itself, which it tells
once and before it reads the network.
"""

import os
import struct

import numpy as np

REQUEST = struct.Struct("<II")
REPLY = struct.Struct("<IIQ")

ACT = 1
RESET = 2

OK = 0
FAILED = 1
READY = 2
BROKEN = 3  # the runtime itself could not be loaded
JAILED = 4

MAX_TEXT_BYTES = 1500
_USUAL_REQUEST_BYTES = 4096


class LinkClosedError(Exception):
    """The other side has gone."""


def pack_request(kind: int, observation: np.ndarray | None = None) -> bytes:
    """A request; ``observation`` is a float32 vector, or one for each trial, shape (trials, size)."""
    if observation is None:
        return REQUEST.pack(kind, 0)
    return REQUEST.pack(kind, observation.size) + observation.astype(np.float32, copy=False).tobytes()


def pack_reply(status: int, payload: bytes = b"", inference_time_ns: int = 0) -> bytes:
    """A reply; ``payload`` is the action's float32 bytes or a text."""
    return REPLY.pack(status, len(payload), inference_time_ns) + payload


def read_exactly(fd: int, size: int) -> bytes:
    """Read ``size`` bytes from a pipe.

    Raises:
        LinkClosedError: the pipe ended before.
    """
    data = os.read(fd, size)
    while len(data) < size:
        more = os.read(fd, size - len(data))
        if not more:
            raise LinkClosedError("the pipe ended")
        data += more
    return data


def read_request(fd: int) -> tuple[int, bytes]:
    """Kind and observation of the next request; one comes only after the last reply, so that whatever there is belongs to it.

    Raises:
        LinkClosedError: the pipe ended.
    """
    data = os.read(fd, _USUAL_REQUEST_BYTES)
    if len(data) < REQUEST.size:
        data += read_exactly(fd, REQUEST.size - len(data))
    kind, count = REQUEST.unpack_from(data)
    if (missing := REQUEST.size + 4 * count - len(data)) > 0:
        data += read_exactly(fd, missing)
    return kind, data[REQUEST.size :]


def trials_of(data: bytes) -> int:
    """How many trials begin with a reset that carries these bytes: one unless it says a number."""
    return int(np.frombuffer(data, np.float32)[0]) if data else 1


def read_reply(fd: int, expected_bytes: int = 0) -> tuple[int, bytes, int]:
    """Status, payload and inference time in ns of the next reply.

    Args:
        fd: to read from.
        expected_bytes: of the payload; a reply of this size is read at once.

    Raises:
        LinkClosedError: the pipe ended before, or what comes is no single reply.
    """
    data = read_exactly(fd, REPLY.size) if expected_bytes == 0 else os.read(fd, REPLY.size + expected_bytes)
    if len(data) < REPLY.size:
        data += read_exactly(fd, REPLY.size - len(data))
    status, size, inference_time_ns = REPLY.unpack_from(data)
    if size > MAX_TEXT_BYTES:
        raise LinkClosedError(f"the reply announces {size} bytes; at most {MAX_TEXT_BYTES} are allowed")
    missing = REPLY.size + size - len(data)
    if missing < 0:
        raise LinkClosedError(f"the reply announces {size} bytes, and {-missing} more follow")
    return status, data[REPLY.size :] + (read_exactly(fd, missing) if missing else b""), inference_time_ns
