"""What is known of effects on a cube and its tracker."""

import pytest

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge.cube import COUNTED, DIRECTIONS, HYPOTHESES, KINDS, LINEAR, NOMINAL, TABLED, TRIALS, UNSURE


def test_every_effect_shows_in_one_kind():
    shown = [effect for effects in KINDS.values() for effect in effects]
    assert sorted(shown) == sorted(HYPOTHESES)
    assert set(HYPOTHESES) <= set(CATALOGUE)


@pytest.mark.parametrize("row", LINEAR, ids=lambda row: row.effect)
def test_numbers_in_proportion_move_something(row):
    replays = row.from_replays or (None,) * len(row.parameters)
    for (name, _, unit), moves, trial in zip(row.parameters, row.moves, replays, strict=True):
        assert moves or trial
        assert PARAMETERS[f"{row.effect}.{name.partition('.')[0]}"].unit == unit


def test_what_is_tried_is_a_parameter_and_stands_beside_the_nominal_trial():
    assert TRIALS[0] is NOMINAL
    assert {key for trial in TRIALS for key in trial.physics} <= set(PARAMETERS)
    assert all(f"{row.effect}.{row.parameter}" in PARAMETERS and 1.0 not in row.tried for row in TABLED)
    assert all(row.key in PARAMETERS for row in COUNTED)
    tried = {(trial.effect, trial.value) for trial in TRIALS}
    ends = {end for pair in DIRECTIONS.values() for end in pair if end is not None}
    assert ends | set(UNSURE) <= tried
