"""Play in the gear of a light link: its rotor rattles wherever the motor's torque changes sign, which needs no fit to be seen.

The link weighs so little beside the rotor that the controller's own corrections throw the rotor to and fro. What that leaves of
the mechanics is a hundred times what other causes do, and following the rotor explains nearly all of it. How wide the play is
hardly shows: the rotor mostly falls back on the side from which it came.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel, Sign
from sim_backend.reality_gap.subjects.joints.laws.motor_law import ROTOR_INERTIA_KG_M2
from sim_backend.reality_gap.subjects.joints.laws.play_law import follow_play, geared_motion
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.signs.checks import Finding
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations, Equation
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import (
    FOLDS,
    WINDOW_FLOOR,
    WINDOW_ROWS,
    folds_of,
    in_windows,
)

GAPS_RAD = np.geomspace(5e-4, 2e-2, 9)
LIGHT = 0.5
"""Share of the inertia behind a joint that the rotor's must have, so that the link is light beside it."""
LEFT_AT_MOST = 0.1
"""Share of the squares in windows with hits that may be left: 0.01 to 0.03 in 27 robots with play.

In 79 others 0.8 and more, but for a controller that starts again: 0.04 and more, in no more than 6 windows.
"""
BEYOND_NOISE = 1000.0
"""Squares in windows with hits over those of noise: 6600 and more with play."""
LEAST_WINDOWS = 20
"""Windows with hits: 39 and more with play."""
AS_GOOD = 1.5
"""Widths that leave up to so much more than the best one are as good: they explain nearly all, and differ by single hits."""
NUMBERS = WINDOW_ROWS - 2
"""Of each window."""
_AROUND_S = 0.1
"""Smoothing carries a hit so far."""


@dataclass(frozen=True)
class HitErrors:
    """How far off the torques put a joint in windows with hits, without play and with one of a width from other folds.

    ``before`` and ``after`` have shape (folds,): each fold's sum of the windows' mean squares, rad^2; ``windows``, too, how many.
    """

    before: np.ndarray
    after: np.ndarray
    windows: np.ndarray
    noise_rad: float
    window_s: float


@dataclass(frozen=True)
class Rattling:
    """A joint whose rotor rattles, and in which rows of each episode it is not pressed against a side, shape (t,)."""

    finding: Finding
    joint: int
    apart: tuple[np.ndarray, ...]
    errors: HitErrors


@dataclass(frozen=True)
class Followed:
    """One joint of one episode with a play: squares of each window with and without it, and what noise makes of them."""

    with_play: np.ndarray
    without: np.ndarray
    noise: float
    fold: np.ndarray
    is_touched: np.ndarray
    apart: np.ndarray


def rattling_joints(episodes: Sequence[EpisodeEquations], state: JointState) -> list[Rattling]:
    """Joints with play in the gear of a light link.

    Args:
        episodes: of a TriFinger, whose rotors' inertia is known.
        state: the nominal model.
    """
    motions = [geared_motion(episode.path, episode.dynamics) for episode in episodes]
    equations = [{e.joint: e for e in episode.equations(state, ()) if e.channel is Channel.MECHANICS} for episode in episodes]
    found = []
    for joint in range(state.joints):
        inertia = max(float(e.dynamics.by_acceleration[:, joint, joint].mean()) for e in episodes)
        if LIGHT * inertia > ROTOR_INERTIA_KG_M2:
            continue
        tried = [
            [_followed(*each, joint, float(gap), len(episodes)) for each in zip(episodes, motions, equations, strict=True)]
            for gap in GAPS_RAD
        ]
        if (finding := _judged(joint, tried)) is not None:
            row_s = episodes[0].path.step_s * episodes[0].path.every
            best = tried[int(np.argmin(_left(tried)))]
            found.append(Rattling(finding, joint, tuple(each.apart for each in best), held_out(tried, row_s, inertia)))
    return found


