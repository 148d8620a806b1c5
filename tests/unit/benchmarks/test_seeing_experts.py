"""Published experts that see beside those that are told: robots that differ in nothing else, balanced trials, kept rows."""

import json

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import LOOKS, Group
from sim_backend.effects.ranges import load_ranges
from tests.benchmarks.seeing_experts import FEWEST, PRESETS, ROBOTS, ROBOTS_SEED, kept_rows, main, summary, trials


def row(goal: int, tracker: str, success: bool, task: str = "push") -> dict:
    robot = goal % ROBOTS
    return {"task": task, "goal": goal, "tracker": tracker, "robot": robot, "success": success, "error_mm": 5.0, "wall_s": 2.0}


def test_robots_differ_only_in_how_the_object_is_found():
    about_finding = {Group.TRACKING, Group.IMAGES}
    for robot in range(ROBOTS):
        told, sees = (load_ranges(name).draw(np.random.default_rng([ROBOTS_SEED, robot]), 1) for name in PRESETS.values())
        for effect in CATALOGUE.values():
            if effect.group not in about_finding:
                assert told.has(effect.name) == sees.has(effect.name)
                for parameter in effect.all_parameters:
                    key = effect.key(parameter)
                    assert np.array_equal(told.value(key), sees.value(key)), key
            assert not (told.has(effect.name) and effect.acts in LOOKS)
        for key in ("tracking_rate.rate_hz", "tracking_latency.extra_s", "tracking_jitter.std_s", "tracking_dropout.probability"):
            assert np.array_equal(told.value(key), sees.value(key)), key


def test_tasks_and_trackers_take_turns():
    assert list(trials(2))[:5] == [("push", 0, "pose"), ("push", 0, "images"), ("lift", 0, "pose"), ("lift", 0, "images"),
                                   ("push", 1, "pose")]  # fmt: skip
    assert {task for task, _, _ in trials(3, ["lift"])} == {"lift"}


def test_the_summary_is_of_whole_pairs():
    rows = [row(goal, tracker, tracker == "pose" or goal != 3) for goal in range(FEWEST) for tracker in PRESETS]
    found = summary([*rows, row(FEWEST, "pose", False), row(0, "pose", True, "lift")])
    assert set(found) == {"push"}
    assert found["push"]["goals"] == FEWEST
    assert (found["push"]["only_pose"], found["push"]["only_images"]) == (1, 0)
    assert found["push"]["difference"] == round(-1 / FEWEST, 4)
    low, high = found["push"]["difference_interval_95"]
    assert low <= -1 / FEWEST <= high <= 0.0
    assert summary(rows[:-2])["push"]["difference_interval_95"] is None


def test_rows_are_summed_up_without_a_trial_and_the_first_row_of_one_counts(tmp_path, capsys):
    path = tmp_path / "rows.jsonl"
    rows = [row(0, "pose", True), row(0, "images", True), row(1, "pose", True), row(1, "images", False), row(0, "images", False)]
    path.write_text("".join(json.dumps(each) + "\n" for each in rows))
    assert kept_rows(path) == rows[:4]
    assert kept_rows(tmp_path / "none.jsonl") == []
    main(["--experts", "none", "--rows", str(path), "--out", str(tmp_path / "sum.json"), "--budget-s", "0"])
    assert json.loads((tmp_path / "sum.json").read_text())["tasks"] == json.loads(capsys.readouterr().out)
    assert len(path.read_text().splitlines()) == 5
