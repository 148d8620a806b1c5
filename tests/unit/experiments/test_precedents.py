"""What power assumes is computed from the kept results of earlier experiments, and not typed."""

from dataclasses import replace

import pytest

from experiments.catalogue import CATALOGUE
from experiments.design import Experiment
from experiments.precedents import assumed, precedents
from experiments.store import Store
from tests import ROOT

RESULTS = ROOT / "results/experiments"


def store_of(experiment: Experiment) -> Store:
    return Store(RESULTS, RESULTS / "no-work", experiment)


@pytest.fixture(scope="module")
def before():
    return precedents(store_of)


def shown(before, letter, name):
    return [each for each in before if (each.experiment.letter, each.contrast.name) == (letter, name)]


def test_each_contrast_says_its_rate_its_changing_goals_and_how_trainings_spread(before):
    (nominal,) = shown(before, "b", "not randomised against randomised, nominal simulated robots")
    assert nominal.shown.first == pytest.approx(36 / 120) and nominal.shown.changing == pytest.approx(38 / 120)
    spread = ((0.125 + 0.05) ** 2 + (0.075 + 0.05) ** 2 + (0.35 - 0.05) ** 2) / 2
    assert nominal.shown.spread == pytest.approx((spread - 0.08**2) ** 0.5, abs=0.01), "without the chance of 40 trials each"
    (single,) = shown(before, "e", "all against all but joints")
    assert single.shown.spread is None


def test_trainings_of_which_too_few_succeed_on_the_farm_are_compared_at_their_end(before):
    on_the_farm, at_the_end = shown(before, "a", "rewarded by corners, seeing corners")
    assert on_the_farm.hidden and not at_the_end.hidden and at_the_end.physics == "nominal"
    assert at_the_end.shown.first == pytest.approx((0.13 + 0.01 + 0.29) / 3) and at_the_end.shown.changing is None
    assert at_the_end.shown.spread == pytest.approx(0.19, abs=0.01)


def test_what_is_asked_again_assumes_what_its_own_predecessor_shows(before):
    ablation = CATALOGUE["ablation-again"]
    found = assumed(ablation, ablation.contrasts[0], before)
    alike = [each.shown for each in before if each.experiment.letter == "e" and not each.contrast.loss]
    assert found.first == pytest.approx(sum(each.first for each in alike) / 4)
    assert found.changing == pytest.approx(sum(each.changing for each in alike) / 4)
    spreads = [each.shown.spread for each in before if each.shown.spread is not None and not each.hidden]
    assert found.spread == pytest.approx((sum(each**2 for each in spreads) / len(spreads)) ** 0.5)
    assert found.largest == max(spreads) and found.spread > 0.1, "more than was assumed at first"
    lift, push = (
        assumed(CATALOGUE["objects-again"], contrast, before) for contrast in CATALOGUE["objects-again"].contrasts[::11]
    )
    assert (lift.first, push.first) == (pytest.approx(0.8), pytest.approx(107 / 120)), "push as (d) tried the same policies"


def test_rates_on_other_robots_or_of_another_experiment_are_none_of_ours(before):
    observations = CATALOGUE["observations-again"]
    nominal, varied = (assumed(observations, observations.contrasts[at], before) for at in (0, 3))
    assert nominal.first == pytest.approx((0.21 + 0.43 / 3 + 0.06) / 3) and varied.first == pytest.approx(0.025)
    nothing = assumed(replace(observations, again="elsewhere"), observations.contrasts[0], before)
    assert nothing.first is None and nothing.changing == nominal.changing


def test_without_results_nothing_is_measured(tmp_path):
    before = precedents(lambda experiment: Store(tmp_path, tmp_path, experiment))
    again = CATALOGUE["ablation-again"]
    found = assumed(again, again.contrasts[0], before)
    assert not before and (found.first, found.changing, found.spread, found.largest) == (None,) * 4
