"""Errors of tracked poses, against independent formulas and statistics with limits from n."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from sim_backend.effects import noise, pose_errors

N = 4000
SEEDS, STEPS = np.arange(N), np.zeros(N, dtype=np.int64)


def normals(count, first=100):
    return noise.gaussians(SEEDS, STEPS, np.arange(first, first + count))


def uniforms(count, first=100):
    return noise.uniforms(SEEDS, STEPS, np.arange(first, first + count))


def poses(n, seed=1):
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=(n, 4))
    return rng.uniform(-0.1, 0.1, (n, 3)), quat / np.linalg.norm(quat, axis=1, keepdims=True)


def rotation(quat_wxyz) -> Rotation:
    return Rotation.from_quat(np.roll(quat_wxyz, -1, axis=-1))


def std_limits(std, n, tails=1e-6):
    """Limits that a sample's standard deviation stays between with probability 1 - ``tails``."""
    return std * np.sqrt(chi2.ppf([tails / 2, 1 - tails / 2], n - 1) / (n - 1))


def within(measured, std, n):
    low, high = std_limits(std, n)
    return low < measured < high


def rate_margin(probability, n):
    """Five standard deviations of a rate out of n."""
    return 5 * np.sqrt(probability * (1 - probability) / n)


def test_the_24_turns_are_those_of_a_cube():
    turns = rotation(pose_errors.CUBE_TURNS_WXYZ)
    assert len(turns) == 24 and turns[0].magnitude() == 0
    matrices = turns.as_matrix()
    np.testing.assert_allclose(np.abs(matrices).max(axis=2), 1.0, atol=1e-12)  # axes go to axes
    assert len({tuple(np.rint(matrix).astype(int).ravel()) for matrix in matrices}) == 24


def test_jumps_come_at_their_rate_and_to_each_of_the_23_others():
    quat = np.tile(poses(1)[1], (N, 1))
    jumped = pose_errors.jumped_quat(quat, np.full(N, 0.5), uniforms(2))
    changed = (jumped != quat).any(axis=1)
    assert abs(changed.mean() - 0.5) < rate_margin(0.5, N)
    local = rotation(quat[changed]).inv() * rotation(jumped[changed])
    distance = np.array(
        [[(turn.inv() * one).magnitude() for turn in rotation(pose_errors.CUBE_TURNS_WXYZ)] for one in local[:400]]
    )
    assert (distance.min(axis=1) < 1e-6).all()
    assert set(distance.argmin(axis=1)) == set(range(1, 24))


@pytest.mark.parametrize(("hidden", "expected"), [(0.0, 0.01), (1.0, 0.04), (0.5, 0.02), (2.0, 0.16), (5.0, 1.0)])
def test_the_jump_rate_grows_with_the_faces_that_are_hidden(hidden, expected):
    got = pose_errors.jump_probability(np.array([0.01]), np.array([4.0]), np.array([hidden]))
    np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_scale_moves_away_from_the_origin():
    position, _ = poses(5)
    np.testing.assert_allclose(pose_errors.scaled_position_m(position, np.full(5, 0.03)), 1.03 * position, rtol=1e-12)


def test_offset_is_a_rigid_motion_of_what_the_cameras_see():
    (position, quat), (shift, turn) = poses(20), (poses(20, 2)[0], poses(20, 3)[0])
    moved, turned = pose_errors.offset_pose(position, quat, shift, turn)
    rigid = Rotation.from_rotvec(turn)
    np.testing.assert_allclose(moved, rigid.apply(position) + shift, atol=1e-14)
    np.testing.assert_allclose((rotation(turned).inv() * rigid * rotation(quat)).magnitude(), 0.0, atol=1e-7)


def test_pose_noise_has_its_standard_deviation_in_every_direction():
    position, quat = np.zeros((N, 3)), np.tile(poses(1)[1], (N, 1))
    moved, turned = pose_errors.noisy_pose(position, quat, np.full(N, 0.003), np.full(N, 0.05), normals(6))
    turn = (rotation(turned) * rotation(quat).inv()).as_rotvec()
    for axis in range(3):
        assert within(moved[:, axis].std(ddof=1), 0.003, N)
        assert within(turn[:, axis].std(ddof=1), 0.05, N)
    margin = 5 / np.sqrt(N)
    assert (np.abs(moved.mean(axis=0)) < margin * 0.003).all() and (np.abs(turn.mean(axis=0)) < margin * 0.05).all()


def test_absent_values_pass_numbers_untouched():
    position, quat = poses(50)
    position[0], quat[0] = (-0.0, 0.1, -0.1), (1.0, -0.0, 0.0, -0.0)
    zero, none = np.zeros(50), np.zeros((50, 3))
    chance = pose_errors.jump_probability(zero, np.full(50, 4.0), np.full(50, 3.0))
    outcomes = [
        (pose_errors.scaled_position_m(position, zero), quat),
        pose_errors.offset_pose(position, quat, none, none),
        (position, pose_errors.jumped_quat(quat, chance, uniforms(2)[:50])),
        pose_errors.noisy_pose(position, quat, zero, zero, normals(6)[:50]),
    ]
    for moved, turned in outcomes:
        assert moved.tobytes() == position.tobytes() and turned.tobytes() == quat.tobytes()
