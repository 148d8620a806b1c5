"""Protobuf messages of fixed size, encoded once and then copied with other numbers in them.

A log has tens of thousands of messages that differ only in their doubles and their time stamp. One of them is encoded by
the real encoder with marker values; wherever a marker's bytes are found, later rows get their own numbers.
"""

import struct
from collections.abc import Callable

import numpy as np

from trial_logs.block_writer import HEADER_BYTES, room_for

MARKER_SECONDS = 97
MARKER_NANOS = 999_999_937
MAX_SECONDS = 127
"""Time stamps must stay below 128 s, so that their seconds fit one byte of a varint."""
_NANOS_BYTES = 5
_DOUBLE = struct.Struct("<d")
_SHIFTS = 7 * np.arange(_NANOS_BYTES)
_CONTINUES = np.where(np.arange(_NANOS_BYTES) < _NANOS_BYTES - 1, 0x80, 0)
_SHIFTS_AND_BITS = list(zip(_SHIFTS.tolist(), _CONTINUES.tolist(), strict=True))


def marker(index: int) -> float:
    """The marker for the double number ``index`` of a message; no two share their bytes."""
    return -7.25e11 - 1.000123e3 * (index + 1)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


class FixedMessage:
    """A template and the places of its doubles and time stamps.

    Args:
        encode: gives the message's bytes from its doubles; time stamps in it must be MARKER_SECONDS and MARKER_NANOS.
        doubles: how many doubles the message has, in the order in which rows give them.
    """

    def __init__(self, encode: Callable[[list[float]], bytes], doubles: int) -> None:
        markers = [marker(index) for index in range(doubles)]
        encoded = encode(markers)
        self._template = np.frombuffer(encoded, np.uint8)
        places = [_only_place(encoded, np.float64(value).tobytes()) for value in markers]
        self._places, self._template_bytes = places, encoded
        self._doubles, self._runs = doubles, _runs([HEADER_BYTES + place for place in places])
        stamp = b"\x08" + _varint(MARKER_SECONDS) + b"\x10" + _varint(MARKER_NANOS)
        self._stamps = [HEADER_BYTES + place for place in _all_places(encoded, stamp)]

    def one(self, values: np.ndarray, time_ns: int) -> bytes:
        """A message alone; ``values`` has shape (doubles,)."""
        message = bytearray(self._template_bytes)
        for place, value in zip(self._places, values.tolist(), strict=True):
            _DOUBLE.pack_into(message, place, value)
        for place in self._stamps:
            stamp = _stamp(time_ns)
            message[place - HEADER_BYTES : place - HEADER_BYTES + len(stamp)] = stamp
        return bytes(message)

    def rows(self, values: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
        """One message per row, each after room for its header.

        Args:
            values: shape (n, doubles).
            time_ns: shape (n,), whole nanoseconds since the trial's start, below 128 s.

        Returns:
            Shape (n, HEADER_BYTES + bytes of the message), as :func:`block_writer.room_for` gives it.
        """
        rows = room_for(len(values), len(self._template))
        rows[:, HEADER_BYTES:] = self._template
        given = np.asarray(values, dtype=np.float64).reshape(len(values), self._doubles)
        for first, count, place, pitch in self._runs if len(values) else ():
            shape, strides = (len(values), count), (rows.strides[0], pitch)
            np.ndarray(shape, "<f8", rows, place, strides)[:] = given[:, first : first + count]
        if self._stamps:
            stamp = _stamp_bytes(time_ns)
            for place in self._stamps:
                rows[:, place : place + stamp.shape[1]] = stamp
        return rows


def _stamp(time_ns: int) -> bytes:
    """One time stamp, as :func:`_stamp_bytes` gives many."""
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    if not 0 <= seconds <= MAX_SECONDS:
        raise ValueError(f"a time stamp is at {seconds} s; it must lie within 0 and {MAX_SECONDS} s")
    return bytes([0x08, seconds, 0x10, *(nanos >> shift & 0x7F | bit for shift, bit in _SHIFTS_AND_BITS)])


def _stamp_bytes(time_ns: np.ndarray) -> np.ndarray:
    """Time stamps as fixed-width varints, shape (n, 8): a varint may be padded with continuation bytes."""
    seconds, nanos = np.divmod(np.asarray(time_ns, dtype=np.int64), 1_000_000_000)
    if len(seconds) and (seconds.max() > MAX_SECONDS or seconds.min() < 0):
        raise ValueError(f"time stamps run from {seconds.min()} to {seconds.max()} s; they must lie within 0 and {MAX_SECONDS} s")
    out = np.empty((len(seconds), 2 + 1 + _NANOS_BYTES), np.uint8)
    out[:, 0], out[:, 1], out[:, 2] = 0x08, seconds, 0x10
    out[:, 3:] = nanos[:, None] >> _SHIFTS & 0x7F | _CONTINUES
    return out


def _runs(places: list[int]) -> list[tuple[int, int, int, int]]:
    """Doubles that follow each other at one distance, to be written at once: first of them, count, place and distance."""
    runs, first = [], 0
    for index in range(1, len(places) + 1):
        pitch = places[first + 1] - places[first] if first + 1 < len(places) else 8
        if index == len(places) or places[index] - places[index - 1] != pitch:
            runs.append((first, index - first, places[first], pitch))
            first = index
    return runs


def _only_place(encoded: bytes, wanted: bytes) -> int:
    places = _all_places(encoded, wanted)
    if len(places) != 1:
        raise ValueError(f"a marker was found {len(places)} times in the encoded message instead of once")
    return places[0]


def _all_places(encoded: bytes, wanted: bytes) -> list[int]:
    places, start = [], encoded.find(wanted)
    while start >= 0:
        places.append(start)
        start = encoded.find(wanted, start + 1)
    return places
