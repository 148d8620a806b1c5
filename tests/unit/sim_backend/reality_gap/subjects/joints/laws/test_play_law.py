"""Play along a recorded motion against the catalogue's own law, of a rotor and a link that are simulated here."""

import numpy as np
import pytest

from sim_backend.effects.actuation import ROTOR_INERTIA_KG_M2, backlash
from sim_backend.reality_gap.subjects.joints.laws.play_law import follow_play

STEP_S, STEPS, GAP_RAD = 1e-3, 2000, 0.004
LIGHT_KG_M2 = 4.3e-4


def thrown(inertia_kg_m2, pull_nm):
    """A link that something pulls at while its motor goes to and fro; the motion as an encoder has it, torques and play."""
    motor = 0.08 * np.sin(2.0 * np.pi * 6.0 * STEP_S * np.arange(STEPS))
    position = speed = play = rotor = 0.0
    reported, speeds, passed, plays = (np.zeros(STEPS) for _ in range(4))
    for i in range(STEPS):
        reported[i] = position + play
        speeds[i] = rotor if abs(play) < 0.5 * GAP_RAD else speed
        play, rotor, passed[i] = backlash.py_func(play, rotor, speed, motor[i], GAP_RAD, ROTOR_INERTIA_KG_M2, STEP_S)
        plays[i] = play
        speed += STEP_S * (passed[i] + pull_nm) / inertia_kg_m2
        position += STEP_S * speed
    motion = np.stack([reported, speeds, np.full(STEPS, pull_nm / inertia_kg_m2)])
    return motion, motor, passed, plays


@pytest.mark.parametrize("pull_nm", [0.0, -0.02])
def test_a_rotor_is_followed_through_its_play(pull_nm):
    motion, motor, passed, plays = thrown(LIGHT_KG_M2, pull_nm)
    assert np.ptp(plays) == pytest.approx(GAP_RAD), "both sides are touched"
    followed, play = follow_play(motion, STEP_S, GAP_RAD, ROTOR_INERTIA_KG_M2, motor)
    assert np.sqrt(np.mean((play - plays)[20:] ** 2)) < 0.15 * GAP_RAD
    given, wanted = (np.cumsum(each)[20:] * STEP_S for each in (followed, passed))
    without = np.cumsum(motor)[20:] * STEP_S
    assert np.std(given - wanted) < 0.2 * np.std(without - wanted), "what the link was given"


def test_a_motor_that_presses_all_the_time_passes_everything():
    motion = np.zeros((3, STEPS))
    torque = np.full(STEPS, 0.05)
    motion[0], motion[1] = 0.5 * 12.5 * (STEP_S * np.arange(STEPS)) ** 2, 12.5 * STEP_S * np.arange(STEPS)
    passed, play = follow_play(motion, STEP_S, GAP_RAD, ROTOR_INERTIA_KG_M2, torque)
    assert passed[50:] == pytest.approx(torque[50:])
    assert play[50:] == pytest.approx(0.5 * GAP_RAD)
