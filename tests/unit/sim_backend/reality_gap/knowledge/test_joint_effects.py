"""What is known of effects at joints, and that every effect is known somewhere."""

import pytest

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge import cube, tosses
from sim_backend.reality_gap.knowledge.joint_effects import (
    FITTED,
    NOT_ASKED,
    NUMBERS,
    SCALES,
    SEEN,
    SHAPES,
    TAKES_OVER,
    Channel,
    Plane,
    Sign,
    keys_of,
    plane_of,
    scales_everything,
    shape_of,
)


def effects(keys) -> set[str]:
    return {key.partition(".")[0] for key in keys}


def test_every_effect_of_the_catalogue_is_asked_for_or_says_why_not():
    asked = {*FITTED, *effects(SEEN.values()), *cube.HYPOTHESES, *(known.effect for known in tosses.TOSSED)}
    assert asked | set(NOT_ASKED) == set(CATALOGUE)
    assert not asked & set(NOT_ASKED)


@pytest.mark.parametrize("key", [*NUMBERS, *SHAPES, *SEEN.values()])
def test_keys_are_parameters_of_the_catalogue(key):
    assert key in PARAMETERS


@pytest.mark.parametrize("entry", FITTED.values(), ids=FITTED)
def test_an_entry_has_scales_and_numbers_of_one_effect(entry):
    assert effects(number.key for number in entry.numbers) == {entry.effect}
    assert all(SCALES[number.key] > 0.0 for number in entry.numbers)
    assert not entry.contains or entry.contains in FITTED
    for number in entry.numbers:
        assert number.begins_at_load or number.shape is not None or all(number.probes) or not number.probes
        assert number.product_with is None or number.product_with[0] in PARAMETERS


def test_a_plane_is_spanned_by_two_values():
    for shape in SHAPES.values():
        assert shape.plane is None or len(shape.values) == 2
    assert plane_of("cogging") is Plane.WAVE
    assert plane_of("coulomb_friction") is plane_of("nothing") is None
    assert shape_of("stribeck_friction").key == "stribeck_friction.speed_rad_s"


def test_every_number_has_one_equation():
    keys = [key for channel in Channel for key in keys_of(channel)]
    assert sorted(keys) == sorted(NUMBERS)


def test_every_sign_tells_a_parameter_and_is_said_without_its_effect():
    assert set(SEEN) == set(Sign)
    assert set(TAKES_OVER.values()) <= set(FITTED)
    for sign, key in SEEN.items():
        assert key.partition(".")[0].replace("_", " ") not in sign


def test_only_torques_and_masses_scale_everything():
    assert {effect for effect in CATALOGUE if scales_everything(effect)} == {"torque_constant", "link_mass"}
