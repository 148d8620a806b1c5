"""Recordings cut into windows, as rollouts are compared with them."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.laws.past import Past
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Windows
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import near_end_samples
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_MOST_WINDOWS, LEAST_WINDOWS, _OF_JOINTS = 60, 20, 120
"""So many windows, and fewer the more joints there are, whose simulations cost more and say more."""
_RESTS = 10.0
"""Times the noise of its encoder that a joint must go within a window to be said to move."""
_EDGE_S = 0.1
"""Of a recording, at both ends, where its smoothed velocity is not as good."""


def windows_of(episodes: Sequence[EpisodeEquations], length_s: float, step_s: float, noise_rad: np.ndarray) -> Windows:
    """Windows of a length, one after the other, in which everything was measured; not too many, evenly spread.

    Those in which a joint comes near an end of its range are left out if enough others are left, since the end acts there, too.
    Of those in which every joint rests there are at most half as many as of the others: how a robot rests under a load says
    something of its friction, but most models rest there, too, however wrong they are.

    Args:
        episodes: to be cut.
        length_s: of a window.
        step_s: of its samples.
        noise_rad: of the encoders, shape (k,).
    """
    most = int(np.clip(_OF_JOINTS // episodes[0].plant.joints, LEAST_WINDOWS, _MOST_WINDOWS))
    moving, resting = _moving_and_resting(episodes, length_s, noise_rad, keep_off_ends=True)
    if len(moving) < LEAST_WINDOWS:
        moving, resting = _moving_and_resting(episodes, length_s, noise_rad, keep_off_ends=False)
    parts = sorted([*moving, *_spread(resting, len(moving) // 2)]) if moving else resting
    return _windows(episodes, _spread(parts, most), round(length_s / step_s), step_s)


def _moving_and_resting(
    episodes: Sequence[EpisodeEquations], length_s: float, noise_rad: np.ndarray, *, keep_off_ends: bool
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Windows in which some joint moves, and those in which none does: index of the episode and of the first sample."""
    moving, resting = list[tuple[int, int]](), list[tuple[int, int]]()
    for owner, episode in enumerate(episodes):
        path = episode.path
        known = (np.isfinite(path.joints.position_rad) & episode.is_torque_known).all(axis=1)
        if keep_off_ends:
            known &= ~near_end_samples(path, episode.ends_rad).any(axis=1)
        edge, rows = _lead_rows(episode), round(length_s / path.step_s)
        unknown = np.concatenate([[0], np.cumsum(~known)])
        starts = np.arange(edge, path.joints.position_rad.shape[0] - rows - edge - 2, rows)
        for first in (int(first) for first in starts if unknown[first + rows + 2] == unknown[first]):
            is_moving = moves(path.joints.position_rad[None, first : first + rows], noise_rad)[0]
            (moving if is_moving else resting).append((owner, first))
    return moving, resting


def moves(position_rad: np.ndarray, noise_rad: np.ndarray) -> np.ndarray:
    """Whether any joint moves in each window, shapes (n, s, k), (k,) and (n,)."""
    return np.asarray((np.ptp(position_rad, axis=1) > _RESTS * noise_rad).any(axis=1))


def _spread(parts: Sequence[tuple[int, int]], most: int) -> list[tuple[int, int]]:
    """At most so many of them, evenly spread."""
    chosen = sorted({int(i) for i in np.linspace(0, len(parts) - 1, min(most, len(parts)))}) if parts else []
    return [parts[i] for i in chosen]


def _windows(episodes: Sequence[EpisodeEquations], parts: Sequence[tuple[int, int]], samples: int, step_s: float) -> Windows:
    k = episodes[0].plant.joints
    position, sent, begin, speed, laws = [], [], [], [], []
    edges_s = step_s * np.arange(samples + 1)
    laws_of = [e.path.joints.feedback for e in episodes]
    is_on_board = any(law is not None and law.is_on_board.any() for law in laws_of)
    lead = min(int(_lead_rows(e) * e.path.step_s / step_s + 1e-9) for e in episodes) if is_on_board else 0
    for owner, first in parts:
        episode, path = episodes[owner], episodes[owner].path
        rows = slice(first, first + round(edges_s[-1] / path.step_s) + 2)
        position.append(_between(path.joints.position_rad[rows], path.step_s, edges_s[1:]))
        sent.append(_mean_of_held(episode.acting_nm.T[rows], path.step_s, edges_s))
        begin.append(path.fast_position[first])
        speed.append(path.fast_velocity[first])
        if path.joints.feedback is not None:
            begins, before = first - _lead_rows(episode), _lead_rows(episode) * path.step_s
            law, known_s = path.joints.feedback.at(slice(begins, rows.stop)), before + step_s * np.arange(-lead, samples + 1)
            laws.append(Feedback(*(_mean_of_held(getattr(law, field.name), path.step_s, known_s) for field in fields(law))))
    return Windows(
        step_s,
        np.array(position).reshape(-1, samples, k),
        np.array(begin).reshape(-1, k),
        np.array(speed).reshape(-1, k),
        np.array(sent).reshape(-1, samples, k),
        Feedback.stacked(laws) if laws and len(laws) == len(parts) else None,
        owner := np.array([part[0] for part in parts], dtype=int),
        Past(
            [episode.driving_nm for episode in episodes],
            [episode.warmth_k for episode in episodes],
            [episode.path.step_s for episode in episodes],
            owner,
            np.array([part[1] for part in parts], dtype=int),
        ),
        lead,
    )


def _lead_rows(episode: EpisodeEquations) -> int:
    """Rows before each window: none begins nearer to the begin of its recording."""
    return round(_EDGE_S / episode.path.step_s)


def _between(series: np.ndarray, step_s: float, times_s: np.ndarray) -> np.ndarray:
    """Samples (s, k) that are ``step_s`` apart, at other times from the first one on."""
    own_s = step_s * np.arange(len(series))
    return np.stack([np.interp(times_s, own_s, column) for column in series.T], axis=1)


def _mean_of_held(series: np.ndarray, step_s: float, edges_s: np.ndarray) -> np.ndarray:
    """Means of values (s, k), each held for ``step_s``, between edges (t + 1,) from the first one on; shape (t, k).

    A mean over anything infinite, such as the limit of a controller that has none, is infinite.
    """
    if np.isinf(series).any():
        touched = _mean_of_held(np.isinf(series).astype(float), step_s, edges_s) > 0.0
        return np.where(touched, np.inf, _mean_of_held(np.where(np.isinf(series), 0.0, series), step_s, edges_s))
    sums = np.concatenate([np.zeros((1, series.shape[1])), np.cumsum(series, axis=0)]) * step_s
    at_edges = _between(sums, step_s, edges_s)
    return np.diff(at_edges, axis=0) / np.diff(edges_s)[:, None]


def torque_noise_nm(episodes: Sequence[EpisodeEquations], step_s: float) -> np.ndarray:
    """Noise of torques that drive windows of samples ``step_s`` apart, shape (k,); none where they were sent, not measured."""
    found = []
    for episode in episodes:
        measured = episode.path.joints.measured_torque_nm
        if measured is None:
            found.append(np.zeros(episode.plant.joints))
            continue
        found.append(white_noise(measured) / np.sqrt(max(1.0, step_s / episode.path.step_s)))
    return np.sqrt(np.mean(np.square(found), axis=0))
