"""Rungs are given up by what their trials say goal by goal, whenever somebody looks; equal ones seldom are."""

import time

import numpy as np
import pytest

from api_schemas.anytime import is_decided
from api_schemas.ladder import LadderEnds
from api_schemas.letters import pair_chance
from services.jobs.race import race, stages

KNOWN, HALVING = LadderEnds.KNOWN, LadderEnds.HALVING


def whole(rates, most, seed):
    """What every trial would say, shape (rungs, most)."""
    return np.random.default_rng(seed).random((len(rates), most)) < np.array(rates)[:, None]


def played(outcomes, most, ends, ahead=1):
    """A race that looks after each trial, by chance of any rung that goes on; gives the race and the trials that it took."""
    rng, ended = np.random.default_rng(0), [[] for _ in outcomes]
    while not (now := race(ended, [False] * len(ended), most, ends)).is_over:
        ready = [rung for rung in now.going if len(ended[rung]) < min(most, now.goals + ahead)]
        rung = int(rng.choice(ready))
        ended[rung].append(bool(outcomes[rung][len(ended[rung])]))
    return now, sum(map(len, ended))


@pytest.mark.parametrize("ends", [KNOWN, HALVING])
def test_the_answer_does_not_depend_on_when_it_is_looked_at(ends):
    outcomes = whole([0.2, 0.5, 0.9, 0.8], 40, 5)
    at_once = race(outcomes.tolist(), [False] * 4, 40, ends)
    one, few = played(outcomes, 40, ends)
    other, more = played(outcomes, 40, ends, ahead=4)
    assert one == other == at_once
    assert few <= more < 4 * 40


def test_halving_takes_the_trials_of_its_stages():
    outcomes = whole([0.1, 0.3, 0.5, 0.7, 0.2, 0.9, 0.4, 0.6], 40, 1)
    assert stages(8, 40) == (5, 10, 20)
    now, taken = played(outcomes, 40, HALVING)
    assert taken == 8 * 5 + 4 * 5 + 2 * 10 + 20
    assert sorted(each for each in now.given_up if each is not None) == [5, 5, 5, 5, 10, 10, 20]
    assert sum(each is None for each in now.given_up) == 1


def test_the_best_of_very_different_rungs_is_known_long_before_the_budget():
    now, taken = played(whole([0.05, 0.1, 0.95], 200, 3), 200, KNOWN)
    assert now.given_up[2] is None and None not in now.given_up[:2] and taken < 150


def test_equal_rungs_are_seldom_given_up():
    runs = 200
    wrong = sum(
        any(each is not None for each in race(whole([0.6] * 5, 40, 9000 + run).tolist(), [False] * 5, 40, KNOWN).given_up)
        for run in range(runs)
    )
    assert wrong / runs <= 0.05


def test_cancelled_rungs_hold_nobody_up_and_make_nobody_the_best():
    outcomes = [[True] * 10, [False], [True] * 3]
    now = race(outcomes, [False, True, True], 10, KNOWN)
    assert (now.goals, now.is_over, now.given_up) == (10, True, (None, None, None))
    assert race([[], []], [True, True], 10, KNOWN).is_over
    assert race([[]], [False], 10, HALVING).going == (0,)


def first_beaten(outcomes, most):
    """After how many goals each rung is first beaten by one that still goes on, with all pairs counted anew after each."""
    given_up, chance = [None] * len(outcomes), pair_chance(len(outcomes))
    for goals in range(1, most + 1):
        going = [rung for rung, at in enumerate(given_up) if at is None]
        if len(going) == 1:
            break
        for rung in going:
            changed = [(outcomes[other, :goals] > outcomes[rung, :goals]).sum() for other in going]
            lost = [(outcomes[other, :goals] < outcomes[rung, :goals]).sum() for other in going]
            if any(plus > minus and is_decided(int(plus), int(minus), chance) for plus, minus in zip(changed, lost, strict=True)):
                given_up[rung] = goals
    return tuple(given_up)


@pytest.mark.parametrize("seed", range(4))
def test_rungs_are_given_up_as_if_all_pairs_were_counted(seed):
    rates = np.random.default_rng(seed).random(8)
    outcomes = whole(rates, 60, 70 + seed)
    assert race(outcomes.tolist(), [False] * 8, 60, KNOWN).given_up == first_beaten(outcomes, 60)


@pytest.mark.parametrize(("rungs", "most"), [(100, 100), (10, 1000)])
def test_the_largest_races_are_looked_at_in_a_moment(rungs, most):
    """They are looked at after every event of their jobs, in a transaction of the dispatcher's."""
    outcomes = whole([0.5] * rungs, most, 2).tolist()
    began_s = time.process_time()
    race(outcomes, [False] * rungs, most, KNOWN)
    assert time.process_time() - began_s < 0.6
