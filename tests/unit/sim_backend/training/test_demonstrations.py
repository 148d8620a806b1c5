"""Learning from others in small: what is recorded is imitated, by cloning, DAgger, a term of PPO, and a residual is added."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from api_schemas.policy import LAYOUTS, PolicyManifest  # noqa: E402
from sim_backend.effects.physics import Physics  # noqa: E402
from sim_backend.environments.environment import Environment  # noqa: E402
from sim_backend.environments.practice import practice_of  # noqa: E402
from sim_backend.layouts import layout_of  # noqa: E402
from sim_backend.training.__main__ import main  # noqa: E402
from sim_backend.training.demonstrations.cloning import as_practised  # noqa: E402
from sim_backend.training.demonstrations.recipe import ImitationRecipe  # noqa: E402
from sim_backend.training.demonstrations.recording import main as record  # noqa: E402
from sim_backend.training.demonstrations.recording import read_demonstrations  # noqa: E402
from sim_backend.training.demonstrations.run import ImitationRun  # noqa: E402
from sim_backend.training.demonstrations.teacher import Teacher, as_it_is, find_policy  # noqa: E402
from sim_backend.training.export import ExportedPolicy, read_policy, write_policy  # noqa: E402
from sim_backend.training.recipe import Recipe  # noqa: E402
from sim_backend.training.train import Run  # noqa: E402
from tests.disk_steps import in_place, noted_steps  # noqa: E402
from trial_logs.reader import read_log  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # torch's own
EVALUATION = {"every_samples": 10_000_000, "trials": 2, "physics": ["nominal"], "final_trials": 0}


def quiet(_: str) -> None:
    pass


@pytest.fixture(scope="module")
def expert(tmp_path_factory) -> Path:
    """A policy for ``reach`` that asks for the middle of the joints' range, and a little of what it sees."""
    rng, n = np.random.default_rng(0), layout_of("reach").observation_size
    practice = practice_of("reach", action="joint position")
    tensors = {
        "layer0.weight": rng.normal(size=(16, n)) * 0.3,
        "layer0.bias": rng.normal(size=16) * 0.1,
        "layer1.weight": rng.normal(size=(9, 16)) * 0.1,
        "layer1.bias": np.zeros(9),
        "running_mean": np.zeros(n),
        "running_var": np.ones(n),
    }
    manifest = practice.manifest.model_copy(update={"input_scaling": LAYOUTS["rrc2022-push"].input_scaling, "name": "expert"})
    policy = ExportedPolicy({name: values.astype(np.float32) for name, values in tensors.items()}, manifest)
    return write_policy(policy, tmp_path_factory.mktemp("expert"), "expert")


def imitation(expert: Path, **changes) -> ImitationRecipe:
    settings = {
        "method": "dagger",
        "task": "reach",
        "layout": "reach",
        "action": "joint position",
        "physics": "real",
        "nominal_share": 0.5,
        "episode_s": 1.0,
        "samples": 25 * 100,
        "teacher": {"policy": str(expert)},
        "student": {"hidden": [32]},
        "imitation": {"robots": 25, "window": 10, "updates": 40, "batch": 200, "learning_rate": 1e-2, "least_memory": 250},
        "evaluation": EVALUATION,
    }
    return ImitationRecipe.model_validate(settings | changes)


def distance(policy, expert: Path) -> float:
    """How far from the expert's outputs a policy's are, where the expert goes."""
    practice = practice_of("reach", action="joint position", physics_step_s=0.004)
    environment = Environment(practice, robots=8)
    seen, teacher = environment.reset(np.random.default_rng(5)), Teacher(read_policy(expert), environment)
    policy.begin(8)
    apart = []
    for _ in range(30):
        wanted, space = teacher.outputs(), practice.action_space
        apart.append(np.abs((policy(seen) - space.middle) / space.largest - wanted).mean())
        seen = environment.step(wanted).observation
    return float(np.mean(apart))


def test_robots_of_evaluations_that_do_not_exist_are_said_at_once(tmp_path, expert):
    recipe = imitation(expert, evaluation=EVALUATION | {"physics": ["cube_mass.factor=1.2", "cube_mass.factor=heavy"]})
    with pytest.raises(
        ValueError, match=r"^evaluation\.physics 'cube_mass\.factor=heavy': could not convert string to float: 'heavy'"
    ):
        ImitationRun("mine", recipe, tmp_path, threads=1, tell=quiet)


