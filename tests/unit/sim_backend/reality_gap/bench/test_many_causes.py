"""The blind test on robots that differ everywhere: what it draws and counts."""

import json

import numpy as np
import pytest

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.bench.joint_sessions import healthy_physics
from sim_backend.reality_gap.bench.many_causes import hidden_effects, main, robot, summary
from sim_backend.reality_gap.knowledge.healthy import detection_limits
from sim_backend.reality_gap.knowledge.joint_effects import SCALES
from sim_backend.refusal import EXIT_UNUSABLE
from sim_backend.trifinger.constants import JOINT_NAMES

KEY = "coulomb_friction.torque_nm"


def value(truth, interval, nominal=0.0):
    clear = not interval[0] <= nominal <= interval[1]
    return {
        "key": KEY,
        "where": JOINT_NAMES[0],
        "truth": truth,
        "nominal": nominal,
        "interval_90": interval,
        "value": sum(interval) / 2,
        "clear": clear,
    }


@pytest.mark.parametrize("effects", [1, 4])
def test_a_robot_has_as_many_effects_as_asked_and_is_healthy_else(effects):
    hidden = hidden_effects(7, effects)
    assert len(hidden) == effects
    assert hidden <= {key.partition(".")[0] for key in SCALES}
    drawn, healthy = robot(7, effects), healthy_physics(7)
    assert all(np.array_equal(drawn.value(key), healthy.value(key)) for key in PARAMETERS if key.partition(".")[0] not in hidden)


def test_what_is_counted():
    values = [value(0.03, [0.02, 0.04]), value(0.05, [0.02, 0.04]), value(-0.01, [-0.02, 0.06]), value(-0.01, [0.01, 0.02])]
    found = summary([{"seed": 4, "effects": None, "verdict": "named", "values": values, "seconds": 3.0}])
    assert (found["interval_coverage"]["k"], found["interval_coverage"]["n"]) == (2, 4)
    assert (found["clear"], found["clear_interval_coverage"]["k"]) == (3, 1)
    assert found["clear_with_the_right_sign"]["k"] == 2
    assert found["by_parameter"][KEY]["n"] == 4
    assert found["verdicts"] == {"named": 1}
    phase = value(-3.0, [2.9, 3.3]) | {"key": "cogging.phase_rad"}
    found = summary([{"seed": 4, "effects": None, "verdict": "named", "values": [*values, phase], "seconds": 3.0}])
    assert (found["interval_coverage"]["k"], found["clear"]) == (3, 3), (
        "where a motor cogs is held across whole turns, and has no side"
    )


@pytest.mark.parametrize(("verdict", "right", "wrong"), [("named", 1, 1), ("unexplained", 0, 0)])
def test_effects_count_if_a_value_is_clear_and_the_verdict_names_them(verdict, right, wrong):
    there, other = sorted(hidden_effects(7, 2))
    absent = next(key for key in SCALES if key.partition(".")[0] not in (there, other))
    keys = [
        next(key for key in SCALES if key.startswith(there + ".")),
        next(key for key in SCALES if key.startswith(other + ".")),
    ]
    values = [value(0.03, [0.02, 0.04]) | {"key": keys[0]}, value(0.0, [-0.1, 0.1]) | {"key": keys[1]}]
    values.append(value(0.0, [0.01, 0.02]) | {"key": absent})
    found = summary([{"seed": 7, "effects": 2, "verdict": verdict, "values": values, "seconds": 3.0}])
    assert found["effects"] == {"right": right, "wrong": wrong, "missed": 2 - right}


def test_robots_with_some_effects_calibrate_nothing(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--first-seed", "1", "--effects", "2", "--calibrate", "--out", str(tmp_path)])
    assert "all effects" in capsys.readouterr().err


def test_a_folder_without_robots_calibrates_nothing_and_is_named(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--first-seed", "1", "--out", str(tmp_path), "--calibrate", str(tmp_path / "nowhere")])
    assert f"in {tmp_path / 'nowhere' / 'robots.jsonl'}" in capsys.readouterr().err


def test_a_folder_that_cannot_be_used_is_named(capsys):
    assert main(["--first-seed", "1", "--out", "/proc/nothing"]) == EXIT_UNUSABLE
    assert capsys.readouterr().err.startswith("error: cannot use /proc/nothing: ")


def test_robots_that_were_asked_about_are_not_asked_again(tmp_path, capsys):
    line = {"seed": 1, "effects": None, "verdict": "named", "values": [value(0.03, [0.02, 0.04])], "seconds": 3.0}
    (tmp_path / "robots.jsonl").write_text(json.dumps(line) + "\n" + json.dumps(line | {"seed": 5}) + "\n" + '{"seed": 2, "cut')
    other = json.dumps(line | {"effects": 3, "verdict": "unexplained"})
    (tmp_path / "robots.jsonl").write_text(other + "\n" + (tmp_path / "robots.jsonl").read_text())
    assert main(["--first-seed", "1", "--robots", "1", "--out", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["robots"], found["seeds"]) == (1, [1, 1])
    assert json.loads((tmp_path / "many-causes.json").read_text()) == found
    assert found["verdicts"] == {"named": 1}, "robots with other effects in the same folder do not count"
    assert len((tmp_path / "robots.jsonl").read_text().splitlines()) == 3


@pytest.mark.parametrize(("verdict", "joints"), [("named", 2), ("unexplained", 0)])
def test_effects_above_their_limits_are_told_by_clear_values_of_the_right_side(verdict, joints):
    truth = robot(7).value(KEY)[0]
    at = [{"where": joint, "nominal": 0.0} for joint in JOINT_NAMES]
    right = [value(truth[j], [0.5 * truth[j], 1.5 * truth[j]]) | at[j] for j in (0, 1)]
    wrong = value(truth[2], [-0.2, -0.1]) | at[2]
    unclear = value(truth[3], [-0.1, 0.1]) | at[3]
    values = [*right, wrong, unclear]
    line = {"seed": 7, "effects": None, "verdict": verdict, "values": values, "seconds": 3.0}
    found = summary([line])["above_limits"]
    of = int((truth >= detection_limits()[KEY]).sum())
    assert of >= 4
    assert (found["by_parameter"][KEY]["k"], found["by_parameter"][KEY]["n"]) == (joints, of)
    assert found["places"]["k"] == joints
    assert (found["effects"]["k"], found["effects"]["n"]) == (joints > 0, len(found["by_parameter"]))
    assert (found["robots_by_parameter"][KEY]["k"], found["robots_by_parameter"][KEY]["n"]) == (joints > 0, 1)
    beside = summary([line | {"in_a_set": ["load_friction"]}])["above_limits"]
    assert beside["effects"] == found["effects"]
    assert beside["effects_or_set"]["k"] == (2 if joints else 0), "what is in a set counts with what is named"
