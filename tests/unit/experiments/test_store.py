"""Results are small, say nothing of the machine, and those of quick and full forms do not mix."""

import json
from dataclasses import replace

import pytest

from experiments.catalogue import CATALOGUE
from experiments.design import Farm
from experiments.findings import findings
from experiments.recipe_files import wanted_recipe
from experiments.result_files import Key, StoreError
from experiments.store import LARGEST_WEIGHTS, thinned
from tests.disk_steps import in_place, noted_steps
from tests.unit.experiments.small import SMALL, TRIALS, leave_training, quick_small, rows, store_of, train, write_policy


def test_a_run_is_kept_small_with_its_policy_and_without_paths(tmp_path):
    store, cell = store_of(tmp_path), SMALL.cells[0]
    train(store, cell, 1)
    text = (store.folder / "runs" / "first-seed1.json").read_text()
    kept = json.loads(text)
    assert len(kept["curve"]) == 60
    assert kept["curve"][0] == {"samples": 0} and kept["curve"][-1] == {"samples": 199}
    assert kept["settings"]["seed"] == 1 and kept["settings"]["task"] == "push"
    assert kept["without"] == [] and kept["demonstrated"] is None
    assert str(tmp_path) not in text
    assert store.weights(cell, 1) == store.folder / "runs" / "first-seed1.safetensors"
    assert (store.folder / "runs" / "first-seed1.manifest.json").exists()


def test_a_run_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    store, steps = store_of(tmp_path), noted_steps(monkeypatch)
    train(store, SMALL.cells[0], 1)
    path = store.folder / "runs" / "first-seed1.json"
    assert [step for step in steps if step[1] in ("first-seed1.new", path.name, "runs")] == in_place("first-seed1.new", path)


def test_a_large_policy_stays_in_the_work_folder_and_is_missed_elsewhere(tmp_path):
    store, cell = store_of(tmp_path), SMALL.cells[0]
    folder = store.training_folder(cell, 1)
    made = leave_training(folder, "first-seed1") | {"settings": wanted_recipe(cell.training, 1).model_dump(mode="json")}
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


def rewrite(path, change) -> None:
    found = json.loads(path.read_text())
    change(found)
    path.write_text(json.dumps(found))


def test_a_run_of_another_recipe_is_refused_with_what_differs_and_what_to_do(tmp_path):
    store, cell = store_of(tmp_path), SMALL.cells[0]
    train(store, cell, 1)
    path = store.folder / "runs" / "first-seed1.json"
    rewrite(path, lambda kept: kept["settings"]["reward"].update(approach=3.0))
    with pytest.raises(
        StoreError, match=r"reward\.approach was 3\.0 and is 1000\.0; move first-seed1\* there .* or give another --out"
    ):
        store.run(cell, 1)


def test_a_run_is_accepted_though_where_files_lay_and_what_is_said_about_it_differ(tmp_path):
    experiment = CATALOGUE["randomization"]
    store, cell = store_of(tmp_path, experiment), experiment.cell("randomized")
    train(store, cell, 2)
    path = store.folder / "runs" / "randomized-seed2.json"
    started_from = json.loads(path.read_text())["settings"]["warm_start"]["run"]
    assert started_from.startswith("push-begun-")

    def elsewhere(kept):
        kept["settings"]["warm_start"]["run"] = f"/elsewhere/starts/{started_from}"
        kept["settings"]["about"] = "other words"
        del kept["without"], kept["demonstrated"]  # as in the first results

    rewrite(path, elsewhere)
    assert store.run(cell, 2) is not None
    rewrite(path, lambda kept: kept["settings"]["warm_start"].update(run="push-begun-00000000"))
    with pytest.raises(StoreError, match=r"warm_start\.run was 'push-begun-00000000'"):
        store.run(cell, 2)