@pytest.mark.parametrize("cell", [None, "gru", "lstm"])
def test_dagger_comes_closer_to_its_teacher_and_is_exported(tmp_path, expert, cell):
    recipe = imitation(expert, student={"hidden": [32], "cell": cell, "cells": 24})
    run = ImitationRun("mine", recipe, tmp_path, threads=1, tell=quiet)
    before = distance(run.exported(), expert)
    run.learn()
    assert run.samples == 2500 and run.source.samples.count <= 2500
    assert distance(run.exported(), expert) < 0.6 * before
    run.finish()
    policy, state = read_policy(tmp_path / "mine.safetensors"), run.student.nothing(25)
    seen = run.source._observation
    policy.begin(25)
    space = practice_of("reach", action="joint position").action_space
    for _ in range(3):  # what is exported is what was learned, memory and all
        outputs, state = run.student.act(seen, state)
        np.testing.assert_allclose(policy(seen), space.to_command(outputs), atol=1e-5)
    files = [str(tmp_path / name) for name in ("mine.safetensors", "mine.json", "mine.onnx")]
    command = [sys.executable, "-m", "services.policies.conversion", *files, "none"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert (tmp_path / "mine.onnx").exists(), done.stdout + done.stderr


def test_the_teachers_share_of_the_trials_falls_to_none(tmp_path, expert):
    run = ImitationRun("mine", imitation(expert, samples=25 * 300), tmp_path, threads=1, tell=quiet)
    assert [run.source._teacher_share(done) for done in (0.0, 0.1, 0.2, 0.9)] == [1.0, 0.5, 0.0, 0.0]
    run.source.advance(run.student, 0.0)
    assert run.source._teacher_acts.all()
    run.source.advance(run.student, 0.5)
    assert not run.source._teacher_acts[5:9].any()  # these robots began new trials in this window


def test_recording_goes_on_with_what_is_missing(tmp_path, expert, capsys):
    out, physics = tmp_path / "shown.safetensors", ["--physics", "nominal"]
    arguments = [str(expert), "--task", "reach", "--out", str(out), "--noise", "0.2", "--failed-too", *physics]
    assert record([*arguments, "--trials", "2"]) == 0
    assert record([*arguments, "--trials", "3"]) == 0
    assert record([*arguments[:-1], "real", "--trials", "3"]) == 2
    assert "other settings" in capsys.readouterr().err
    found = read_demonstrations(out)
    assert found.tried == 3 and len(found.first) == 3
    assert np.abs(found.observation[1:, -9:] - found.action[:-1]).max() > 0.01  # what was done is not quite what was wanted


def test_what_a_farm_logged_is_a_demonstration(tmp_path, short_log, capsys):
    out, arguments = tmp_path / "logged.safetensors", ["--logs", str(short_log.parent)]
    logs = [read_log(path) for path in sorted(short_log.parent.glob("*.mcap"))]
    assert record([*arguments, "--out", str(out)]) == 2  # it did not reach its goal
    assert "none is of a policy's trial that succeeded" in capsys.readouterr().err
    assert record([*arguments, "--out", str(out), "--failed-too"]) == 0
    found = read_demonstrations(out)
    np.testing.assert_allclose(found.observation, logs[0].observation, rtol=1e-6)
    np.testing.assert_allclose(found.action, logs[0].action, rtol=1e-6)
    assert found.manifest.model_dump_json() == PolicyManifest.model_validate_json(logs[0].manifest).model_dump_json()


def test_cloning_learns_what_was_recorded_and_goes_on_where_it_stopped(tmp_path, expert, capsys):
    shown = demonstrations_of(expert, tmp_path / "shown.safetensors")
    text = f"""
method = "cloning"
task = "reach"
layout = "reach"
action = "joint position"
samples = SAMPLES
demonstrations = ["{shown}"]
student = {{hidden = [32]}}
imitation = {{window = 10, updates = 20, batch = 100, learning_rate = 5e-3, largest_memory = 100000}}
evaluation = {{every_samples = 100000000, trials = 2, physics = ["nominal"], final_trials = 0}}
"""
    path, arguments = tmp_path / "mine.toml", ["--out", str(tmp_path / "run"), "--threads", "1"]
    path.write_text(text.replace("SAMPLES", "20000"))
    knows_nothing = ImitationRun("none", imitation(expert), tmp_path, threads=1, tell=quiet).exported()
    assert main([str(path), *arguments]) == 0
    before = distance(read_policy(tmp_path / "run" / "mine.safetensors"), expert)
    path.write_text(text.replace("SAMPLES", "80000"))
    assert main([str(path), *arguments, "--resume", "--json"]) == 0
    printed = capsys.readouterr().out
    assert json.loads(printed[printed.index("{") :])["samples"] == 80_000
    found = json.loads((tmp_path / "run" / "record.json").read_text())
    assert found["samples"] == 80_000 and found["starts"] == 2
    assert distance(read_policy(tmp_path / "run" / "mine.safetensors"), expert) < before < 0.6 * distance(knows_nothing, expert)


def demonstrations_of(expert: Path, out: Path) -> Path:
    """What the expert sees and does in some trials, whether they succeed or not."""
    from sim_backend.training.demonstrations.recording import Demonstrations, write_demonstrations

    practice = practice_of("reach", action="joint position", physics_step_s=0.004)
    environment, policy = Environment(practice, robots=20), read_policy(expert)
    seen, actions, space = [environment.reset(np.random.default_rng(3))], [], practice.action_space
    rng = np.random.default_rng(4)
    for _ in range(40):
        actions.append(policy(seen[-1]))
        disturbed = (actions[-1] - space.middle) / space.largest + 0.2 * rng.standard_normal((20, 9))
        seen.append(environment.step(disturbed).observation)
    observation, action = (np.stack(each, axis=1).reshape(800, -1) for each in (seen[:-1], actions))
    found = Demonstrations(observation, action, np.arange(20) * 40, policy.manifest, 20)
    write_demonstrations(found, out, {"policy": "expert"})
    return out


def test_demonstrations_and_checkpoints_are_on_the_disk_before_they_have_their_names(tmp_path, expert, monkeypatch):
    run, steps = ImitationRun("mine", imitation(expert), tmp_path, threads=1, tell=quiet), noted_steps(monkeypatch)
    run.keep()
    demonstrations_of(expert, tmp_path / "shown.safetensors")
    shown = in_place("shown.safetensors.new", tmp_path / "shown.safetensors")
    assert steps == in_place("checkpoint.pt.new", tmp_path / "checkpoint.pt") + shown


def ppo(**changes) -> Recipe:
    settings = {
        "task": "reach",
        "layout": "reach",
        "action": "joint position",
        "episode_s": 0.4,
        "samples": 600,
        "networks": {"actor": (16,), "critic": (16,), "privileged": True},
        "ppo": {"robots": 25, "steps": 8, "epochs": 2, "minibatch": 100, "first_deviation": 0.05},
        "evaluation": EVALUATION,
    }
    return Recipe.model_validate(settings | changes)


def test_the_demonstration_term_decays_and_the_critic_learns_first(tmp_path, expert):
    shown = demonstrations_of(expert, tmp_path / "shown.safetensors")
    table = {"files": [str(shown)], "clone_updates": 400, "batch": 100, "critic_first": 2, "weight": 0.5, "decay": 0.1}
    run = Run("mine", ppo(method="dapg", demonstrations=table | {"least_weight": 0.01}), tmp_path, threads=1, tell=quiet)
    assert [run.term.weight(iteration) for iteration in (0, 2, 3, 4, 9)] == pytest.approx([0.5, 0.5, 0.05, 0.01, 0.01])
    before = distance(run.exported(), expert)
    weights = []
    look, clone = run.policy.action_net.weight, run.term.clone

    def cloned(tell):
        clone(tell)
        weights.append(look.detach().clone())

    run.term.clone = cloned
    run.recipe = run.recipe.model_copy(update={"samples": 400})
    run.learn()
    assert torch.equal(look, weights[0])  # two iterations of the critic alone
    assert distance(run.exported(), expert) < 0.5 * before
    run.recipe = run.recipe.model_copy(update={"samples": 600})
    run.learn()
    assert not torch.equal(look, weights[0])


def test_a_clone_is_tried_before_it_practises_and_only_once(tmp_path, expert):
    shown = demonstrations_of(expert, tmp_path / "shown.safetensors")
    table = {"files": [str(shown)], "clone_updates": 20, "batch": 100, "critic_first": 1}
    evaluation = {"every_samples": 200, "trials": 2, "physics": ["nominal"], "final_trials": 0}
    settings = {"method": "dapg", "demonstrations": table, "evaluation": evaluation}
    run = Run("mine", ppo(samples=200, **settings), tmp_path, threads=1, tell=quiet)
    run.learn()
    run.keep()
    assert [each["samples"] for each in run.evaluations] == [0, 200]
    again = Run("mine", ppo(samples=400, **settings), tmp_path, threads=1, tell=quiet)
    again.go_on()
    again.learn()
    assert [each["samples"] for each in again.evaluations] == [0, 200, 400]


def test_a_residual_is_added_to_a_policy_that_stays(tmp_path, expert):
    networks = {"actor": (12,), "critic": (16,), "privileged": True}
    recipe = ppo(method="residual", networks=networks, residual={"policy": str(expert), "share": 0.2})
    run, frozen = Run("mine", recipe, tmp_path, threads=1, tell=quiet), read_policy(expert)
    assert distance(run.exported(), expert) < 0.01  # it begins as the frozen policy
    run.learn()
    seen = run.robots.reset()
    with torch.no_grad():
        residual = run.policy.get_distribution(run.policy.obs_to_tensor(seen)[0]).mode().numpy()
    space = run.robots.environment.practice.action_space
    wanted = np.clip((frozen(seen["seen"]) - space.middle) / space.largest + 0.2 * residual, -1, 1)
    acts = (run.exported()(seen["seen"]) - space.middle) / space.largest
    np.testing.assert_allclose(acts, wanted, atol=1e-4)
    assert np.abs(residual).max() > 1e-3
    over = run.robots.step(residual)[2]
    done = (run.robots.environment.sight().previous_action - space.middle) / space.largest
    np.testing.assert_allclose(done[~over], wanted[~over], atol=1e-4)
    assert not over.all()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"layout": "keypoints", "task": "push"}, "it sees "),
        ({"networks": {"actor": (8, 8), "critic": (8,)}}, "has 1 hidden layers and the residual's actor 2"),
        ({"action": "torque"}, "gives joint_position at 50 Hz, the recipe torque"),
    ],
)
def test_a_residual_that_cannot_be_added_is_refused(tmp_path, expert, changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        Run("mine", ppo(method="residual", residual={"policy": str(expert)}, **changes), tmp_path, threads=1, tell=quiet)


def test_a_teacher_that_sees_the_truth_sees_no_errors(expert):
    physics = Physics.of(4, {"encoder_offset.offset_rad": 0.05, "tracking_offset.position_m": 0.01})
    practice = practice_of("push", physics=lambda _rng, robots: physics.rows(robots), physics_step_s=0.004)
    environment = Environment(practice, robots=4)
    environment.reset(np.random.default_rng(1))
    true, seen = as_it_is(environment.sight()), environment.sight()
    np.testing.assert_array_equal(true.tracked.cube_position_world_m, seen.measurement.cube_position_world_m)
    np.testing.assert_allclose(seen.measurement.joint_position_rad - true.measurement.joint_position_rad, 0.05)
    assert np.abs(seen.tracked.cube_position_world_m - true.tracked.cube_position_world_m).max() > 0.005


def test_demonstrations_without_what_the_layout_shows_are_refused(tmp_path, expert):
    shown = read_demonstrations(demonstrations_of(expert, tmp_path / "shown.safetensors"))
    fewer = practice_of("reach", layout=layout_of("reach").model_copy(update={"observation": ("joint_position_rad",)}))
    fewer = practice_of("reach", layout=fewer.manifest, action="joint position")
    np.testing.assert_array_equal(as_practised(shown, fewer)[0], shown.observation[:, :9])
    with pytest.raises(ValueError, match="have no cube_keypoints_world_m, tracker_delay_s"):
        as_practised(shown, practice_of("push", layout="push", action="joint position"))


def test_a_policy_that_is_not_there_is_told_what_there_is():
    with pytest.raises(ValueError, match=r"no policy 'pull'; choose from .*push.*, or name a safetensors file"):
        find_policy("pull")
    assert find_policy("push").manifest.name == "reference-push"
