"""What a session shows without any one of its pushes, on pushes that are made up."""

from collections.abc import Sequence

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.cube import TRIALS, Kind
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.replay import Replayed
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.support import Supported, supported
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics

NULL = load_calibration().null
TRACKER = TrackerStatistics(500, 0.1, 0.09, 0.003, 1, 1, 0, 450, 0.0324, 0.001, 0.0115, 0.916)
HEAVY = next(i for i, trial in enumerate(TRIALS) if (trial.effect, trial.value) == ("cube_mass", 1.25))
SIZE = 60


def _pushes(count: int, heavy: Sequence[int]) -> tuple[Replayed, ...]:
    """Pushes that each trial changes in a way of its own; those of ``heavy`` went as with a heavier cube."""
    ways = np.random.default_rng(3).normal(size=(len(TRIALS), SIZE))
    ways[0] = 0.0
    channel, time_s = np.arange(SIZE) % 6, np.linspace(0.0, 0.66, SIZE)
    return tuple(Replayed((ways[HEAVY] if k in heavy else ways[0]) - ways, channel, time_s) for k in range(count))


def test_a_cause_in_one_push_alone_gains_next_to_nothing_and_one_in_all_pushes_gains():
    accident, cause = (CubeEvidence(TRACKER, _pushes(5, heavy)) for heavy in ((2,), (0, 1, 2, 3, 4)))
    by_one, by_all = supported(accident, NULL), supported(cause, NULL)
    assert (by_one.ranking[0].effect, by_all.ranking[0].effect) == ("cube_mass", "cube_mass")
    assert by_one.push_gain() < 0.2 * by_one.gains()[Kind.PUSHES]
    assert by_all.push_gain() > 0.7 * by_all.gains()[Kind.PUSHES] > 20.0


def test_what_is_far_off_in_one_push_alone_is_not_far_off_and_what_a_cause_explains_is_gone():
    accident, cause, healthy = (supported(CubeEvidence(TRACKER, _pushes(5, heavy)), NULL) for heavy in ((2,), range(5), ()))
    assert accident.misfit() == pytest.approx(healthy.misfit(), rel=0.05)
    assert accident.peaks()[Kind.PUSHES] <= healthy.peaks()[Kind.PUSHES]
    assert cause.misfit() > 5.0 * healthy.misfit() and cause.peaks()[Kind.PUSHES] > 2.0 * healthy.peaks()[Kind.PUSHES]
    assert cause.misfit("cube_mass") == pytest.approx(healthy.misfit(), rel=0.1)
    assert cause.peaks("cube_mass")[Kind.PUSHES] < healthy.peaks()[Kind.PUSHES]


def test_without_pushes_the_session_itself_is_asked():
    late = TrackerStatistics(500, 0.1, 0.13, 0.003, 1, 1, 0, 450, 0.0324, 0.001, 0.0115, 0.916)
    seen = supported(CubeEvidence(late, ()), NULL, without=("tracking_latency",))
    assert all(row.effect != "tracking_latency" for row in seen.ranking)
    assert max(seen.gains().values()) < 3.0 and seen.push_gain() < 3.0
    assert seen.peaks() == {Kind.TRACKER: pytest.approx(33.0, rel=0.1)}


def test_a_session_that_says_nothing_of_an_effect_is_left_as_it_is():
    seen = supported(CubeEvidence(TRACKER, _pushes(5, range(5))), NULL)
    silent = Supported(seen.ranking, seen.sessions, tuple({} for _ in seen.judged))
    assert silent.misfit("cube_mass") == seen.misfit() > seen.misfit("cube_mass")
    assert silent.peaks("cube_mass") == seen.peaks()
