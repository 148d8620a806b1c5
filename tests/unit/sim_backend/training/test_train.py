"""A run in small: what it exports is what it learned, it goes on where it stopped, and a critic may know more than the actor."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.folder_lock import taken  # noqa: E402
from sim_backend.layouts import layout_of  # noqa: E402
from sim_backend.training.__main__ import document, main  # noqa: E402
from sim_backend.training.actor_critic import difference_matrix  # noqa: E402
from sim_backend.training.export import read_policy, write_policy  # noqa: E402
from sim_backend.training.ledger import account  # noqa: E402
from sim_backend.training.progress import Watch  # noqa: E402
from sim_backend.training.recipe import Recipe  # noqa: E402
from sim_backend.training.slices import Slices  # noqa: E402
from sim_backend.training.train import Run  # noqa: E402
from sim_backend.trifinger.constants import CUBE_RADIUS_M  # noqa: E402
from sim_backend.workers.pool import WorkersError  # noqa: E402
from tests.cli_pages import SECTIONS, names_after  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # torch's own
TINY = """
task = "reach"
layout = "reach"
episode_s = 0.4
samples = {samples}
[networks]
actor = [8]
critic = [8]
[ppo]
robots = 25
steps = 8
epochs = 1
minibatch = 100
[evaluation]
every_samples = 200
trials = 2
physics = ["nominal", "mild"]
final_trials = 2
"""


def recipe(**changes) -> Recipe:
    settings = {
        "task": "push",
        "layout": "push",
        "episode_s": 0.4,
        "samples": 400,
        "networks": {"actor": (16,), "critic": (16,)},
        "ppo": {"robots": 25, "steps": 8, "epochs": 2, "minibatch": 100},
        "evaluation": {"every_samples": 10_000, "trials": 2, "final_trials": 0},
    }
    return Recipe.model_validate(settings | changes)


@pytest.mark.parametrize("action", ["torque", "dactyl bins"])
@pytest.mark.parametrize("privileged", [False, True])
def test_what_is_exported_is_what_was_learned(tmp_path, action, privileged):
    networks = {"actor": (16, 16), "critic": (16,), "privileged": privileged}
    run = Run("mine", recipe(action=action, networks=networks, physics="real"), tmp_path, threads=1, tell=lambda _: None)
    run.learn()
    seen = run.robots.reset()
    with torch.no_grad():
        learned = run.policy.get_distribution(run.policy.obs_to_tensor(seen)[0]).mode().numpy()
    wanted = run.robots.environment.practice.action_space.to_command(learned)
    policy = read_policy(write_policy(run.exported(), tmp_path, "mine"))
    acts = policy(seen["seen"] if privileged else seen)
    close = np.isclose(acts, wanted, atol=1e-5)
    assert close.mean() > (0.99 if action == "dactyl bins" else 1 - 1e-9)  # two bins may be equally preferred


def test_a_memory_is_exported_with_the_policy(tmp_path):
    from sim_backend.evaluation import Remembering

    networks = {"actor": (8,), "critic": (8,), "memory": 6}
    run = Run("lstm", recipe(networks=networks, physics="real"), tmp_path, threads=1, tell=lambda _: None)
    run.learn()
    path = write_policy(run.exported(), tmp_path, "lstm")
    policy, states = read_policy(path), None
    assert isinstance(policy, Remembering)
    policy.begin(25)
    seen, beginning = run.robots.reset(), np.ones(25, dtype=bool)
    for _ in range(3):
        learned, states = run.policy.predict(seen, states, beginning, deterministic=True)
        wanted = run.robots.environment.practice.action_space.to_command(learned)
        np.testing.assert_allclose(policy(seen), wanted, atol=1e-5)
        seen, beginning = run.robots.step(learned)[0], np.zeros(25, dtype=bool)
    files = [str(path), str(path.with_suffix(".json")), str(tmp_path / "lstm.onnx")]
    command = [sys.executable, "-m", "services.policies.conversion", *files, "none"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert (tmp_path / "lstm.onnx").exists(), done.stdout + done.stderr


def test_a_stopped_run_goes_on(tmp_path, capsys):
    path, folder = tmp_path / "tiny.toml", tmp_path / "run"
    path.write_text(TINY.format(samples=400))
    arguments = [str(path), "--out", str(folder), "--threads", "1"]
    assert main([*arguments, "--resume"]) == 2  # there is nothing to go on from
    assert main(arguments) == 0
    first = torch.load(folder / "checkpoint.pt", weights_only=True)
    assert main(arguments) == 2
    assert "--resume" in capsys.readouterr().err
    path.write_text(TINY.format(samples=800))
    assert main([*arguments, "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == 800
    record = json.loads((folder / "record.json").read_text())
    assert record["samples"] == 800 and record["starts"] == 2
    tried = [(each["samples"], each["physics"]) for each in record["evaluations"]]
    assert tried == [(samples, physics) for samples in (200, 400, 600, 800) for physics in ("nominal", "mild")]
    assert [each["physics"] for each in record["final"]] == ["nominal", "mild"]
    second = torch.load(folder / "checkpoint.pt", weights_only=True)
    assert second["returns"][2] > first["returns"][2]
    weights = [state["policy"]["action_net.weight"] for state in (first, second)]
    assert (weights[0] != weights[1]).any()
    assert names_after("JSON keys", SECTIONS["train RECIPE"]) == list(document(record, folder))


def test_two_learners_in_one_folder_would_write_one_checkpoint(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sim_backend.training.__main__.LEARNER_GOES_S", 0.1)
    path = tmp_path / "mine.toml"
    path.write_text(TINY.format(samples=400))
    with taken(tmp_path / "run", "a training", "", lock="learner.lock"):
        assert main([str(path), "--out", str(tmp_path / "run"), "--threads", "1"]) == 2
    said = capsys.readouterr().err
    assert f"a training is under way in {tmp_path / 'run'}: process {os.getpid()}, " in said and "give another --out" in said
    assert not (tmp_path / "run" / "checkpoint.pt").exists()


def test_a_run_is_not_gone_on_with_by_another_recipe(tmp_path, capsys):
    path, folder = tmp_path / "tiny.toml", tmp_path / "run"
    tiny = TINY.replace('["nominal", "mild"]', '["nominal"]')
    assert tiny != TINY
    path.write_text(tiny.format(samples=200))
    arguments = [str(path), "--out", str(folder), "--threads", "1"]
    assert main(arguments) == 0
    before = (folder / "checkpoint.pt").read_bytes()
    path.write_text(tiny.format(samples=400) + "[reward]\napproach = 7.0\n")
    assert main([*arguments, "--resume"]) == 2
    said = capsys.readouterr().err
    assert "was begun with another recipe: reward.approach was " in said and " and is 7.0; go on with that one" in said
    assert (folder / "checkpoint.pt").read_bytes() == before
    path.write_text("minutes = 5.0\n" + tiny.format(samples=400).replace("trials = 2", "trials = 3"))
    assert main([*arguments, "--resume"]) == 0, "how long it takes and how it is tried may change"


def test_robots_of_evaluations_that_do_not_exist_are_said_at_once(tmp_path, capsys):
    path = tmp_path / "tiny.toml"
    path.write_text(TINY.format(samples=400).replace('["nominal", "mild"]', '["nominal", "nominl"]'))
    assert main([str(path), "--out", str(tmp_path / "run"), "--threads", "1"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: recipe tiny: evaluation.physics 'nominl': no physics 'nominl'; choose from nominal, mild")


def test_a_run_whose_workers_cannot_be_had_any_more_keeps_what_it_has_learned(tmp_path, capsys, monkeypatch):
    path, folder = tmp_path / "tiny.toml", tmp_path / "run"
    path.write_text(TINY.format(samples=800).replace("steps = 8", "steps = 8\nslices = 5"))
    collect = Slices.collect

    def collect_for_a_while(self, buffer):
        if self.run.iterations == fails_at:
            raise WorkersError("no worker can be had")
        collect(self, buffer)

    monkeypatch.setattr(Slices, "collect", collect_for_a_while)
    arguments = [str(path), "--out", str(folder), "--threads", "1", "--workers", "0"]
    fails_at = 0
    assert main(arguments) == 1
    assert not (folder / "checkpoint.pt").exists(), "nothing was learned, and the command may be given again as it was"
    fails_at = 2
    assert main(arguments) == 1
    assert capsys.readouterr().err.endswith("error: no worker can be had\n")
    assert torch.load(folder / "checkpoint.pt", weights_only=True)["samples"] == 400
    fails_at = 99
    assert main([*arguments, "--resume"]) == 0
    found = account(folder)
    assert found.adds_up and found.used == 800


def press_ctrl_c_while_it_trains(before) -> None:
    while signal.getsignal(signal.SIGINT) is before:
        time.sleep(0.01)
    time.sleep(0.5)
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_leaves_a_checkpoint_to_go_on_from(tmp_path):
    path, folder = tmp_path / "tiny.toml", tmp_path / "run"
    path.write_text(TINY.format(samples=10_000_000).replace("every_samples = 200", "every_samples = 100_000_000"))
    presser = threading.Thread(target=press_ctrl_c_while_it_trains, args=(signal.getsignal(signal.SIGINT),))
    presser.start()
    assert main([str(path), "--out", str(folder), "--threads", "1"]) == 130
    presser.join()
    state = torch.load(folder / "checkpoint.pt", weights_only=True)
    assert state["samples"] < 10_000_000
    assert not (folder / "tiny.safetensors").exists()


@pytest.mark.parametrize("ends", ["stopped", "minutes"])
def test_samples_of_a_checkpoint_are_those_that_were_learned_from(tmp_path, ends):
    """Four updates for each iteration of 200 samples, whenever it is kept; the run ends within its third iteration."""
    run = Run("mine", recipe(samples=10_000, checkpoint_minutes=1e-9, minutes=1e6), tmp_path, threads=1, tell=lambda _: None)
    told, kept = run.randomizer.told, []

    def end(robots, success):
        told(robots, success)
        if run.iterations == 2 and ends == "stopped":
            run.stop()
        elif run.iterations == 2:
            run.seconds = 1e9

    def keep():
        Run.keep(run)
        state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
        kept.append((state["run"][0], state["samples"], int(state["optimizer"]["state"][0]["step"])))

    run.randomizer.told, run.keep = end, keep
    run.learn()
    run.keep()
    assert kept == [(1, 200, 4), (2, 400, 8), (2, 400, 8)]


def test_levels_follow_each_other_as_trials_succeed(tmp_path):
    levels = [{"task": "push", "until": 0.5}, {"task": "floor_pose", "until": 1.0}]
    run = Run("levels", recipe(layout="move", task="lift", curriculum=levels), tmp_path, threads=1, tell=lambda _: None)
    run.learn()
    watch, names = Watch(run), []
    watch.init_callback(run.model)
    for successes in ([True] * 99 + [False] * 101, [True] * 100 + [False] * 100, [True] * 199 + [False], [True] * 200):
        watch._recent = list(successes)
        watch._go_up()
        names.append(run.robots.environment.practice.task.name)
    assert names == ["push", "floor_pose", "floor_pose", "lift"]
    assert run.record()["level"] == 2
    heights = run.robots.environment.goal.cube_position_world_m[:, 2]
    assert heights.min() > CUBE_RADIUS_M - 1e-9  # all robots have goals in the air at once
    np.testing.assert_array_equal(run.model._last_episode_starts, np.ones(25, dtype=bool))


def test_ranges_grow_within_a_run(tmp_path):
    growing = {"method": "adr", "trials": 1, "low": 0.0, "high": 0.0, "step": 0.5, "at_boundary": 0.9}
    run = Run("adr", recipe(physics="real", samples=1000, randomization=growing), tmp_path, threads=1, tell=lambda _: None)
    assert run.record()["randomization"]["entropy"] == pytest.approx(np.log(1e-3), rel=0.3)
    run.learn()
    assert (run.randomizer.reach > 0.0).sum() > 10  # every trial at a boundary counts as good enough
    assert run.record()["randomization"]["boundaries"]["coulomb_friction.torque_nm"][1] <= 0.2


@pytest.mark.parametrize("layout", ["push", "move", "pose", "reach", "rrc2022-lift"])
def test_differences_are_those_of_the_places_in_an_observation(layout):
    from sim_backend.environments.environment import Environment
    from sim_backend.environments.practice import practice_of

    manifest = layout_of(layout)
    environment = Environment(practice_of("reach" if layout == "reach" else "lift", layout=manifest, physics_step_s=0.004))
    seen = environment.reset(np.random.default_rng(2))[0].astype(float)
    found = difference_matrix(manifest) @ seen * 0.1
    goal, cube = environment.goal, environment._state.cube_position_world_m[0]
    tips, wanted = environment._state.fingertip_position_world_m[0], goal.fingertip_position_world_m[0]
    parts = {
        "push": [tips - np.tile(cube, 3), goal.cube_position_world_m[0] - cube],
        "reach": [tips - wanted],
        "pose": [goal.cube_position_world_m[0] - cube],
    }
    expected = parts.get(layout, parts["pose"] if layout == "rrc2022-lift" else parts["push"])
    np.testing.assert_allclose(found, np.concatenate(expected), atol=1e-6)