def _followed(
    episode: EpisodeEquations, motion: np.ndarray, equations: dict[int, Equation], joint: int, gap_rad: float, episodes: int
) -> Followed:
    path, equation = episode.path, equations[joint]
    torque = episode.acting_nm[joint]
    passed, play = follow_play(motion[joint], path.step_s, gap_rad, ROTOR_INERTIA_KG_M2, torque)
    moved = episode.dynamics.by_position[:, joint, joint] * play[:: path.every]
    moved += episode.dynamics.by_acceleration[:, joint, joint] * path.second_differences(play)
    residual = equation.residual + path.averaged(passed - torque) + moved
    fold = folds_of(equation, episodes)
    (without, fold), (left, _) = _windows(equation, fold), _windows(replace(equation, residual=residual), fold)
    noise = WINDOW_FLOOR * equation.sensor_noise
    touched = np.abs(left - without).max(axis=1, initial=0.0) > noise
    apart = _near(passed != torque, round(_AROUND_S / path.step_s))[:: path.every]
    return Followed((left**2).sum(axis=1), (without**2).sum(axis=1), noise**2 * left.shape[1], fold, touched, apart)


def _near(is_so: np.ndarray, steps: int) -> np.ndarray:
    """Where something is so within some steps, shape (s,)."""
    return np.convolve(is_so, np.ones(2 * steps + 1), mode="same") > 0.5


def _windows(equation: Equation, fold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape (w, NUMBERS), and the fold of each; none where the joint does not count."""
    found = in_windows(equation, fold)
    if found is None:
        return np.zeros((0, NUMBERS)), np.zeros(0, dtype=int)
    return found[0].reshape(-1, NUMBERS), found[2].reshape(-1, NUMBERS)[:, 0]


def _left(tried: Sequence[Sequence[Followed]]) -> np.ndarray:
    """What each width leaves, shape (widths,)."""
    return np.array([sum(float(each.with_play.sum()) for each in episodes) for episodes in tried])


def held_out(tried: Sequence[Sequence[Followed]], row_s: float, inertia: float) -> HitErrors:
    """Errors of each fold with the width that is best for the others."""
    before, after, windows = (np.zeros(FOLDS) for _ in range(3))
    for f in range(FOLDS):
        others = [sum(float(each.with_play[each.fold != f].sum()) for each in episodes) for episodes in tried]
        for each in tried[int(np.argmin(others))]:
            hit = each.is_touched & (each.fold == f)
            before[f] += each.without[hit].sum()
            after[f] += each.with_play[hit].sum()
            windows[f] += hit.sum()
    rad = row_s**2 / inertia
    noise = np.sqrt(np.mean([each.noise for each in tried[0]]) / NUMBERS)
    return HitErrors(before * rad**2 / NUMBERS, after * rad**2 / NUMBERS, windows, float(noise * rad), WINDOW_ROWS * row_s)


def _judged(joint: int, tried: Sequence[Sequence[Followed]]) -> Finding | None:
    """The play, where following it explains what nothing else does; ``tried`` by width and episode."""
    lefts = _left(tried)
    best = tried[int(np.argmin(lefts))]
    left, without = (
        sum(float(squares[each.is_touched].sum()) for each, squares in zip(best, of, strict=True))
        for of in ([each.with_play for each in best], [each.without for each in best])
    )
    noise = sum(each.noise * int(each.is_touched.sum()) for each in best)
    windows = sum(int(each.is_touched.sum()) for each in best)
    if windows < LEAST_WINDOWS or left > LEFT_AT_MOST * without or without < BEYOND_NOISE * noise:
        return None
    good = GAPS_RAD[lefts <= AS_GOOD * lefts.min()]
    width = np.sqrt(GAPS_RAD[1] / GAPS_RAD[0])
    low, high = float(good[0] / width), float(good[-1] * width)
    value = float(np.sqrt(low * high))
    return Finding(Sign.RATTLING_ROTOR, joint, value, (low, high), without / noise / BEYOND_NOISE)
