"""How late commands came, from how many samples each one was awaited."""

import numpy as np
import pytest

from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.signs.command_lateness import lateness_std_s
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import SentTorque
from sim_backend.trifinger import constants as c

STEP_S = 1e-3
REST_RAD = np.tile([0.0, 0.9, -1.7], 3)


@pytest.mark.parametrize("std_s", [0.0004, 0.001, 0.003])
def test_the_scale_of_half_normal_lateness_is_found_from_rounded_counts(std_s):
    late = np.round(std_s / STEP_S * np.abs(np.random.default_rng(2).standard_normal(4000)))
    found, error = lateness_std_s(late, STEP_S)
    assert found == pytest.approx(std_s, abs=3.5 * error)
    assert error < 0.05 * std_s


def test_commands_that_come_in_time_are_not_late():
    assert lateness_std_s(np.zeros(100), STEP_S)[0] == 0.0


def test_each_target_is_late_by_the_samples_in_which_the_one_before_it_acts():
    steps, late = 400, (0, 3, 1, 0, 5, 2, 0)
    offset = 0.02 * np.random.default_rng(3).standard_normal((len(late) + 1, 9))
    target = np.repeat(REST_RAD + offset, steps // 8, axis=0)
    acting = target.copy()
    for index, samples in enumerate(late, start=1):
        start = index * steps // 8
        acting[start : start + samples] = target[start - 1]
    nothing, state = np.zeros((steps, 9)), JointState(9)

    def pipeline(targets: np.ndarray, sent: np.ndarray) -> SentTorque:
        signals = {"velocity_rad_s": nothing, "position_target_rad": targets, "desired_torque_nm": nothing}
        return SentTorque(JointSignals(c.JOINT_NAMES, nothing + REST_RAD, commanded_torque_nm=sent, **signals), sent, STEP_S)

    sent = -pipeline(acting, nothing).residual(state)
    assert pipeline(target, sent).late_steps(state).tolist() == list(late)
