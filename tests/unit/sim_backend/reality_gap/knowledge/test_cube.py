"""What is known of effects on a cube and its tracker."""

import pytest

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Group
from sim_backend.effects.estimate import place_index
from sim_backend.reality_gap.knowledge.cube import (
    COUNTED,
    DELAY,
    DIRECTIONS,
    ENCODER_OFFSET,
    HYPOTHESES,
    KINDS,
    LINEAR,
    NOMINAL,
    NUMBERS_OF_PUSHES,
    PUSHED,
    REPLAYED,
    TABLED,
    TRIALS,
    UNSURE,
    USUAL_SIZES,
    Kind,
)


def test_every_effect_shows_in_one_kind():
    shown = [effect for effects in KINDS.values() for effect in effects]
    assert sorted(shown) == sorted(HYPOTHESES)
    assert set(HYPOTHESES) <= set(CATALOGUE)


@pytest.mark.parametrize("row", LINEAR, ids=lambda row: row.effect)
def test_numbers_in_proportion_move_something(row):
    replays = row.from_replays or (None,) * len(row.parameters)
    for (name, _, unit), moves, trial in zip(row.parameters, row.moves, replays, strict=True):
        assert moves or trial
        assert PARAMETERS[f"{row.effect}.{name}"].unit == unit


def test_every_number_has_a_place_that_an_extended_model_knows():
    numbers = [(row.effect, *number) for row in LINEAR for number in row.parameters]
    numbers += [(effect, *number) for effect, own in NUMBERS_OF_PUSHES.items() for number in own]
    assert all(place_index(PARAMETERS[f"{effect}.{name}"], where) in (None, 0, 1, 2) for effect, name, where, _ in numbers)
    assert {effect: len(own) for effect, own in NUMBERS_OF_PUSHES.items()} == {
        k: PARAMETERS[key].width for k, key in PUSHED.items()
    }
    assert set(USUAL_SIZES) == set(PUSHED) == set(KINDS[Kind.PUSHES])


def test_what_goes_into_replays_are_effects_of_joints():
    assert {CATALOGUE[effect].group for effect in REPLAYED} <= {Group.ACTUATION, Group.BODY, Group.FAULT}
    assert {ENCODER_OFFSET, DELAY} <= set(PARAMETERS)


def test_what_is_tried_is_a_parameter_and_stands_beside_the_nominal_trial():
    assert TRIALS[0] is NOMINAL
    assert {key for trial in TRIALS for key in trial.physics} <= set(PARAMETERS)
    assert all(f"{row.effect}.{row.parameter}" in PARAMETERS and 1.0 not in row.tried for row in TABLED)
    assert all(row.key in PARAMETERS for row in COUNTED)
    tried = {(trial.effect, trial.value) for trial in TRIALS}
    ends = {end for pair in DIRECTIONS.values() for end in pair if end is not None}
    assert ends | set(UNSURE) <= tried
