"""A sitting: where it works, what it leaves, what it lists, and whom it lets in."""

import json
import re
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from experiments import run as running
from experiments.__main__ import main
from experiments.catalogue import CATALOGUE
from experiments.plan import Wanted
from experiments.result_files import Key
from experiments.run import Settings, run
from sim_backend.folder_lock import taken
from tests.unit.experiments.small import SMALL, rows, store_of, train

ROOT = Path(__file__).parents[3]
SETTINGS = Settings(Wanted(), 1, lambda: True, lambda _: None)


@pytest.fixture
def lists(capsys, tmp_path):
    """What the program prints as JSON, and on stderr."""

    def call(*flags, code=0):
        assert main([*flags, "--list", "--json"]) == code
        said = capsys.readouterr()
        return json.loads(said.out) if code == 0 else None, said.err

    return call


def test_a_list_is_of_what_is_asked_for(lists, tmp_path):
    out = ("--out", str(tmp_path))
    whole, _ = lists("memory", *out)
    assert len(whole["pieces"]) == 33
    part, _ = lists("memory", *out, "--only", "lstm", "--seed", "2")
    assert len(part["pieces"]) == 6
    assert all("lstm, seed 2" in each["piece"] for each in part["pieces"])
    assert 0 < part["hours_left"] < whole["hours_left"]


def test_a_cell_that_is_not_there_is_refused_with_those_that_are(tmp_path, capsys):
    assert main(["randomization", "--quick", "--json", "--out", str(tmp_path), "--only", "nothing"]) == 2
    assert "choose from nominal, randomized" in capsys.readouterr().err


def test_without_a_name_all_are_listed(lists, capsys, tmp_path):
    found, _ = lists("--out", str(tmp_path))
    assert [each["experiment"] for each in found["experiments"]] == list(CATALOGUE)
    assert main(["--list", "--out", str(tmp_path)]) == 0
    assert "memory: 0 of 33 pieces of work are done; what is missing takes about" in capsys.readouterr().out
    assert main(["--out", str(tmp_path)]) == 2
    assert "say which experiment: observations, " in capsys.readouterr().err


def test_a_result_of_another_recipe_is_said_in_the_list_of_all_and_refused_alone(lists, tmp_path):
    store = store_of(tmp_path, CATALOGUE["memory"])
    train(store, CATALOGUE["memory"].cell("lstm"), 1)
    path = store.folder / "runs" / "lstm-seed1.json"
    path.write_text(path.read_text().replace('"truth"', '"robot"'))
    found, _ = lists("--out", str(store.out))
    refused = {each["experiment"]: each["refused"] for each in found["experiments"] if "refused" in each}
    assert list(refused) == ["memory"] and "teacher.view was 'robot' and is 'truth'" in refused["memory"]
    _, said = lists("memory", "--out", str(store.out), code=1)
    assert "teacher.view was 'robot' and is 'truth'; move lstm-seed1*" in said


def test_results_are_those_of_the_clone_wherever_the_user_is(lists, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, said = lists("memory")
    assert f"results in {ROOT / 'results' / 'experiments'}, checkpoints in {ROOT / 'build' / 'experiments'}" in said


def test_the_list_of_a_quick_form_leaves_nothing(lists, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    found, _ = lists("memory", "--quick")
    assert found["quick"] and not any(each["done"] for each in found["pieces"])
    assert list(tmp_path.iterdir()) == []


def test_a_quick_form_says_by_what_it_goes_on(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["objects", "--quick", "--budget-minutes", "0"]) == 0
    (made,) = tmp_path.iterdir()
    said = capsys.readouterr().err
    assert f"with --out {made} the same command goes on" in said
    assert f"results go to {made}, checkpoints to {made / 'work'}" in said


def test_a_second_sitting_on_one_folder_ends_at_once_and_says_who_is_there(capsys, tmp_path):
    flags = ["--out", str(tmp_path / "out"), "--work", str(tmp_path / "work"), "--budget-minutes", "0"]
    with taken(tmp_path / "work" / "memory", "experiment memory", ""):
        assert main(["memory", *flags]) == 2
        assert re.search(r"experiment memory is under way in .*: process \d+", capsys.readouterr().err)
        assert main(["objects", *flags]) == 0, "another experiment may work beside it"
    assert main(["memory", *flags]) == 0


def test_a_farms_folder_is_in_the_work_folder_and_gone_afterwards(tmp_path, monkeypatch):
    store, seen = store_of(tmp_path), []
    for cell in SMALL.cells:
        for seed in cell.seeds:
            train(store, cell, seed)

    @contextmanager
    def farm(_farm, folder):
        seen.append(folder)
        (folder / "large").write_text("log")
        yield None

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "own_farm", farm)
    monkeypatch.setattr("experiments.farm_trials._run_block", stopped)
    with pytest.raises(KeyboardInterrupt):
        run(SMALL, store, SETTINGS)
    assert seen[0].is_relative_to(store.work) and not store.farm_folder.exists()
    assert seen[0].parent == store.farm_folder


def test_blocks_of_another_version_are_told_before_training_and_set_aside_when_trials_begin(tmp_path, monkeypatch):
    store, told, seen = store_of(tmp_path), [], []
    for cell in SMALL.cells:
        for seed in cell.seeds[:1]:
            train(store, cell, seed)
    key = Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), {"task": "push"}, {"code": "c" * 16})

    def training(*_, **__):
        seen.append((list(told), store.trials(key) is not None))
        return len(seen) > 1

    monkeypatch.setattr(running, "train_all", training)
    monkeypatch.setattr(running, "made_by", lambda physics: {"code": "d" * 16})
    monkeypatch.setattr(running, "run_blocks", lambda blocks, *_, **__: seen.append(blocks))
    settings = Settings(Wanted(), 1, lambda: True, told.append)
    run(SMALL, store, settings)
    (before, still_there) = seen[0]
    assert still_there and any("1 blocks of trials are of another version (code was cccc" in line for line in before)
    assert "2 of 12 pieces of work are done; asked for now: 10" in "\n".join(before), "two trainings, and no block"
    assert store.trials(key) is not None, "nothing is moved before trials begin"
    run(SMALL, store, settings)
    assert store.trials(key) is None and store.versions.aside()["trials"] == 1
    assert ("first", 1, 0) in {(piece.cell.name, piece.seed, piece.block) for piece in seen[-1]}


def test_what_a_killed_sitting_left_of_its_farm_is_removed_by_the_next(tmp_path):
    store = store_of(tmp_path)
    store.farm_folder.mkdir(parents=True)
    (store.farm_folder / "large").write_text("log")
    run(SMALL, store, Settings(Wanted(), 1, lambda: False, lambda _: None))
    assert not store.farm_folder.exists()