def test_a_run_whose_teacher_saw_less_is_refused(tmp_path):
    experiment = CATALOGUE["memory"]
    store, cell = store_of(tmp_path, experiment), experiment.cell("lstm")
    train(store, cell, 1)
    rewrite(store.folder / "runs" / "lstm-seed1.json", lambda kept: kept["settings"]["teacher"].update(view="robot"))
    with pytest.raises(StoreError, match=r"teacher\.view was 'robot' and is 'truth'"):
        store.run(cell, 1)


def test_a_run_that_another_experiment_takes_is_compared_with_its_own_cell(tmp_path):
    randomization, ablation = CATALOGUE["randomization"], CATALOGUE["ablation"]
    owner = store_of(tmp_path, randomization)
    train(owner, randomization.cell("randomized"), 1)
    rewrite(owner.folder / "runs" / "randomized-seed1.json", lambda kept: kept["settings"].update(samples=5))
    with pytest.raises(StoreError, match="samples was 5"):
        store_of(tmp_path, ablation).run(ablation.cell("all"), 1)


def test_groups_that_were_left_out_are_compared_since_the_recipe_only_names_their_file(tmp_path):
    ablation = CATALOGUE["ablation"]
    store, cell = store_of(tmp_path, ablation), ablation.cell("without-delays")
    train(store, cell, 1)
    assert store.run(cell, 1) is not None
    rewrite(store.folder / "runs" / "without-delays-seed1.json", lambda kept: kept["without"].pop())
    with pytest.raises(StoreError, match="without was"):
        store.run(cell, 1)


ABOUT = {"task": "push", "policy_digest": "d" * 64}


def test_trials_of_two_policies_do_not_mix(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), ABOUT)
    with pytest.raises(StoreError, match=r"policy_digest was 'ddd.* and is 'eee.*; move it away"):
        store.keep_block(key, 1, rows(1, 3), ABOUT | {"policy_digest": "e" * 64})
    assert list(store.trials(key)["blocks"]) == ["0"]


def test_trials_of_a_policy_that_is_not_the_runs_are_refused(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), ABOUT | {"policy_digest": "e" * 64})
    train(store, SMALL.cells[0], 1)
    with pytest.raises(StoreError, match="policy_digest was 'eee"):
        store.trials(key)
    with pytest.raises(StoreError, match="policy_digest was 'eee"):
        store.keep_block(Key("first", 1, "real"), 1, rows(1, 2), ABOUT | {"policy_digest": "e" * 64})


@pytest.mark.parametrize(
    ("about", "trials", "sentence"),
    [
        ({"farm": {"physics": "real", "seed": 1, "robots": 4}}, 5, "farm.seed was 1 and is 9001"),
        ({"task": "lift"}, 5, "task was 'lift' and is 'push'"),
        ({"first_job_seed": 7}, 5, "first_job_seed was 7 and is 100"),
        ({}, 4, "trials of a block were 4 and are 5"),
    ],
)
def test_trials_that_were_asked_for_otherwise_are_refused(tmp_path, about, trials, sentence):
    with pytest.raises(StoreError, match=sentence):
        store_of(tmp_path).keep_block(Key("first", 1, "real"), 0, rows(0, 2, trials), ABOUT | about)


def test_trials_of_a_shipped_policy_that_has_changed_since_are_refused(tmp_path):
    experiment = CATALOGUE["objects"]
    store, key, cell = store_of(tmp_path, experiment), Key("push-cube", 1, "real"), experiment.cell("push-cube")
    digest = store.policy_digest(cell, 1)
    store.keep_block(key, 0, rows(0, 2, 10), ABOUT | {"policy_digest": digest})
    assert store.trials(key) is not None
    path = store.folder / "trials" / "push-cube-seed1-real.json"
    rewrite(path, lambda kept: kept.update(policy_digest="0" * 64))
    with pytest.raises(StoreError, match=f"policy_digest was '0000.* and is '{digest}'"):
        store.trials(key)


MADE_BY = {"trifarm": "0.1.0", "code": "c" * 16, "physics real": "a" * 16}


