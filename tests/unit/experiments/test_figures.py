"""Figures say what they show: axes with units, task and farm, how many, and nothing cut off."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.catalogue import CATALOGUE
from experiments.design import Farm, FarmTrials
from experiments.figures import COLOURS, figure_of
from experiments.findings import findings
from experiments.result_files import Key
from tests.unit.experiments.small import SMALL, TRIALS, complete, rows, store_of, train


def panels(found):
    figure = figure_of(found)
    assert figure is not None
    return figure.axes


def labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def texts(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_figure_has_labelled_axes_with_units_and_says_of_what_and_how_many(tmp_path):
    curves, bars = panels(findings(SMALL, complete(tmp_path)))
    assert labels(curves) == ("samples, millions", "success on nominal simulated robots, %")
    assert texts(curves) == ["first (2 runs)", "other (2 runs)"]
    assert "push, 64 goals a point" in curves.get_title(loc="left")
    assert bars.get_ylabel() == "success rate on the farm, %"
    assert [text.get_text() for text in bars.get_xticklabels()] == ["first", "other"]
    assert [patch.get_extents().height / bars.bbox.height for patch in bars.patches] == pytest.approx([20 / 104, 80 / 104])
    assert "push, 4 varied simulated robots; N = 20 a bar (2 runs × 10 goals)" in bars.get_title(loc="left")
    assert "80 % intervals" in bars.get_title(loc="left")
    assert bars.get_legend() is None, "one kind of robots needs none"


@pytest.mark.parametrize(("samples", "curves"), [(4100, ["first", "other"]), (5000, ["other"])])
def test_a_run_that_was_resumed_is_evaluated_some_samples_later_and_still_in_the_curve(tmp_path, samples, curves):
    store = complete(tmp_path)
    train(store, SMALL.cells[0], 2, samples=samples, rates=(0.0, 0.4, 0.5))
    found = {curve.cell: curve for curve in findings(SMALL, store).curves}
    assert list(found) == curves
    if "first" in found:
        np.testing.assert_allclose(found["first"].success, [[0.2, 0.6, 0.9], [0.0, 0.4, 0.5]])
        np.testing.assert_allclose(found["first"].samples, [1365.5, 2731.5, 4098.0])


def test_what_is_at_100_per_cent_is_whole_and_equal_runs_lie_beside_each_other(tmp_path):
    _, bars = panels(findings(SMALL, complete(tmp_path, first=5, other=5)))
    assert bars.get_ylim()[1] > 100
    dots = [line for line in bars.lines if line.get_marker() == "o"]
    assert len(dots) == 2 and not any(line.get_clip_on() for line in dots)
    assert all(len(np.unique(line.get_xdata())) == 2 for line in dots)


def test_whiskers_hold_the_interval_of_runs_that_differ(tmp_path):
    store = complete(tmp_path)
    for block in range(TRIALS.blocks):
        store.keep_block(Key("first", 2, "real"), block, rows(block, 5), {"task": "push"})
    found = findings(SMALL, store)
    rate = next(each for each in found.rates if each.cell == "first")
    assert rate.of_runs == (0.2, 1.0) and rate.interval == (0.0, 1.0)


def test_cells_of_other_sizes_say_their_own_n_and_two_kinds_have_a_legend(tmp_path):
    both = replace(SMALL, trials=FarmTrials("push", farms=(Farm("nominal"), Farm("real")), blocks=1, block=5, seed=100))
    store = store_of(tmp_path, both)
    for cell, seed in (("first", 1), ("first", 2), ("other", 1)):
        for physics in ("nominal", "real"):
            store.keep_block(Key(cell, seed, physics), 0, rows(0, 3), {"task": "push"})
    (bars,) = panels(findings(both, store))
    assert [text.get_text() for text in bars.get_xticklabels()] == ["first\nN = 10", "other\nN = 5"]
    assert texts(bars) == ["on nominal simulated robots", "on varied simulated robots"]


def test_goals_in_a_row_have_a_small_panel_for_each_policy(tmp_path):
    many = CATALOGUE["consecutive"]
    store = store_of(tmp_path, many)
    for cell in ("push", "lift"):
        for physics, reached in (("nominal", [50, 12, 3]), ("real", [7, 1, 0])):
            store.keep_measured(Key(cell, 1, physics), {"reached": reached, "ended": ["time"] * 3})
    push, lift = panels(findings(many, store))
    assert labels(push) == ("trial, sorted by goals (N = 3)", "goals in a row, at most 50")
    assert push.get_title(loc="left").splitlines() == [
        "push, shipped",
        "nominal: median 12, mean 21.7",
        "varied: median 1, mean 2.7",
    ]
    assert [line.get_linestyle() for line in lift.lines] == ["-", "--"]


def test_what_is_known_shows_each_run_beside_the_others(tmp_path):
    memory = CATALOGUE["memory"]
    assert memory.hidden is not None
    store = store_of(tmp_path, memory)
    known = {"at_s": 5.0, "of_state": 0.5, "of_observation": 0.1, "difference": 0.4, "low": 0.3, "high": 0.5, "robots": 300}
    for seed in (1, 2, 3):
        store.keep_measured(Key("lstm", seed, "real"), {"parameters": {name: [known] for name in memory.hidden.parameters}})
    (axes,) = panels(findings(memory, store))
    assert axes.get_ylabel() == "held-out R² (0 = nothing, 1 = known)"
    assert "after 5 s; N = 300 robots" in axes.get_title(loc="left") and "3 runs" in axes.get_title(loc="left")
    diamonds = [np.asarray(line.get_xdata())[0] for line in axes.lines if line.get_marker() == "D"]
    assert len(diamonds) == 9 == len(set(diamonds))


@pytest.mark.parametrize(("reaches", "percent"), [(0.8, 80), (0.85, 85)])
def test_the_curves_of_demonstrations_begin_with_them_and_ring_the_first_that_reach_the_rate(tmp_path, reaches, percent):
    experiment = replace(CATALOGUE["demonstrations"], reaches=reaches)
    store = store_of(tmp_path, experiment)
    for cell, rates in zip(experiment.cells, ((0.1, 0.2, 0.9), (0.1, 0.85, 0.9), (0.9, 0.9, 0.9)), strict=True):
        for seed in cell.seeds:
            train(store, cell, seed, samples=1_200_000, rates=rates)
    (axes,) = panels(findings(experiment, store))
    assert axes.get_xlabel() == "samples, demonstrations counted, millions"
    rings = [np.asarray(line.get_xdata())[0] for line in axes.lines if line.get_marker() == "o"]
    assert sorted(set(np.round(rings, 3))) == [0.475, 0.819, 1.2]  # 100 demonstrations of 750 control periods and 0.4 million, …
    assert any(np.array_equal(line.get_ydata(), [percent, percent]) for line in axes.lines)
    assert f"ring: first at {percent} %" in axes.get_title(loc="left")


def test_colours_say_what_is_seen_and_dashes_what_is_rewarded(tmp_path):
    experiment = CATALOGUE["observations"]
    store = store_of(tmp_path, experiment)
    for cell in experiment.cells:
        for seed in cell.seeds:
            train(store, cell, seed)
    (axes,) = panels(findings(experiment, store))
    drawn = {(line.get_color(), line.get_linestyle()) for line in axes.lines}
    assert drawn == {(COLOURS[seen], style) for seen in (0, 1) for style in ("-", "--")}
    assert "sees corners, rewarded by corners (3 runs)" in texts(axes)


def test_cells_are_named_in_words():
    for experiment in CATALOGUE.values():
        for cell in experiment.cells:
            assert cell.label and "`" not in cell.label
