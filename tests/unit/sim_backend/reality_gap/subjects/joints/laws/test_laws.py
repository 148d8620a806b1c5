"""Every number that a fit of joints changes has a law."""

import pytest

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, Channel, keys_of
from sim_backend.reality_gap.subjects.joints.laws import body_law, motor_law
from sim_backend.reality_gap.subjects.joints.laws.state import NO_EFFECTS
from sim_backend.reality_gap.subjects.joints.torques import reported_velocity, sent_torque

LAWS = {
    Channel.MECHANICS: body_law.KEYS | set(motor_law.KEYS),
    Channel.CURRENT: set(motor_law.KEYS),
    Channel.CONTROLLER: sent_torque.KEYS,
    Channel.VELOCITY: set(reported_velocity.SHOWN),
}


@pytest.mark.parametrize("channel", Channel)
def test_every_number_has_a_law_in_its_equation(channel):
    assert set(keys_of(channel)) <= LAWS[channel]


def test_what_bodies_change_and_what_motors_change_is_not_the_same():
    assert not body_law.KEYS & set(motor_law.KEYS)
    assert set(NUMBERS) | NO_EFFECTS >= body_law.KEYS
