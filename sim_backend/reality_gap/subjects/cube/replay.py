"""Pushes replayed: the fingers are led along what the joints measured, the cube lies where the tracker saw it.

The measured torques act, and the position controller adds what keeps the joints on the measured way; that addition, as a force
at the tip, is what the model lacks. Beside it stands where the cube goes. All pushes are replayed under a fixed table of
hypotheses at once, so that the models are compiled once for each robot that is replayed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.cube import TRIALS, Trial
from sim_backend.reality_gap.subjects.cube.replayed_robot import NOMINAL_ROBOT, ReplayedRobot
from sim_backend.reality_gap.subjects.cube.windows import LENGTH_S, PushWindow
from sim_backend.trifinger import constants as c

BIN_STEPS = 20
"""Forces are means over so many milliseconds."""
VIEW_LIMIT = 8.0
"""Residuals count up to so many standard deviations: a cube that tips in one replay and not in another says little."""
FORCE_STD_N, PLACE_STD_M, YAW_STD_RAD = 0.15, 0.002, 0.03
"""Weights of the channels. They say only what is looked at; how much a healthy session scatters is measured on healthy ones."""
_ROWS_AT_ONCE = 6


@dataclass(frozen=True)
class Replayed:
    """Residuals of one push in units of the channels' weights.

    Attributes:
        residual: measured minus replayed, shape (trials, k).
        channel: of each column: 0 to 2 the force along, across and up, 3 to 5 the cube's way along, across and its turn.
        time_s: of each column, from the window's begin, shape (k,).
    """

    residual: np.ndarray
    channel: np.ndarray
    time_s: np.ndarray


class PushReplay:
    """Replays pushes under all ``trials``. Owner of the simulated robots that do it."""

    def __init__(self, trials: Sequence[Trial] = TRIALS, threads: int = 1, base: ReplayedRobot = NOMINAL_ROBOT) -> None:
        self.trials, self._base = tuple(trials), base
        rows = [base.tried(trial) for trial in self.trials for _ in range(_ROWS_AT_ONCE)]
        self._driver = SimulatedDriver(robots=len(rows), threads=threads, physics=Physics.stack(rows))
        self._rest_m = self._driver.rest_height_m(np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1)))

    def replay(self, windows: Sequence[PushWindow]) -> list[Replayed]:
        """Residuals of pushes, in order."""
        replayed: list[Replayed] = []
        for first in range(0, len(windows), _ROWS_AT_ONCE):
            some = windows[first : first + _ROWS_AT_ONCE]
            extra_nm, place_m, yaw_rad = self._simulate([some[i % len(some)] for i in range(_ROWS_AT_ONCE)])
            for i, window in enumerate(some):
                rows = slice(i, None, _ROWS_AT_ONCE)
                seen_m = np.stack([self._base.seen_m(trial, place_m[rows][k]) for k, trial in enumerate(self.trials)])
                replayed.append(_residuals(window, extra_nm[rows], seen_m, yaw_rad[rows]))
        return replayed

    def _simulate(self, windows: Sequence[PushWindow]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torque added to the pushing finger's joints (rows, s, 3), the cube's place (rows, s, 2) and turn (rows, s)."""
        count, steps = len(self.trials), round(LENGTH_S / c.PHYSICS_STEP_S)
        position, velocity, torque = (
            np.tile(np.stack([getattr(window, name) for window in windows]), (count, 1, 1))
            for name in ("joint_position_rad", "joint_velocity_rad_s", "torque_nm")
        )
        self._driver.reset(self._start(windows, position, velocity))
        damping = c.SAFETY_DAMPING_NM_S_RAD + c.VELOCITY_GAIN_NM_S_RAD
        extra, place, quat = np.empty_like(torque), np.empty((len(position), steps, 2)), np.empty((len(position), steps, 4))
        for step in range(steps):
            wanted = torque[:, step] + damping * velocity[:, step]
            segment = self._driver.advance([(Command(wanted, position[:, step]), 1)])
            extra[:, step] = segment.applied_torque_nm[:, 0] - torque[:, step]
            place[:, step], quat[:, step] = segment.cube_position_world_m[:, 0, :2], segment.cube_quat_wxyz[:, 0]
        fingers = np.tile([3 * window.finger for window in windows], count)
        columns = fingers[:, None, None] + np.arange(3)
        yaw = np.unwrap(2 * np.arctan2(quat[:, :, 3], quat[:, :, 0]), axis=1)
        return np.take_along_axis(extra, columns, axis=2), place, yaw

    def _start(self, windows: Sequence[PushWindow], position: np.ndarray, velocity: np.ndarray) -> Start:
        seen = np.stack([window.cube_xy_m for window in windows])
        xy = np.concatenate([self._base.place_m(trial, seen) for trial in self.trials])
        yaw = np.tile([window.cube_yaw_rad for window in windows], len(self.trials))
        quat = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=1)
        place = np.concatenate([xy, self._rest_m[:, None]], axis=1)
        return Start(position[:, 0], place, quat, joint_velocity_rad_s=velocity[:, :10].mean(axis=1))


def _residuals(window: PushWindow, extra_nm: np.ndarray, seen_m: np.ndarray, yaw_rad: np.ndarray) -> Replayed:
    """Forces in bins and poses in frames, as seen along the push; first axis of the arrays: trials."""
    trials, bins = len(extra_nm), extra_nm.shape[1] // BIN_STEPS
    torque = extra_nm[:, : bins * BIN_STEPS].reshape(trials, bins, BIN_STEPS, 3).mean(axis=2)
    jacobian = window.jacobian_m[BIN_STEPS // 2 :: BIN_STEPS][:bins]
    force = np.linalg.solve(np.swapaxes(jacobian, -1, -2)[None], torque[..., None])[..., 0]
    along = np.array([*window.direction, 0.0])
    axes = np.stack([along, [-along[1], along[0], 0.0], [0.0, 0.0, 1.0]], axis=1)
    force = -(force @ axes) / FORCE_STD_N
    frames = window.frame_steps
    way = (window.frame_xy_m - seen_m[:, frames]) @ axes[:2, :2] / PLACE_STD_M
    turn = np.nan_to_num(window.frame_yaw_rad - yaw_rad[:, frames]) / YAW_STD_RAD
    pose = np.concatenate([way, turn[..., None]], axis=2)
    residual = np.concatenate([force.reshape(trials, -1), pose.reshape(trials, -1)], axis=1)
    channel = np.concatenate([np.tile([0, 1, 2], bins), np.tile([3, 4, 5], len(frames))])
    times = np.concatenate([np.repeat(np.arange(bins) + 0.5, 3) * BIN_STEPS, np.repeat(frames, 3)]) * c.PHYSICS_STEP_S
    return Replayed(np.clip(residual, -VIEW_LIMIT, VIEW_LIMIT), channel, times)
