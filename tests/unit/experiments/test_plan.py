"""Budgets are what the issue allows, every recipe holds, and what is missing is what has no result."""

import tomllib
from contextlib import closing
from dataclasses import replace

import pytest

import trifarm
from experiments.catalogue import CATALOGUE, HOURS_AGAIN, HOURS_ALLOWED
from experiments.catalogue.robots import GROUPS
from experiments.design import START_SEEDS, Measure
from experiments.findings import findings
from experiments.fixed import design_of
from experiments.plan import BlockPiece, MeasuringPiece, TrainingPiece, Wanted, hours, missing, pieces, starts
from experiments.power import SPREAD, power, power_of_arrivals
from experiments.quick_form import quick_form
from experiments.recipe_files import REAL, reduced_real, start_document, start_name, toml_of, write_recipe
from experiments.result_files import Key
from experiments.store import Store
from sim_backend.effects.ranges import load_ranges
from sim_backend.training.recipe import load_recipe
from tests import ROOT
from tests.unit.experiments.small import SMALL, TRIALS, rows, store_of, train

TRAINED = [(each, cell) for each in CATALOGUE.values() for cell in each.cells if cell.training is not None]

QUICK = [cell for each in CATALOGUE.values() for cell in quick_form(each).cells if cell.training is not None]
ALL_TRAINED = [*(cell for _, cell in TRAINED), *QUICK]


def test_all_are_there_and_fit_into_the_hours():
    assert [each.letter for each in CATALOGUE.values()] == [*"abcdefg", "a2", "c2", "e2", "g2"]
    first, again = ([each for each in CATALOGUE.values() if bool(each.again) is later] for later in (False, True))
    assert hours([piece for each in first for piece in pieces(each)], 2) <= HOURS_ALLOWED
    assert hours([piece for each in again for piece in pieces(each)], 2) <= HOURS_AGAIN


def test_what_is_asked_again_is_decided_by_the_same_rule_with_the_power_that_was_wanted():
    """By the whole rule, with the rates that were measured, where trainings spread as was assumed; questions of ours need not."""
    results = ROOT / "results" / "experiments"
    for later in (each for each in CATALOGUE.values() if each.again):
        earlier = CATALOGUE[later.again]
        assert [each.name for each in later.contrasts][: len(earlier.contrasts)] == [each.name for each in earlier.contrasts]
        found = findings(later, Store(results, results / "no-work", later))
        for contrast in (each for each in later.contrasts if not each.ours):
            runs = len(later.cell(contrast.other).seeds)
            if contrast.measure is Measure.SAMPLES_TO:
                assert power_of_arrivals(runs, contrast.interest, contrast.interest) >= 0.8
                continue
            design = design_of(later, contrast, found.assumed[contrast.name])
            assert power(design, design.of_interest, SPREAD if runs > 1 else 0.0) >= 0.8


def test_runs_of_other_seeds_begin_with_trainings_of_their_own():
    begun = starts(pieces(CATALOGUE["ablation-again"]))
    assert [start_document(start)["seed"] for start in begun] == [START_SEEDS + seed for seed in (1, 2, 3, 4)]
    assert len({start_name(start) for start in begun}) == 4
    one = CATALOGUE["randomization"]
    assert [start.seed for start in starts(pieces(one))] == [1]


def test_no_run_practises_the_goals_of_its_start():
    """As the training draws them on nominal robots, where nothing else is drawn: also of runs that were resumed."""
    practice = trifarm.practice_of("push")

    def goals(seed):
        with closing(trifarm.TrifingerVecEnv(practice, robots=4, threads=1, seed=seed)) as robots:
            robots.reset()
            return robots.environment._draw_seeds(4).tolist()

    assert goals(1) == goals(1)
    for start in starts(pieces(CATALOGUE["ablation-again"])):
        resumed = {seed + 1_000_003 * times for seed in (1, 2, 3, 4) for times in range(1000)}
        assert start.seed not in resumed
        assert not set(goals(start.seed)) & {goal for seed in (1, 2, 3, 4) for goal in goals(seed)}


def test_samples_and_seeds_are_those_of_the_issue():
    for experiment, cell in (pair for pair in TRAINED if not pair[0].again):
        if experiment.letter == "a":
            assert cell.training.samples == 8_000_000
        else:
            assert cell.training.samples <= 4_000_000
        assert len(cell.seeds) == (1 if experiment.letter == "e" else 3)
    tried = {each.letter: each.trials.trials for each in CATALOGUE.values() if each.trials is not None and not each.again}
    assert tried == {"a": 40, "b": 40, "d": 40, "e": 120, "g": 40}, "one run a cell of (e), three of the others"
    assert CATALOGUE["consecutive"].many_goals.goals == 50
    assert CATALOGUE["consecutive"].many_goals.limit_s == 80.0


@pytest.mark.parametrize("experiment", CATALOGUE.values(), ids=CATALOGUE)
@pytest.mark.parametrize("how", ["full", "quick"])
def test_contrasts_are_of_cells_and_farms_that_are_there(experiment, how):
    chosen = quick_form(experiment) if how == "quick" else experiment
    assert len({cell.name for cell in chosen.cells}) == len(chosen.cells)
    for contrast in chosen.contrasts:
        assert chosen.cell(contrast.first).seeds == chosen.cell(contrast.other).seeds
        if contrast.measure is Measure.SUCCESS:
            kinds = {farm.physics for farm in chosen.trials.farms}
            assert contrast.farm in kinds or chosen.quick
    if chosen.quick:
        assert hours(pieces(chosen), 2) < 0.05


