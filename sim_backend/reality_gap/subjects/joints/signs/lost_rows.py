"""Rows that a logger lost under a clock that goes on, and recordings that were joined: there all joints jump at once."""

from collections.abc import Mapping

import numpy as np

from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.laws.trajectory import filled_gaps
from sim_backend.reality_gap.subjects.joints.signs.checks import Jump, jump_in

MOST_PLACES = 200
"""In one recording, looked for one after the other."""
_ROWS_AROUND = 25
"""On both sides, over which a joint's speed is taken: the steps of its encoder count little there."""
_NOISES, _STEPS = 4.0, 1.5
"""Times the noise and the steps of its encoder that a move between two samples may differ by."""
_CLEARLY_ON, _AS_FAR = 2.0, 0.3
"""Times that by which a joint must go on to be asked; share by which it may differ."""
_LEAST_ROWS = 0.5


def lost_rows(position_rad: np.ndarray, step_rad: np.ndarray) -> list[int]:
    """Samples before which rows seem to be missing, at most ``MOST_PLACES``, in order.

    Args:
        position_rad: of all joints as reported, shape (s, k), NaN in gaps.
        step_rad: in which their encoders report, shape (k,), 0 for none.
    """
    noise_rad = np.sqrt(np.maximum(white_noise(position_rad) ** 2 - step_rad**2 / 12.0, 0.0))
    slack_rad, positions, places = _NOISES * noise_rad + _STEPS * step_rad, position_rad.copy(), set[int]()
    while len(places) < MOST_PLACES:
        jumps = {j: seen for j, step in enumerate(step_rad) if (seen := jump_in(positions[:, j], float(step))) is not None}
        new = {jump.before + 1 for j, jump in jumps.items() if _are_lost(filled_gaps(positions), slack_rad, j, jumps)} - places
        if not new:
            break
        for place in new:
            positions[place - 1 : place + 1] = np.nan
        places |= new
    return sorted(places)


def _are_lost(position_rad: np.ndarray, slack_rad: np.ndarray, joint: int, jumps: Mapping[int, Jump]) -> bool:
    """Whether rows are missing where a joint jumps.

    Another one jumps, too, or all that move go on as far; and none goes on as if nothing was.
    """
    at, last_row = jumps[joint].before, len(position_rad) - 1
    first, last = max(0, at - _ROWS_AROUND), min(last_row, at + 1 + _ROWS_AROUND)
    before, after = position_rad[first : at + 1], position_rad[at + 1 : last + 1]
    speed = 0.5 * (_speed_at_begin(after) - _speed_at_begin(before[::-1]))
    rows = jumps[joint].size_rad / speed[joint] if speed[joint] else 0.0
    asked, further = max(1.0, rows) * speed, position_rad[at + 1] - position_rad[at] - speed
    jump_too = np.array([j == joint or (j in jumps and abs(jumps[j].before - at) <= 1) for j in range(len(speed))])
    moving = ~jump_too & (np.abs(asked) > _CLEARLY_ON * slack_rad)
    if (np.abs(further[moving]) < slack_rad[moving]).any():
        return False
    agree = np.abs(further - asked) < _AS_FAR * np.abs(asked) + slack_rad
    return bool(jump_too.sum() > 1 or (rows > _LEAST_ROWS and moving.any() and agree[moving].all()))


def _speed_at_begin(position_rad: np.ndarray) -> np.ndarray:
    """Of joints that accelerate evenly, shapes (n, k) and (k,), rad a row."""
    return np.polyfit(np.arange(len(position_rad)), position_rad, 2)[1]
