"""Results are small, say nothing of the machine, and those of quick and full forms do not mix."""

import json

import pytest

from experiments.store import LARGEST_WEIGHTS, Key, StoreError, thinned
from tests.unit.experiments.small import SMALL, leave_training, quick_small, rows, store_of, train, write_policy


def test_a_run_is_kept_small_with_its_policy_and_without_paths(tmp_path):
    store, cell = store_of(tmp_path), SMALL.cells[0]
    train(store, cell, 1)
    text = (store.folder / "runs" / "first-seed1.json").read_text()
    kept = json.loads(text)
    assert len(kept["curve"]) == 60
    assert kept["curve"][0] == {"samples": 0} and kept["curve"][-1] == {"samples": 199}
    assert kept["settings"] == {"task": "push", "physics": "ranges.toml"}
    assert str(tmp_path) not in text
    assert store.weights(cell, 1) == store.folder / "runs" / "first-seed1.safetensors"
    assert (store.folder / "runs" / "first-seed1.manifest.json").exists()


def test_a_large_policy_stays_in_the_work_folder_and_is_missed_elsewhere(tmp_path):
    store, cell = store_of(tmp_path), SMALL.cells[0]
    folder = store.training_folder(cell, 1)
    made = leave_training(folder, "first-seed1")
    write_policy(folder, "first-seed1", numbers=LARGEST_WEIGHTS)
    store.keep_run(cell, 1, made, "d")
    assert store.run(cell, 1)["weights"]["here"] is False
    assert store.weights(cell, 1) == folder / "first-seed1.safetensors"
    (folder / "first-seed1.safetensors").unlink()
    assert store.weights(cell, 1) is None


def test_blocks_are_added_and_nothing_half_written_counts(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), {"task": "push"})
    store.keep_block(key, 1, rows(1, 3), {"task": "push"})
    assert sorted(store.trials(key)["blocks"]) == ["0", "1"]
    (store.folder / "trials" / "first-seed2-real.new").write_text("{ half")
    assert store.trials(Key("first", 2, "real")) is None


def test_quick_and_full_results_do_not_mix(tmp_path):
    store_of(tmp_path, quick_small()).keep_block(Key("first", 1, "real"), 0, rows(0, 2), {})
    with pytest.raises(StoreError, match="quick and full results do not mix"):
        store_of(tmp_path).trials(Key("first", 1, "real"))


def test_thinning_keeps_the_ends():
    assert thinned(list(range(5)), 60) == list(range(5))
    few = thinned(list(range(1000)), 60)
    assert len(few) == 60 and few[0] == 0 and few[-1] == 999 and few == sorted(set(few))