@pytest.mark.parametrize("key", [Key("first", 1, "real"), Key("other", 2, "real")])
@pytest.mark.parametrize(("name", "value"), [("physics real", "b" * 16), ("code", "d" * 16), ("trifarm", "0.2.0")])
def test_blocks_of_two_versions_do_not_mix_in_a_run_nor_between_cells(tmp_path, key, name, value):
    store = store_of(tmp_path)
    store.keep_block(Key("first", 1, "real"), 0, rows(0, 2), {}, MADE_BY)
    sentence = (
        rf"first-seed1-real.json was made by another version: {name} was {MADE_BY[name]} and is {value}; .* move .*trials away"
    )
    with pytest.raises(StoreError, match=sentence):
        store.keep_block(key, 1, rows(1, 3), {}, MADE_BY | {name: value})
    store.keep_block(key, 1, rows(1, 3), {}, MADE_BY)
    assert (store.versions.of("trials").known, store.versions.of("trials").unknown) == (MADE_BY, 0)
    path = store.folder / "trials" / f"{key.stem}.json"
    rewrite(path, lambda kept: kept["made_by"]["1"].update({name: value}))
    with pytest.raises(StoreError, match="results of two versions do not mix"):
        store.versions.of("trials")


def test_what_is_of_another_version_is_set_aside_and_not_deleted(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), ABOUT, MADE_BY)
    store.keep_block(Key("other", 1, "real"), 0, rows(0, 3), ABOUT)
    path = store.folder / "trials" / "first-seed1-real.json"
    before = path.read_bytes()
    assert (
        store.versions.outdated("trials", lambda _: MADE_BY) == {}
        and store.versions.set_aside("trials", lambda _: MADE_BY) is None
    )
    now = MADE_BY | {"code": "d" * 16}
    assert store.versions.outdated("trials", lambda _: now) == {
        ("first-seed1-real", "0"): [f"code was {'c' * 16} and is {'d' * 16}"]
    }
    aside = store.versions.set_aside("trials", lambda _: now)
    assert aside is not None and not path.exists() and (aside / path.name).read_bytes() == before
    assert store.versions.aside() == {"runs": 0, "trials": 1, "measured": 0}
    assert store.trials(Key("other", 1, "real")) is not None, "what says no version goes with any"
    store.keep_block(key, 0, rows(0, 2), ABOUT, now)
    again = store.versions.set_aside("trials", lambda _: MADE_BY)
    assert again is not None and again != aside and (aside / path.name).read_bytes() == before


def test_of_blocks_in_one_file_those_of_the_present_version_stay(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), ABOUT)
    store.keep_block(key, 1, rows(1, 3), ABOUT, MADE_BY)
    aside = store.versions.set_aside("trials", lambda _: MADE_BY | {"trifarm": "0.2.0"})
    assert aside is not None
    kept, gone = store.trials(key), json.loads((aside / "first-seed1-real.json").read_text())
    assert list(kept["blocks"]) == ["0"] and kept["made_by"] == {}
    assert list(gone["blocks"]) == ["1"] and gone["made_by"] == {"1": MADE_BY} and gone["policy_digest"] == kept["policy_digest"]


def test_measurements_of_another_version_are_set_aside(tmp_path):
    store = store_of(tmp_path, CATALOGUE["consecutive"])
    store.keep_measured(Key("push", 1, "real"), {"made_by": MADE_BY})
    store.keep_measured(Key("push", 1, "nominal"), {"made_by": {"code": "c" * 16}})
    store.versions.set_aside("measured", lambda physics: {"code": "c" * 16, f"physics {physics}": "f" * 16})
    assert store.measured(Key("push", 1, "real")) is None and store.measured(Key("push", 1, "nominal")) is not None
    assert store.versions.aside()["measured"] == 1


def continued(store, cell, seed, digest):
    """Keep a run that went on from a start's weights."""
    train(store, cell, seed)
    path = store.folder / "runs" / f"{Key(cell.name, seed).stem}.json"
    rewrite(path, lambda kept: kept.update(begun_with=digest))


