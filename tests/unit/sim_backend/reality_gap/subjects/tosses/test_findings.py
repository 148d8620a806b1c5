"""When a rival is confusable with a cause."""

import pytest

from sim_backend.reality_gap.knowledge.tosses import OBJECT, TossEffect
from sim_backend.reality_gap.subjects.tosses.findings import Lost
from sim_backend.reality_gap.subjects.tosses.likelihood import Point
from sim_backend.reality_gap.subjects.tosses.models import FRICTION, GRAVITY, ROLL, SIZE
from sim_backend.reality_gap.subjects.tosses.search import TossHypothesis, bounds_of, grid_of
from sim_backend.reality_gap.verdict import Rival


@pytest.mark.parametrize(
    ("by_kind", "std", "confusable"),
    [
        ({"flight": 7.0, "motion": -0.2}, {"flight": 0.7, "motion": 4.5}, False),  # flight separates, motion is chance
        ({"flight": 0.0, "motion": 3.0}, {"flight": 0.0, "motion": 4.5}, True),  # nothing separates
        ({"flight": 7.0, "motion": -20.0}, {"flight": 0.7, "motion": 4.5}, True),  # two kinds contradict each other
    ],
)
def test_rival_is_confusable_unless_a_kind_of_evidence_separates_it(by_kind, std, confusable):
    rival = Rival("cube_size", "thing", sum(by_kind.values()), "")
    lost = Lost(
        rival, "tracking_scale", 1.0, 0.98, by_kind, std, TossHypothesis(TossEffect((SIZE,), OBJECT), "thing"), Point({}, {})
    )
    assert lost.confusable is confusable


@pytest.mark.parametrize(("key", "start"), [(FRICTION, 1.0), (FRICTION, 0.05), (GRAVITY, 0.0), (ROLL, 0.1), (SIZE, 1.0)])
def test_a_first_look_keeps_the_start_and_the_bounds(key, start):
    grid, (lower, upper) = grid_of(key, start), bounds_of(key)
    assert start in grid
    assert (grid.min() >= lower) & (grid.max() <= upper)
    assert (grid[1:] > grid[:-1]).all()
