"""The fit of a pose: exact pixels give it back from any turn; wrong pixels and a wrong start do not draw it away."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.pose_fit import fitted, rays_of, refined, turns_of_cube
from sim_backend.vision.rotations import angle_between_rad
from tests.unit.sim_backend.vision.exact_pixels import HALF_M, exact_pixels

POSITION_M = np.array([0.05, -0.04, 0.07])
HALF = np.full(3, HALF_M)


def apart(fit, rotation):
    return 1000 * np.linalg.norm(fit.position_m - POSITION_M), np.rad2deg(angle_between_rad(fit.rotation, rotation))


@pytest.mark.parametrize("seed", range(5))
def test_exact_pixels_give_any_pose_back(seed):
    rotation = Rotation.random(rng=seed).as_matrix()
    rays = rays_of(exact_pixels(POSITION_M, rotation), nominal_calibrations(), HALF)
    best = fitted(rays, np.random.default_rng(seed))[0]
    mm, degrees = apart(best, rotation)
    assert mm < 0.01 and degrees < 0.01 and best.explained == 1.0


def test_a_fifth_of_the_pixels_may_be_wrong():
    rotation, rng = Rotation.random(rng=7).as_matrix(), np.random.default_rng(1)
    rays = rays_of(exact_pixels(POSITION_M, rotation, rng, noise=0.1, wrong=0.2), nominal_calibrations(), HALF)
    best = fitted(rays, rng)[0]
    mm, degrees = apart(best, rotation)
    assert mm < 1.5 and degrees < 1.5 and 0.7 < best.explained < 0.95


def test_one_camera_is_enough_and_is_less_sure():
    rotation, rng = Rotation.random(rng=3).as_matrix(), np.random.default_rng(2)
    seen = exact_pixels(POSITION_M, rotation, rng, noise=0.05)
    alone = fitted(rays_of(seen[:1], nominal_calibrations()[:1], HALF), rng)[0]
    all_three = fitted(rays_of(seen, nominal_calibrations(), HALF), rng)[0]
    assert apart(alone, rotation)[0] < 6.0
    assert np.trace(alone.covariance[:3, :3]) > 3 * np.trace(all_three.covariance[:3, :3])


def test_a_wrong_start_does_not_last():
    rotation, rng = Rotation.random(rng=5).as_matrix(), np.random.default_rng(3)
    rays = rays_of(exact_pixels(POSITION_M, rotation), nominal_calibrations(), HALF)
    turned = rotation @ turns_of_cube()[7]
    stuck = refined(rays, POSITION_M, turned)
    best = fitted(rays, rng, [(POSITION_M, turned)])[0]
    assert apart(best, rotation)[1] < 0.01 and best.cost < stuck.cost + 1e-9


def test_a_cube_comes_onto_itself_in_24_ways():
    turns = turns_of_cube()
    assert len({tuple(np.rint(turn).astype(int).ravel()) for turn in turns}) == 24
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
