"""Motors cool as their time constant says, and a robot waits before they get too hot."""

import numpy as np
import pytest

from robot_farm.cooling import PAUSE_ABOVE_K, RESUME_BELOW_K, cooled_k, pause_s
from sim_backend.effects.physics import Physics

PHYSICS = Physics.of(1, {"thermal_derating.time_constant_s": 200.0})


def test_a_cool_robot_does_not_wait():
    assert pause_s(np.full(9, PAUSE_ABOVE_K), PHYSICS) == 0.0


def test_after_the_pause_the_hottest_motor_is_just_cool_enough():
    rise_k = np.array([PAUSE_ABOVE_K + 15.0, RESUME_BELOW_K - 5.0] + [0.0] * 7)
    wait_s = pause_s(rise_k, PHYSICS)
    after_k = cooled_k(rise_k, PHYSICS, wait_s)
    assert wait_s > 0
    assert after_k.max() == pytest.approx(RESUME_BELOW_K)
    assert after_k[1] == pytest.approx((RESUME_BELOW_K - 5.0) * np.exp(-wait_s / 200.0))
