"""Log, truth and policy of a failed trial give the same numbers again, and then an answer; anything else is refused by name."""

import json

import pytest

from api_schemas.why import Why
from robot_farm import explaining
from robot_farm import life as life_module
from robot_farm.policy.jail import JailedPolicy
from sim_backend.replays import counterfactual, with_truth
from tests.graphs import linear
from tests.unit.conftest import lease
from tests.unit.robot_farm.living import SHORT_TASKS, Living


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """Files of a trial of a second that failed: log, truth, and the graph of its policy."""
    folder = tmp_path_factory.mktemp("why")
    graph = linear(folder / "linear.onnx")
    with pytest.MonkeyPatch.context() as patch, JailedPolicy("linear", graph) as policy:
        patch.setattr(life_module, "TASKS", SHORT_TASKS)
        robot = Living(folder)
        outcome = robot.run(lease(), policy)
    assert outcome.kind == "failed"
    return robot.log(lease()), robot.truth(lease()), graph


@pytest.fixture
def short(monkeypatch):
    for module in (counterfactual, with_truth):
        monkeypatch.setattr(module, "TASKS", SHORT_TASKS)


def run(capsys, log, truth, graph):
    code = explaining.main([str(log), "--truth", str(truth), "--graph", str(graph)])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.usefixtures("short")
def test_a_policy_that_moves_at_random_fails_on_the_ideal_robot_too(failed, capsys):
    code, said = run(capsys, *failed)
    assert code == 0
    found = Why.model_validate(said)
    assert (found.trial, found.verdict, found.blamed) == ("jtest-000", "policy", ())
    assert {group.name for group in found.groups} >= {"joint_friction", "late_camera", "encoders"}
    assert not [group for group in found.groups if group.turned]


@pytest.mark.usefixtures("short")
def test_another_policy_gives_other_numbers_and_no_answer(failed, capsys, tmp_path):
    log, truth, _ = failed
    code, said = run(capsys, log, truth, linear(tmp_path / "other.onnx", seed=1))
    assert code == explaining.EXIT_DIFFERS
    assert "from step 0 on" in said["error"]


def test_a_log_of_another_form_is_refused_before_anything_is_simulated(failed, capsys, monkeypatch):
    monkeypatch.setattr(explaining, "scene_form", lambda: "0.9.9-000000000000")
    code, said = run(capsys, *failed)
    assert code == explaining.EXIT_OTHER_FORM
    assert "0.9.9-000000000000" in said["error"]


def test_a_truth_that_is_none_is_refused(failed, capsys, tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    code, said = run(capsys, failed[0], tmp_path / "no.mcap", failed[2])
    assert code == explaining.EXIT_UNFIT
    assert "no.mcap" in said["error"]


def test_a_trial_of_an_ideal_robot_has_no_effect_to_take_away(short_log, failed, capsys):
    _, truth, graph = failed
    code, said = run(capsys, short_log, truth, graph)
    assert code == explaining.EXIT_UNFIT
    assert "ideal robot" in said["error"]