@pytest.mark.parametrize("experiment", CATALOGUE.values(), ids=CATALOGUE)
def test_a_quick_form_has_all_that_it_tries(experiment, tmp_path):
    chosen = quick_form(experiment)
    store = Store(tmp_path / "out", tmp_path / "work", chosen)
    planned = {piece.cell.name for piece in missing(chosen, store, Wanted()) if isinstance(piece, TrainingPiece)}
    assert planned == {cell.name for cell in chosen.cells if cell.policy is None}


@pytest.mark.parametrize("chosen", ALL_TRAINED, ids=lambda cell: f"{cell.name}-{cell.training.samples}")
def test_every_recipe_is_one_that_the_training_takes(chosen, tmp_path):
    shown = tmp_path / "shown" if chosen.training.demonstrations else None
    name, recipe = load_recipe(str(write_recipe(chosen.training, 3, tmp_path, "c-seed3", shown)))
    assert (name, recipe.seed, recipe.samples) == ("c-seed3", 3, chosen.training.samples)
    if chosen.training.without:
        kept = {row.key.partition(".")[0] for row in load_ranges(recipe.physics_source).rows}
        assert kept and not kept & set(chosen.training.without)


def test_groups_hold_every_effect_of_real_once():
    in_groups = [name for group in GROUPS.values() for name in group]
    in_real = {row["key"].partition(".")[0] for row in tomllib.loads(REAL.read_text())["range"]}
    assert sorted(in_groups) == sorted(in_real)
    with pytest.raises(ValueError, match="no ranges of gravity"):
        reduced_real(("gravity",))


def test_toml_is_read_back_as_it_was():
    document = tomllib.loads(REAL.read_text())
    assert tomllib.loads(toml_of(document)) == document
    nested = {"a": 'say "so"\\', "b": [1, 2.5], "c": {"d": True, "e": {"f": "g"}}, "rows": [{"x": 1}, {"x": 2}]}
    assert tomllib.loads(toml_of(nested)) == nested


def test_what_is_missing_shrinks_as_results_come(tmp_path):
    store = store_of(tmp_path)
    assert len(missing(SMALL, store)) == 4 + 4 * TRIALS.blocks
    train(store, SMALL.cells[0], 2)
    store.keep_block(Key("first", 2, "real"), 1, rows(1, 3), {})
    left = missing(SMALL, store)
    assert len(left) == 3 + 7
    assert not [p for p in left if isinstance(p, TrainingPiece) and (p.cell.name, p.seed) == ("first", 2)]
    assert [p.block for p in left if isinstance(p, BlockPiece) and (p.cell.name, p.seed) == ("first", 2)] == [0]


OLD, NEW = {"code": "c" * 16}, {"code": "d" * 16}


def test_blocks_of_another_version_count_as_missing_until_all_are_there(tmp_path):
    store = store_of(tmp_path)
    for cell in SMALL.cells:
        for seed in cell.seeds:
            train(store, cell, seed)
            store.keep_block(Key(cell.name, seed, "real"), 0, rows(0, 3), {}, OLD)
    of_old, of_new = (missing(SMALL, store, now=lambda _, made=made: made) for made in (OLD, NEW))
    assert {piece.block for piece in of_old} == {1} and len(of_old) == 4
    assert {piece.block for piece in of_new} == {0, 1} and len(of_new) == 8
    assert len(missing(SMALL, store, Wanted("first"), lambda _: NEW)) == 4
    for cell in SMALL.cells:
        for seed in cell.seeds:
            store.keep_block(Key(cell.name, seed, "real"), 1, rows(1, 3), {}, OLD)
    assert missing(SMALL, store, now=lambda _: NEW) == [], "what is whole stays, whatever the version"


def test_one_cell_or_seed_alone(tmp_path):
    store = store_of(tmp_path)
    asked = missing(SMALL, store, Wanted("other", 2))
    assert {(piece.cell.name, piece.seed) for piece in asked} == {("other", 2)}
    assert {piece.seed for piece in missing(SMALL, store, Wanted(seed=1))} == {1}


def test_blocks_of_all_cells_take_turns():
    order = [(piece.block, piece.cell.name, piece.seed) for piece in pieces(SMALL) if isinstance(piece, BlockPiece)]
    assert order == sorted(order)


def test_the_ablation_takes_runs_of_the_randomization(tmp_path):
    randomization, ablation = CATALOGUE["randomization"], CATALOGUE["ablation"]
    train(store_of(tmp_path, randomization), randomization.cell("randomized"), 1)
    store = store_of(tmp_path, ablation)
    assert store.run(ablation.cell("all"), 1) is not None
    assert store.run(ablation.cell("none"), 1) is None
    assert store.weights(ablation.cell("all"), 1).name == "randomized-seed1.safetensors"
    assert "all" not in {piece.cell.name for piece in pieces(ablation) if isinstance(piece, TrainingPiece)}


def test_measurements_are_planned_for_each_kind_of_robot():
    found = [piece for piece in pieces(CATALOGUE["consecutive"]) if isinstance(piece, MeasuringPiece)]
    assert {piece.physics for piece in found} == {"nominal", "real"}
    asked = [piece for piece in pieces(CATALOGUE["memory"]) if isinstance(piece, MeasuringPiece)]
    assert {piece.cell.name for piece in asked} == {"lstm"}
    assert len(asked) == 3
    assert replace(SMALL, quick=True).quick
