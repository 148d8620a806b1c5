"""Plain calibration recovers what was planted, so that a comparison with it is fair."""

import numpy as np
import pytest

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.joints.torques.calibrating import METHODS, calibrate
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NAMES, NO_LIMIT, planted_friction

PLANTED_NM = 0.03


@pytest.fixture(scope="module")
def planted():
    return planted_friction(PLANTED_NM)


@pytest.mark.parametrize("method", METHODS[3:])
def test_planted_coulomb_friction_is_recovered(planted, method):
    found = calibrate(planted, NO_LIMIT, method, np.random.default_rng(3))
    friction = found.state.value("coulomb_friction.torque_nm")
    assert friction[1] == pytest.approx(PLANTED_NM, rel=0.25)
    assert np.abs(friction[[0, 2]]).max() < 0.15 * PLANTED_NM
    causes = {(cause.effect, cause.where): cause for cause in found.causes}
    cause = causes["coulomb_friction", NAMES[1]]
    assert cause.value == pytest.approx(friction[1], abs=1e-6)
    assert cause.interval_90[0] < cause.value < cause.interval_90[1]
    nominal, after = planted.look(NO_LIMIT, ()), planted.look(found.state, ())
    assert after.mechanics_left < 0.2 * nominal.sums.square.sum()


OF_OWN_TORQUE = {"torque_saturation.limit_nm", "thermal_derating.rise_k_nm2"}
"""Numbers of a motor of any size: the catalogue's ends are those of a TriFinger's."""


@pytest.mark.parametrize("method", METHODS[3:])
def test_no_number_leaves_the_catalogues_bounds(planted, method):
    found = calibrate(planted, NO_LIMIT, method, np.random.default_rng(4))
    for key, values in found.state.given.items():
        if key not in OF_OWN_TORQUE:
            assert (values >= PARAMETERS[key].lower).all(), key
            assert (values <= PARAMETERS[key].upper).all(), key


def test_the_same_seed_draws_the_same(planted):
    first, second = (calibrate(planted, NO_LIMIT, "simopt", np.random.default_rng(5)) for _ in range(2))
    assert first.causes == second.causes
