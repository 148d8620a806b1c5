"""Of robots with many causes only rows count in which a joint keeps moving and its motor's torque keeps its sign."""

from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import pauses, rests, reverses
from sim_backend.reality_gap.subjects.joints.torques.steady_rows import where_steady

STEP_S, HZ = 1e-3, 0.5
TIME_S = STEP_S * np.arange(8000)


def swinging(torque_nm):
    """A joint for each column of torques (s, k) that swings to and fro, and stops for 12 ms halfway; its path."""
    phase = 2.0 * np.pi * HZ * TIME_S
    speed = np.cos(phase)
    speed[3000:3012] = 0.0
    position = np.tile(STEP_S * np.cumsum(speed)[:, None], (1, torque_nm.shape[1]))
    joints = JointSignals(
        tuple("abc"[: torque_nm.shape[1]]), position, np.gradient(position, STEP_S, axis=0), torque_nm, torque_nm
    )
    return trajectory(Recording("swing", "swing", STEP_S, TIME_S, joints))


@dataclass
class Rows:
    """What is asked of an episode: its path, torques (k, s) and which rows count, (t, k)."""

    path: object
    acting_nm: np.ndarray
    valid_mechanics: np.ndarray

    def counting_only(self, rows):
        return Rows(self.path, self.acting_nm, self.valid_mechanics & rows)


def episode(torque_nm):
    path = swinging(torque_nm)
    return Rows(path, torque_nm.T, np.ones(path.velocity.shape, bool))


def at(path, seconds):
    return int(np.argmin(np.abs(path.time_s - seconds)))


def test_a_joint_that_stops_for_a_moment_pauses_and_does_not_rest():
    path = swinging(np.ones((8000, 1)))
    stop, later = at(path, 3.006), at(path, 3.1)
    assert pauses(path)[stop, 0] and not rests(path)[stop, 0]
    assert not pauses(path)[later, 0]


def test_a_torque_reverses_where_its_sign_changes_and_not_by_one_sample_of_noise():
    torque = np.where(TIME_S < 4.0, 0.1, -0.1)[:, None]
    torque[2000] = -0.1
    path = swinging(torque)
    found = reverses(path, torque.T)[:, 0]
    assert found[at(path, 4.0)] and found[at(path, 4.015)] and not found[at(path, 4.04)]
    assert not found[at(path, 2.0)]


def test_reversals_do_not_count_where_both_directions_are_left():
    forwards = np.cos(2.0 * np.pi * HZ * TIME_S) > 0.0
    friction = np.where(forwards, 0.05, -0.05)
    # the second joint hangs so that a torque about zero moves it forwards
    light = np.where(forwards, 0.005 * np.sin(2.0 * np.pi * 40.0 * TIME_S), -0.1)
    (found,) = where_steady([episode(np.stack([friction, light], axis=1))])
    path, rows = found.path, found.valid_mechanics
    moves = ~pauses(path)
    assert not rows[~moves].any()
    assert 0 < rows[:, 0].sum() <= moves[:, 0].sum()
    assert not rows[reverses(path, found.acting_nm)[:, 0], 0].any()
    np.testing.assert_array_equal(rows[:, 1], moves[:, 1])


def test_directions_are_counted_over_all_recordings():
    forwards = np.cos(2.0 * np.pi * HZ * TIME_S) > 0.0
    light = np.where(forwards, 0.005 * np.sin(2.0 * np.pi * 40.0 * TIME_S), -0.1)[:, None]
    steady = np.where(forwards, 0.05, -0.05)[:, None]
    (alone,) = where_steady([episode(light)])
    beside, _ = where_steady([episode(light), episode(steady)])
    assert alone.valid_mechanics.sum() > 1.5 * beside.valid_mechanics.sum()
