"""Rotations against scipy's, which share no code with them."""

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.vision.rotations import angle_between_rad, matrices_of, matrix_of_quat, multiplied, quat_of_matrix


def test_they_are_those_of_scipy():
    rng = np.random.default_rng(2)
    vectors = rng.uniform(-3, 3, (20, 3))
    known = Rotation.from_rotvec(vectors)
    np.testing.assert_allclose(matrices_of(vectors), known.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(matrices_of(np.zeros((1, 3)))[0], np.eye(3))
    for quat, matrix in zip(known.as_quat(canonical=True, scalar_first=True), known.as_matrix(), strict=True):
        np.testing.assert_allclose(matrix_of_quat(quat), matrix, atol=1e-12)
        np.testing.assert_allclose(quat_of_matrix(matrix), quat, atol=1e-12)
    one, other = known[0], known[1]
    both = multiplied(one.as_quat(scalar_first=True), other.as_quat(scalar_first=True))
    np.testing.assert_allclose(matrix_of_quat(both), (one * other).as_matrix(), atol=1e-12)


def test_half_turns_have_a_quaternion_and_angles_are_those_between():
    for axis in np.eye(3):
        turn = Rotation.from_rotvec(np.pi * axis).as_matrix()
        np.testing.assert_allclose(np.abs(quat_of_matrix(turn)), [0, *axis], atol=1e-12)
        assert abs(angle_between_rad(np.eye(3), turn) - np.pi) < 1e-9
    assert abs(angle_between_rad(np.eye(3), Rotation.from_rotvec([0, 0.001, 0]).as_matrix()) - 0.001) < 1e-12
