"""The network finds what depends on the motion and nothing in what does not."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.gain import errors_of
from sim_backend.reality_gap.subjects.joints.residual_network import network_error_nm
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NO_LIMIT, drive, foreign_problem, joints_model

ENCODER_RAD = 3e-5


def errors(missing_nm) -> tuple[float, float]:
    position, torque = drive(joints_model(), 20.0, missing_nm)
    problem = foreign_problem(position + ENCODER_RAD * np.random.default_rng(0).standard_normal(position.shape), torque)
    return errors_of(problem, NO_LIMIT).all_joints_nm, network_error_nm(problem.episodes, NO_LIMIT, np.random.default_rng(1))


def test_a_torque_that_follows_two_variables_is_found():
    before, after = errors(lambda velocity: 0.03 * np.tanh(velocity[::-1]) * np.array([0.0, 1.0, 0.0]))
    assert after < 0.3 * before


def test_noise_stays():
    before, after = errors(lambda velocity: 0.0 * velocity)
    assert 0.9 * before < after < 1.1 * before
