"""Pages and figures are made of results alone: the committed ones are what their JSON gives; nothing is claimed without."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.catalogue import CATALOGUE
from experiments.figures import figure_of
from experiments.findings import findings
from experiments.judging import Verdict
from experiments.page import experiment_page, overview
from experiments.run import document, write
from experiments.store import Key, Store
from tests.unit.experiments.small import SMALL, complete, store_of, train

PAGES = Path(__file__).parents[3] / "docs" / "experiments"


def found_in(folder: Path) -> list:
    return [findings(each, Store(folder, folder / "no-work", each)) for each in CATALOGUE.values()]


@pytest.mark.parametrize("found", found_in(PAGES), ids=CATALOGUE)
def test_the_committed_pages_are_what_the_committed_results_give(found):
    name = found.experiment.name
    figure = PAGES / f"{name}.svg"
    assert (PAGES / f"{name}.md").read_text() == experiment_page(found, figure.exists())
    assert json.loads((PAGES / f"{name}.json").read_text()) == json.loads(json.dumps(document(found)))
    assert figure.exists() == (figure_of(found) is not None) == figure.with_suffix(".png").exists()


def test_the_committed_overview_is_what_the_committed_results_give():
    assert (PAGES / "README.md").read_text() == overview(found_in(PAGES))


def test_the_documented_keys_are_those_of_the_document(tmp_path):
    section = (PAGES.parent / "cli.md").read_text().partition("### `trifarm experiment NAME`")[2]
    documented = re.search(r"^JSON keys: (.*?)\n\n", section, re.MULTILINE | re.DOTALL)[1]
    assert re.findall(r"`([^`]+)`", documented) == [*document(findings(SMALL, store_of(tmp_path))), "folder"]
    assert [name for name in CATALOGUE if f"`{name}`" not in section] == []


def test_without_results_everything_is_not_run_yet(tmp_path):
    text = overview(found_in(tmp_path))
    rows = [line for line in text.splitlines() if line.startswith("| ") and ".md)" in line]
    assert len(rows) == 7 and all(row.endswith("| not run yet |") for row in rows)
    assert "0 reproduced, 0 not reproduced, 0 undecided" in text
    for found in found_in(tmp_path):
        assert {each.verdict for each in found.judged} == {Verdict.NOT_RUN}
        assert figure_of(found) is None and not found.has_figure
        assert "**State: not run yet.**" in experiment_page(found, figure=False)


def test_complete_results_are_judged_and_shown(tmp_path):
    store = complete(tmp_path, first=1, other=4)
    found = findings(SMALL, store)
    assert found.state == "complete" and found.has_figure
    text = overview([found])
    assert "![(x) A small one](small.svg)" in text
    assert "of 1 contrasts 1 reproduced; other against first: +0.60 (" in text
    assert [each.verdict for each in found.judged] == [Verdict.REPRODUCED]
    page = experiment_page(found, figure=True)
    assert "| `first` | the first | 2 of 2 | 4 of 20: 20% (11% to 34%) |" in page
    assert "+0.60" in page and "N = 20, 2 runs" in page and "reproduced |" in page


@pytest.mark.parametrize(
    ("first", "other", "expected"), [(4, 1, Verdict.NOT_REPRODUCED), (2, 2, Verdict.NOT_REPRODUCED), (2, 3, Verdict.REPRODUCED)]
)
def test_other_results_lead_to_other_verdicts(tmp_path, first, other, expected):
    assert findings(SMALL, complete(tmp_path, first, other)).judged[0].verdict is expected


def test_a_contrast_waits_for_all_blocks_of_all_seeds(tmp_path):
    store = complete(tmp_path)
    (store.folder / "trials" / "other-seed2-real.json").unlink()
    found = findings(SMALL, store)
    assert found.state == "run in part"
    assert found.judged[0].verdict is Verdict.NOT_RUN
    assert "pieces of work are done; what is missing takes" in experiment_page(found, figure=True)


def labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def test_the_figure_has_labelled_axes_with_units_and_says_how_many(tmp_path):
    figure = figure_of(findings(SMALL, complete(tmp_path)))
    curves, bars = figure.axes
    assert labels(curves) == ("samples, millions", "success on nominal robots, %")
    assert labels(bars) == ("cell (N = trials)", "success rate on the farm, %")
    assert [text.get_text() for text in curves.get_legend().get_texts()] == ["first (N = 2 runs)", "other (N = 2 runs)"]
    assert [text.get_text() for text in bars.get_xticklabels()] == ["first\nN = 20", "other\nN = 20"]
    heights = [patch.get_height() for patch in bars.patches]
    assert heights == pytest.approx([20.0, 80.0])
    assert "80 % intervals" in bars.get_title()
    assert "64 goals a point" in curves.get_title()


def test_figures_of_goals_in_a_row_and_of_what_is_known(tmp_path):
    many = CATALOGUE["consecutive"]
    store = store_of(tmp_path, many)
    for physics, reached in (("nominal", [50, 12, 3]), ("real", [7, 1, 0])):
        kept = {"reached": reached, "ended": ["time"] * 3}
        store.keep_measured(Key("push", 1, physics), kept)
    found = findings(many, store)
    (axes,) = figure_of(found).axes
    assert labels(axes) == ("trial, sorted by goals", "goals in a row (at most 50)")
    assert "push, nominal: mean 21.7, median 12, N = 3" in [text.get_text() for text in axes.get_legend().get_texts()]
    assert found.judged[0].found is not None
    assert "| `push` | nominal | 21.7 ± 24.9 | 12 | 50 12 3 | time 3 |" in experiment_page(found, figure=True)

    memory = CATALOGUE["memory"]
    store = store_of(tmp_path, memory)
    known = {"at_s": 5.0, "of_state": 0.5, "of_observation": 0.1, "difference": 0.4, "low": 0.3, "high": 0.5, "robots": 300}
    for seed in (1, 2, 3):
        store.keep_measured(Key("lstm", seed, "real"), {"parameters": {name: [known] for name in memory.hidden.parameters}})
    found = findings(memory, store)
    (axes,) = figure_of(found).axes
    assert axes.get_ylabel() == "held-out R² after 5 s (1 = known)"
    assert "N = 300 robots, 3 runs" in axes.get_xlabel()
    by_name = {each.contrast.name: each.verdict for each in found.judged}
    assert by_name["cube size, known beyond what is seen"] is Verdict.REPRODUCED
    assert by_name["memory against none, real robots"] is Verdict.NOT_RUN


def test_demonstrations_that_save_samples(tmp_path):
    experiment = CATALOGUE["demonstrations"]
    store = store_of(tmp_path, experiment)
    for cell, rates in zip(experiment.cells, ((0.1, 0.2, 0.3, 0.9), (0.1, 0.85, 0.9, 0.9), (0.9, 0.9, 0.9, 0.9)), strict=True):
        for seed in cell.seeds:
            train(store, cell, seed, samples=1200, rates=rates)
    found = findings(experiment, store)
    assert [each.found.estimate for each in found.judged] == [1.0, 2.0, 1.0]
    assert all(each.verdict is Verdict.REPRODUCED for each in found.judged)


def test_what_is_written_is_page_json_and_figure_in_two_forms(tmp_path):
    store = complete(tmp_path)
    written = write(findings(SMALL, store), store)
    assert [path.name for path in written] == ["small.svg", "small.png", "small.json", "small.md"]
    assert all(path.stat().st_size > 0 for path in written)
    quick = replace(findings(SMALL, store), experiment=replace(SMALL, quick=True))
    assert "The quick form" in experiment_page(quick, figure=True)
