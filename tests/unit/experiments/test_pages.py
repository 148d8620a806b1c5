"""Pages and figures are made of results alone: the committed ones are what their JSON gives; nothing is claimed without."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.catalogue import CATALOGUE
from experiments.design import Claim
from experiments.figures import figure_of
from experiments.findings import findings
from experiments.judging import Verdict
from experiments.page import _passed_over, experiment_page, overview
from experiments.power import Design, power
from experiments.result_files import Key
from experiments.run import document, write
from experiments.store import Store
from tests import ROOT
from tests.cli_pages import SECTIONS, names_after
from tests.unit.experiments.small import SMALL, complete, rows, store_of, train

CLAIMING = replace(SMALL, claims=(Claim("better by far", "a paper", "83 %", ("other against first", "other")),))
PAGES = ROOT / "docs/experiments"
RESULTS = ROOT / "results/experiments"


def found_in(folder: Path) -> list:
    return [findings(each, Store(folder, folder / "no-work", each)) for each in CATALOGUE.values()]


@pytest.fixture(scope="module")
def committed() -> dict:
    """Findings by the name of their experiment, of what is committed; read when it is asked for, and not by every worker."""
    return dict(zip(CATALOGUE, found_in(RESULTS), strict=True))


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_committed_pages_are_what_the_committed_results_give(committed, name):
    found = committed[name]
    figure = PAGES / f"{name}.svg"
    assert (PAGES / f"{name}.md").read_text() == experiment_page(found, figure.exists())
    assert json.loads((RESULTS / f"{name}.json").read_text()) == json.loads(json.dumps(document(found)))
    assert figure.exists() == (figure_of(found) is not None) == figure.with_suffix(".png").exists()


def test_the_committed_overview_is_what_the_committed_results_give(committed):
    assert (PAGES / "README.md").read_text() == overview([*committed.values()])


def test_the_documented_keys_are_those_of_the_document(tmp_path):
    section = SECTIONS["experiment NAME"]
    assert names_after("JSON keys", section) == [*document(findings(SMALL, store_of(tmp_path))), "folder"]
    assert [name for name in CATALOGUE if f"`{name}`" not in section] == []


@pytest.mark.parametrize(("state", "passed_over"), [("complete", "first"), ("run in part", "again"), ("not run yet", "again")])
def test_of_two_that_ask_the_same_the_later_counts_once_all_of_it_is_there(state, passed_over):
    first = SimpleNamespace(experiment=replace(SMALL, name="first"), state="complete")
    again = SimpleNamespace(experiment=replace(SMALL, name="again", again="first"), state=state)
    assert _passed_over([first, again]) == {passed_over}


def test_without_results_everything_is_not_run_yet(tmp_path):
    nothing = found_in(tmp_path)
    text = overview(nothing)
    rows = [line for line in text.splitlines() if line.startswith("| ") and line.endswith("| not run yet |")]
    assert len(rows) == sum(len(each.claims) for each in CATALOGUE.values())
    assert sum(".md): not run yet |" in row for row in rows) == len(CATALOGUE)
    assert "0 reproduced, 0 not reproduced, 0 undecided" in text and "0 found, 0 not found, 0 undecided" in text
    for found in nothing:
        assert {each.verdict for each in found.judged} == {Verdict.NOT_RUN}
        assert figure_of(found) is None and not found.has_figure
        assert "**State: not run yet.**" in experiment_page(found, figure=False)


def test_complete_results_are_judged_and_shown(tmp_path):
    found = findings(CLAIMING, complete(tmp_path, first=1, other=4))
    assert found.state == "complete" and found.has_figure
    assert [each.verdict for each in found.judged] == [Verdict.REPRODUCED]
    text = overview([found])
    assert "![(x) A small one](small.svg)" in text
    row = next(line for line in text.splitlines() if "better by far" in line)
    assert "| 83 % | other against first: +0.60 (" in row and ": **reproduced**; `other`: real farm 80% (" in row
    page = experiment_page(found, figure=True)
    assert "- better by far: 83 % (a paper)" in page
    assert "| `first` | the first | 2 of 2 | 4 of 20: 20% (" in page
    assert "N = 20 pairs, 2 runs" in page and "reproduced |" in page


def test_the_overview_says_what_chance_alone_would_do_and_what_the_trainings_took(tmp_path):
    text = overview([findings(SMALL, complete(tmp_path))])
    assert "1 of them are gains: were there no difference in any, about 0.1 at most would still read as reproduced" in text
    assert "The 4 trainings that are kept took 0.0 hours" in text and "evaluations included" in text


def test_questions_of_ours_and_what_repeats_another_are_told_apart(tmp_path):
    contrasts = (
        *SMALL.contrasts,
        replace(SMALL.contrasts[0], name="of ours", ours=True),
        replace(SMALL.contrasts[0], name="once more", repeats="(b), seed 1"),
    )
    found = findings(replace(SMALL, contrasts=contrasts), complete(tmp_path))
    text = overview([found])
    assert "Of 1 contrasts that a paper claims: 1 reproduced" in text
    assert "Of 1 contrasts that no paper claims: 1 found" in text
    counted, _, not_counted = text.partition("Not counted:")
    assert "once more" not in counted and "repeats (b), seed 1, not counted again" in not_counted
    assert "| of ours (ours) |" in experiment_page(found, figure=True)


def test_what_is_not_run_and_does_not_count_is_told_from_nothing(tmp_path):
    whole = complete(tmp_path)
    assert "## Not run yet\n\nNothing.\n" in overview([findings(SMALL, whole)])
    again = findings(replace(SMALL, name="again", again="small"), store_of(tmp_path / "again"))
    assert "## Not run yet\n\nNothing that is counted; what is asked again" in overview([findings(SMALL, whole), again])


def test_one_run_speaks_of_its_policies_only(tmp_path):
    single = replace(SMALL, cells=tuple(replace(cell, seeds=(1,)) for cell in SMALL.cells))
    page = experiment_page(findings(single, complete(tmp_path)), figure=True)
    assert "N = 10 pairs, 1 run: these policies only" in page


def test_the_budget_says_what_the_trials_can_show():
    page = experiment_page(found_in(Path("/nowhere"))[1], figure=False)
    assert "Fixed before these runs:" in page and "how many goals end differently is assumed." in page
    assert "| trials | first cell | end differently | in truth | 0 | 0.1 | 0.2 |" in page
    lines = [line for line in page.splitlines() if line.startswith("| 3 runs of 40 pairs")]
    assert len(lines) == 4, "on varied robots and on nominal ones"
    for line, robots in zip(lines[::2], ("4 robots that differ", "robots alike"), strict=True):
        shown = [f"{power(Design(3, 40, 0.1, robots=4 * ('differ' in robots)), 0.1, spread):.0%}" for spread in (0.0, 0.1, 0.2)]
        assert line == f"| 3 runs of 40 pairs, {robots} | 50% | 30% | a gain of 0.1, that of interest | {' | '.join(shown)} |"


def test_what_is_asked_again_is_told_with_what_was_measured_before(committed):
    page = (PAGES / "ablation-again.md").read_text()
    measured = committed["ablation-again"].assumed["all against none"]
    assert f"| 0.1 | {measured.spread:.2f} (measured) | 0.2 | {measured.largest:.2f} (the largest measured) |" in page
    assert (
        f"| 4 runs of 160 pairs, 16 robots that differ | {measured.first:.0%} | {measured.changing:.0%} | a gain of 0.15" in page
    )
    assert "80% is there at spreads of" in page and "hours of two cores more" in page


def test_robots_are_told_of_each_farm():
    page = (PAGES / "observations-again.md").read_text()
    assert "on a farm of 4 robots, physics `nominal`, farm seed 9001 and on a farm of 16 robots, physics `real`" in page


def test_what_was_changed_since_stands_on_the_page_with_its_date():
    for each in (found.experiment for found in found_in(Path("/nowhere")) if found.experiment.again):
        page = (PAGES / f"{each.name}.md").read_text()
        assert each.since and all(f"- {said}" in page for said in each.since)
        assert all(re.match(r"\d+ November 2026[,:]", said) for said in each.since)


def test_a_page_says_what_does_not_count_and_that_another_version_begins_anew(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    train(store, SMALL.cells[0], 1)
    store.keep_block(key, 0, rows(0, 2), {"task": "push"}, {"code": "c" * 16})
    page = experiment_page(findings(SMALL, store), figure=False)
    assert "1 blocks of trials or measurements count as done while the code is that which made them (below)" in page
    store.versions.set_aside("trials", lambda _: {"code": "d" * 16})
    page = experiment_page(findings(SMALL, store), figure=False)
    assert "count as done while" not in page
    assert "- not counted any more, and kept in `results/experiments/small/set-aside`: 1 blocks of trials" in page


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


def test_a_page_says_what_made_the_results(tmp_path):
    store, real = complete(tmp_path), {"trifarm": "0.1.0", "code": "c" * 16, "physics real": "a" * 16}
    unknown = "8 blocks of trials, of an unknown version: they were kept before versions were"
    assert unknown in experiment_page(findings(SMALL, store), figure=True)
    assert document(findings(SMALL, store))["made_by"] == {"trials": {"known": {}, "parts": 8, "unknown": 8}}
    (store.folder / "trials" / "other-seed2-real.json").unlink()
    for block in range(2):
        store.keep_block(Key("other", 2, "real"), block, rows(block, 4), {"task": "push"}, real)
    page = experiment_page(findings(SMALL, store), figure=True)
    told = "trifarm 0.1.0, code cccccccccccccccc, physics real aaaaaaaaaaaaaaaa"
    assert f"8 blocks of trials: 2 by {told}; 6 of an unknown version, kept before versions were" in page
    assert "whether both are of one version cannot be told" in page


def test_what_is_written_is_page_json_and_figure_in_two_forms(tmp_path):
    store = complete(tmp_path)
    written = write(findings(SMALL, store), store)
    assert [path.name for path in written] == ["small.svg", "small.png", "small.json", "small.md"]
    assert all(path.stat().st_size > 0 for path in written)
    quick = replace(findings(SMALL, store), experiment=replace(SMALL, quick=True))
    assert "The quick form" in experiment_page(quick, figure=True)
