"""Two checkouts in turns: the order, what counts of what was kept, and that a checkout's code is its own."""

import json

import pytest

from tests import ROOT
from tests.benchmarks import against
from tests.benchmarks.against import MeasurementError, main, measured, plan, spread, table


def row(index, side, cpu, wall=1.0, part="bare", name="held"):
    return {"round": index, "part": part, "side": side, "us": {name: {"cpu": cpu, "wall": wall}}}


def test_the_order_turns_with_each_round():
    order = [(index, side) for index, _, side in plan(3, ["bare"])]
    assert order == [(0, "old"), (0, "new"), (1, "new"), (1, "old"), (2, "old"), (2, "new")]
    assert [part for _, part, _ in plan(1, ["bare", "real"])] == ["bare", "bare", "real", "real"]


def test_a_ratio_is_of_medians_and_its_quartiles_of_rounds():
    rows = [
        row(index, side, cpu)
        for index, pair in enumerate([(10, 5), (30, 10), (20, 20)])
        for side, cpu in zip(("old", "new"), pair, strict=True)
    ]
    found = spread(rows)["bare held"]
    assert found["rounds"] == 3
    assert (found["cpu"]["old_us"], found["cpu"]["new_us"], found["cpu"]["ratio"]) == (20, 10, 2.0)
    assert found["cpu"]["quartiles"] == [1.5, 2.5], "of 2, 3 and 1"
    assert found["wall"]["ratio"] == 1.0


def test_a_round_with_one_side_counts_not_yet():
    rows = [row(0, "old", 10), row(0, "new", 5), row(1, "old", 1000)]
    assert spread(rows)["bare held"]["rounds"] == 1
    assert spread(rows[2:]) == {}


def test_the_table_has_a_line_for_each_figure():
    lines = table(spread([row(0, "old", 30.0), row(0, "new", 20.0)])).splitlines()
    assert len(lines) == 2
    assert lines[1].split() == ["bare", "step,", "fingers", "held", "1", "30.00", "20.00", "1.50", "1.50", "1.50", "1.00"]


@pytest.fixture
def told(monkeypatch):
    """What would have been measured, in its order; measurements themselves are left out."""
    asked = []

    def pretend(checkout, part, core, **settings):
        asked.append((part, "new" if checkout == ROOT else "old", settings["seed"]))
        return {"held": {"cpu": 2.0, "wall": 2.0}}

    monkeypatch.setattr(against, "measured", pretend)
    return asked


def test_it_goes_on_where_it_was_stopped(told, tmp_path):
    out, run = tmp_path / "rounds.jsonl", [str(tmp_path), "--parts", "bare", "--core", "0"]
    main([*run, "--rounds", "2", "--out", str(out)])
    whole = out.read_text().splitlines()
    out.write_text("\n".join(whole[:3]) + "\n")
    told.clear()
    main([*run, "--rounds", "2", "--out", str(out)])
    assert told == [("bare", "new", 501), ("bare", "old", 501)]
    assert out.read_text().splitlines() == whole


def test_rounds_of_other_checkouts_are_not_mixed_with_these(told, tmp_path):
    out = tmp_path / "rounds.jsonl"
    out.write_text(json.dumps({"old": "1234567"}) + "\n")
    with pytest.raises(SystemExit, match="begun with old 1234567"):
        main([str(tmp_path), "--out", str(out)])
    assert told == []


def test_a_folder_without_the_code_gives_no_figure(tmp_path):
    with pytest.raises(MeasurementError, match="gave no figure for 'recipe'"):
        measured(tmp_path, "recipe", 0)