def test_runs_that_went_on_from_two_trainings_of_one_start_do_not_compare(tmp_path):
    experiment = CATALOGUE["ablation-again"]
    store, (first, other) = store_of(tmp_path, experiment), experiment.cells[:2]
    continued(store, first, 1, "a" * 16)
    continued(store, first, 2, "b" * 16)
    train(store, other, 2)
    assert store.begun_with() == {"push-begun-seed1": "a" * 16, "push-begun-seed2": "b" * 16}, "each seed has its own"
    continued(store, other, 1, "c" * 16)
    sentence = (
        r"all-seed1 went on from a training of push-begun-seed1 with the digest a+, without-joints-seed1 from one with c+: runs"
    )
    with pytest.raises(StoreError, match=sentence):
        store.begun_with()
    with pytest.raises(StoreError, match="do not compare"):
        findings(experiment, store)


def test_farms_of_two_physics_are_one_version(tmp_path):
    experiment = replace(SMALL, trials=replace(TRIALS, farms=(Farm("nominal"), Farm("real"))))
    store = store_of(tmp_path, experiment)
    of_nominal = {"trifarm": "0.1.0", "code": "c" * 16, "physics nominal": "e" * 16}
    store.keep_block(Key("first", 1, "real"), 0, rows(0, 2), {}, MADE_BY)
    store.keep_block(Key("first", 1, "nominal"), 0, rows(0, 2), {}, of_nominal)
    assert store.versions.of("trials").known == MADE_BY | of_nominal


def test_blocks_of_before_versions_were_kept_stay_usable_and_are_counted_as_unknown(tmp_path):
    store, key = store_of(tmp_path), Key("first", 1, "real")
    store.keep_block(key, 0, rows(0, 2), ABOUT)
    assert "made_by" not in store.trials(key)
    store.keep_block(key, 1, rows(1, 3), ABOUT, MADE_BY)
    kept = store.trials(key)
    assert sorted(kept["blocks"]) == ["0", "1"] and kept["made_by"] == {"1": MADE_BY}
    found = store.versions.of("trials")
    assert (found.known, found.parts, found.unknown) == (MADE_BY, 2, 1)


def test_measurements_of_two_versions_do_not_mix(tmp_path):
    store = store_of(tmp_path, CATALOGUE["consecutive"])
    store.keep_measured(Key("push", 1, "real"), {"made_by": MADE_BY})
    store.keep_measured(Key("lift", 1, "real"), {})
    assert store.versions.of("measured").unknown == 1
    with pytest.raises(StoreError, match=r"code was c+ and is d+"):
        store.keep_measured(Key("push", 1, "nominal"), {"made_by": {"code": "d" * 16}})
    store.keep_measured(Key("push", 1, "nominal"), {"made_by": {"code": "c" * 16, "physics nominal": "e" * 16}})
    assert store.versions.of("measured").parts == 3


def test_measurements_are_of_the_policy_and_of_what_is_asked(tmp_path):
    experiment = CATALOGUE["memory"]
    store, key = store_of(tmp_path, experiment), Key("lstm", 1, "real")
    store.keep_measured(key, {"robots": 600, "parameters": {}})
    assert store.measured(key) is not None
    store.keep_measured(key, {"robots": 6, "parameters": {}})
    with pytest.raises(StoreError, match="robots was 6 and is 600"):
        store.measured(key)
    train(store, experiment.cell("lstm"), 1)
    store.keep_measured(key, {"robots": 600, "policy_digest": "e" * 64})
    with pytest.raises(StoreError, match="policy_digest was 'eee"):
        store.measured(key)


def test_thinning_keeps_the_ends():
    assert thinned(list(range(5)), 60) == list(range(5))
    few = thinned(list(range(1000)), 60)
    assert len(few) == 60 and few[0] == 0 and few[-1] == 999 and few == sorted(set(few))
