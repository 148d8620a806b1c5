"""Every effect has one group of words, so that a new one is told by existing."""

from collections import Counter

from api_schemas.why import TRAINING
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.causes import CAUSES, cause_of, present
from sim_backend.effects.effect import Group
from sim_backend.effects.physics import Physics


def test_every_effect_is_in_one_group():
    assert Counter(name for cause in CAUSES for name in cause.effects) == Counter(list(CATALOGUE))


def test_training_has_advice_for_every_group_but_faults():
    assert set(TRAINING) == {cause.name for cause in CAUSES} - {"fault"}
    assert {name for name, effect in CATALOGUE.items() if effect.group is Group.FAULT} == set(cause_of("stuck_joint").effects)


def test_present_groups_hold_what_the_robot_has_at_any_time():
    now, later = Physics.of(1, {"coulomb_friction.torque_nm": 0.02}), Physics.of(1, {"encoder_jump.offset_rad": 0.1})
    found = {cause.name: cause.effects for cause in present([now, later])}
    assert found == {"joint_friction": ("coulomb_friction",), "fault": ("encoder_jump",)}
