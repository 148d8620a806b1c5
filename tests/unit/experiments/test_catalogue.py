"""What the catalogue says of papers is answered by contrasts and cells that are there; what no paper claims is ours."""

import pytest

from experiments.catalogue import CATALOGUE


@pytest.mark.parametrize("experiment", CATALOGUE.values(), ids=CATALOGUE)
def test_every_claim_is_answered_by_what_is_there(experiment):
    there = {each.name for each in experiment.contrasts} | {cell.name for cell in experiment.cells}
    for claim in experiment.claims:
        assert claim.answers and set(claim.answers) <= there


@pytest.mark.parametrize("experiment", CATALOGUE.values(), ids=CATALOGUE)
def test_a_contrast_answers_a_claim_or_is_ours(experiment):
    answered = {name for claim in experiment.claims for name in claim.answers}
    for contrast in experiment.contrasts:
        assert contrast.ours or contrast.name in answered


def test_ours_are_what_no_paper_claims():
    ours = {each.name for experiment in CATALOGUE.values() for each in experiment.contrasts if each.ours}
    assert ours == {
        "not randomised against randomised, nominal simulated robots",
        "100 against 25",
        "corners in both against neither, varied robots",
        *(f"{cell.name}: nominal against varied simulated robots" for cell in CATALOGUE["consecutive"].cells),
        *(f"{task}-{name} against {task}-cube" for task in ("lift", "push") for name in ("cube-0.8", "octagonal-prism")),
    }


def test_the_samples_of_the_critic_alone_are_those_of_the_recipe():
    experiment = CATALOGUE["demonstrations"]
    training = experiment.cell("demonstrations-25").training
    assert training is not None
    ppo = training.recipe["ppo"]
    alone = training.recipe["demonstrations"]["critic_first"] * ppo["robots"] * ppo["steps"]
    assert f"{alone:,} samples" in experiment.limits


def test_what_repeats_another_experiment_is_marked():
    repeating = [each.name for experiment in CATALOGUE.values() for each in experiment.contrasts if each.repeats]
    assert repeating == ["all against none"]
