"""Success rates with their intervals, and differences goal by goal."""

import json

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")

from sim_backend.environments.action_space import ActionMode, ActionSpace
from sim_backend.layouts import layout_of
from sim_backend.training import trying
from sim_backend.training.export import ExportedPolicy, write_policy


def test_a_difference_is_taken_goal_by_goal():
    first, second = np.array([True] * 60 + [False] * 40), np.array([True] * 50 + [False] * 50)
    paired = trying.difference(first, second)
    crossed = trying.difference(first, second[::-1])
    assert paired["difference"] == crossed["difference"] == pytest.approx(0.1)
    assert 0.05 < paired["interval_80"][0] < 0.1 < paired["interval_80"][1] < 0.15
    assert crossed["interval_80"][0] < 0.0


def test_robots_by_preset_or_by_values():
    half = trying.robots_of(trying.LESS_FRICTION, 3, 0)
    assert half.value("fingertip_friction.coefficient").tolist() == [0.5] * 3
    assert trying.robots_of("nominal", 3, 0).is_nominal
    real = trying.robots_of("real", 3, 0)
    assert len(set(real.value("cube_mass.factor").tolist())) == 3
    with pytest.raises(ValueError, match="unknown effect 'sheen'"):
        trying.robots_of("sheen.factor=1", 3, 0)


def test_the_command_tries_two_policies_on_the_same_goals(tmp_path, capsys):
    acts = ActionSpace(ActionMode.JOINT_POSITION)
    manifest, rng = acts.manifest(layout_of("reach")), np.random.default_rng(0)
    paths = []
    for name in ("one", "two"):
        tensors = {"running_mean": np.zeros(45), "running_var": np.ones(45), "layer0.bias": np.zeros(9)}
        tensors["layer0.weight"] = rng.normal(size=(9, 45)) * 0.01
        as_float32 = {key: value.astype(np.float32) for key, value in tensors.items()}
        paths.append(write_policy(ExportedPolicy(as_float32, manifest), tmp_path, name))
    out = tmp_path / "tried.json"
    given = [str(paths[0]), "--against", str(paths[1]), "--task", "reach", "--trials", "2", "--physics", "nominal"]
    trying.main([*given, "--threads", "1", "--out", str(out)])
    found = json.loads(out.read_text())
    assert json.loads(capsys.readouterr().out) == found
    assert [(each["policy"], each["trials"]) for each in found["tried"]] == [("one.safetensors", 2), ("two.safetensors", 2)]
    assert found["differences"][0]["trials"] == 2


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["MISSING.safetensors"], "there is no policy MISSING.safetensors; name the safetensors file of one"),
        (["builtin:grasp", "--trials", "0"], "--trials is 0; ask for at least 1"),
        (["builtin:grasp", "--against", "builtin:grasp-turn", "--trials", "1"], "--trials is 1; ask for at least 2"),
        (["builtin:grasp", "--physics", "nominl"], "no physics 'nominl'; choose from nominal, mild"),
        (["builtin:grasp", "--out", "nowhere/tried.json"], "there is no folder nowhere for --out"),
        (["broken.safetensors"], "broken.safetensors is not a safetensors file"),
    ],
)
def test_what_cannot_be_tried_is_said_before_anything_is(tmp_path, monkeypatch, capsys, given, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.safetensors").write_bytes(b"no weights")
    (tmp_path / "broken.json").write_text(layout_of("push").model_dump_json())
    with pytest.raises(SystemExit) as ended:
        trying.main([*given, "--task", "push"])
    assert ended.value.code == 2
    assert f"error: {said}" in capsys.readouterr().err
