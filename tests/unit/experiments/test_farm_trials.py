"""Blocks of farm trials: every cell meets the same seeds in turns, and what is there is not asked for again."""

import json
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from api_schemas.trial import OutcomeKind
from experiments.farm_trials import WeightsMissingError, by_goal, rows_of, run_blocks, weights_of
from experiments.plan import BlockPiece, missing
from experiments.result_files import Key, StoreError
from tests.unit.experiments.small import SMALL, TRIALS, store_of, train


def report(seed, trials, succeeded):
    kinds = [OutcomeKind.SUCCEEDED if index < succeeded else OutcomeKind.FAILED for index in range(trials)]
    per_trial = [
        SimpleNamespace(seed=1000 * seed + index, robot="robot-1", outcome=SimpleNamespace(kind=kind))
        for index, kind in enumerate(kinds)
    ]
    return SimpleNamespace(task="push", object="cube", object_scale=1.0, policy="d" * 64, per_trial=per_trial)


@dataclass
class Asked:
    """A farm that answers every job at once, and breaks after so many."""

    breaks_after: int = 1000
    opened: int = 0

    def __post_init__(self):
        self.jobs = []

    @contextmanager
    def open(self, _farm):
        self.opened += 1
        yield self

    def submit(self, cell, weights, task, trials, seed):
        self.jobs.append((cell.name, weights.name, task, trials, seed))
        if len(self.jobs) > self.breaks_after:
            raise KeyboardInterrupt
        return SimpleNamespace(wait=lambda: report(seed, trials, 2))


@pytest.fixture
def trained(tmp_path):
    store = store_of(tmp_path)
    for cell in SMALL.cells:
        for seed in cell.seeds:
            train(store, cell, seed)
    return store


NOW = {"code": "c" * 16}


def run(store, farm, goes_on=lambda: True, code=NOW):
    blocks = [piece for piece in missing(SMALL, store) if isinstance(piece, BlockPiece)]
    how = {"open_farm": farm.open, "made_by": lambda physics: code | {f"physics {physics}": "a" * 16}}
    return run_blocks(blocks, TRIALS, store, goes_on=goes_on, tell=lambda _: None, **how)


def test_all_cells_meet_the_same_seeds_in_turns_on_one_farm(trained):
    farm = Asked()
    assert run(trained, farm)
    assert farm.opened == 1
    assert [job[-1] for job in farm.jobs] == [100] * 4 + [101] * 4
    assert [job[0] for job in farm.jobs[:4]] == ["first", "first", "other", "other"]
    assert farm.jobs[1][1:4] == ("first-seed2.safetensors", "push", 5)
    kept = trained.trials(Key("other", 2, "real"))
    assert sum(by_goal(kept).values()) == 4 and len(by_goal(kept)) == 10
    assert kept["farm"] == {"physics": "real", "seed": 9001, "robots": 4}


def test_broken_off_and_gone_on_with_only_the_missing_block_is_run(trained):
    with pytest.raises(KeyboardInterrupt):
        run(trained, Asked(breaks_after=5))
    again = Asked()
    assert run(trained, again)
    assert [job[-1] for job in again.jobs] == [101] * 4
    nothing = Asked()
    assert run(trained, nothing) and nothing.opened == 0


def test_every_block_says_what_made_it(trained):
    run(trained, Asked())
    made_by = trained.trials(Key("other", 2, "real"))["made_by"]
    assert made_by == dict.fromkeys(("0", "1"), NOW | {"physics real": "a" * 16})


def test_blocks_are_not_added_to_those_of_other_code_and_no_farm_is_started_for_it(trained):
    with pytest.raises(KeyboardInterrupt):
        run(trained, Asked(breaks_after=5))
    again = Asked()
    with pytest.raises(StoreError, match=r"code was cccc.* and is dddd"):
        run(trained, again, code={"code": "d" * 16})
    assert again.opened == 0


def test_blocks_are_added_to_those_of_before_versions_were_kept(trained):
    with pytest.raises(KeyboardInterrupt):
        run(trained, Asked(breaks_after=5))
    for path in (trained.folder / "trials").glob("*.json"):
        path.write_text(json.dumps({name: part for name, part in json.loads(path.read_text()).items() if name != "made_by"}))
    assert run(trained, Asked())
    found = trained.versions.of("trials")
    assert (found.parts, found.unknown, found.known["code"]) == (8, 4, "c" * 16)


def test_no_block_is_begun_when_the_time_is_over(trained):
    farm = Asked()
    assert not run(trained, farm, goes_on=lambda: len(farm.jobs) < 4)
    assert len(farm.jobs) == 4


def test_weights_that_are_elsewhere_are_named(tmp_path):
    with pytest.raises(WeightsMissingError, match="weights of first, seed 1, are not here"):
        weights_of(SMALL.cells[0], 1, store_of(tmp_path))


def test_rows_say_goal_robot_and_whether_it_was_reached():
    assert rows_of(report(3, 2, 1)) == [
        {"goal": 3000, "robot": "robot-1", "reached": True},
        {"goal": 3001, "robot": "robot-1", "reached": False},
    ]
