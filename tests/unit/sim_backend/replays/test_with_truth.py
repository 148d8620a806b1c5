"""Trials of robots with physics of their own are simulated again bit for bit, from log and truth together only."""

import dataclasses
import functools
import json

import numpy as np
import pytest
from mcap.reader import make_reader

from api_schemas.robot import Lease
from api_schemas.trial import OutcomeKind
from robot_farm import life as life_module
from robot_farm.policy.jail import JailedPolicy
from sim_backend.driver.simulated import PhysicsDivergedError
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.excitations.course import COMMAND_STEPS
from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.replays import replay
from sim_backend.replays import with_truth as replay_with_truth
from sim_backend.replays.comparison import NotRepeatableError
from sim_backend.replays.with_truth import verify_with_truth
from sim_backend.trifinger import constants as c
from tests.graphs import linear
from tests.unit.conftest import lease
from tests.unit.robot_farm.living import SHORT_TASKS, Living
from trial_logs.reader import LogUnreadableError, read_log, read_truth


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """Log and truth of a trial with a fault in it, the second of its robot."""
    folder = tmp_path_factory.mktemp("trial")
    with pytest.MonkeyPatch.context() as patch, JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
        patch.setattr(life_module, "TASKS", SHORT_TASKS)
        robot = Living(folder, "stuck_joint:finger0_base_to_upper:0.1@1+0.5")
        for ordinal in range(2):
            robot.run(lease(ordinal=ordinal), policy)
    return robot.log(lease(ordinal=1)), robot.truth(lease(ordinal=1))


@functools.cache
def read(log, truth):
    return read_log(log), read_truth(truth)


def test_log_and_truth_give_the_same_numbers(trial, capsys):
    log, truth = trial
    assert read_truth(truth).physics["changes"]
    assert replay.main([str(log), "--verify", "--truth", str(truth), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["same"], found["steps"], found["first_difference_step"]) == (True, 1000, None)


def test_without_the_truth_the_log_is_sent_to_the_farm(trial, capsys):
    assert replay.main([str(trial[0]), "--verify"]) == replay.EXIT_NEEDS_TRUTH
    assert "physics of its own" in capsys.readouterr().err


def test_the_log_holds_nothing_but_what_was_measured(trial):
    with trial[0].open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        text = " ".join(str(record.metadata) for record in reader.iter_metadata())
        text += " ".join(attached.data.decode() for attached in reader.iter_attachments())
    assert summary is not None
    assert all(channel.topic.startswith("/measured/") for channel in summary.channels.values())
    assert "noise_seed" not in text
    assert not [key for key in PARAMETERS if key in text]
    physics = read_truth(trial[1]).physics
    assert str(physics["noise_seed"]) not in text
    assert not [number for number in map(repr, physics["joint_position_rad"]) if len(number) > 8 and number in text]


@pytest.mark.parametrize("name", ["joint_position_rad", "measured_torque_nm", "applied_torque_nm", "desired_torque_nm"])
def test_a_forged_number_is_named_by_its_step(trial, name):
    log, truth = read(*trial)
    forged = getattr(log, name).copy()
    forged[700, 3] += 1e-9
    found = verify_with_truth(dataclasses.replace(log, **{name: forged}), truth)
    assert (found.same, found.first_difference_step) == (False, 700)


def test_a_forged_pose_of_the_tracker_is_found(trial):
    log, truth = read(*trial)
    forged = log.tracked_position_world_m.copy()
    forged[4, 0] += 1e-9
    found = verify_with_truth(dataclasses.replace(log, tracked_position_world_m=forged), truth)
    assert found.first_difference_step == round(1000 * log.delivery_s[4])


def test_a_forged_action_shows_after_its_delay(trial):
    log, truth = read(*trial)
    forged = log.action.copy()
    forged[25, 0] += 1e-6
    found = verify_with_truth(dataclasses.replace(log, action=forged), truth)
    assert found.first_difference_step is not None
    assert 500 <= found.first_difference_step <= 520


def test_the_truth_of_another_trial_is_refused(trial):
    log, truth = read(*trial)
    with pytest.raises(LogUnreadableError, match="the truth of trial other"):
        verify_with_truth(log, dataclasses.replace(truth, metadata=truth.metadata | {"trial_id": "other"}))


def test_a_log_that_lacks_actions_differs_and_does_not_break(trial):
    log, truth = read(*trial)
    found = verify_with_truth(dataclasses.replace(log, action=log.action[:30]), truth)
    assert not found.same


def test_a_measured_log_is_no_truth(trial):
    with pytest.raises(LogUnreadableError, match="'physics'"):
        read_truth(trial[0])


def begin_of(name, seconds):
    """The begin of an excitation."""
    whole = EXCITATIONS[name]

    def course(rng):
        commands, sight = whole.course(rng), None
        for _ in range(round(seconds / (c.PHYSICS_STEP_S * COMMAND_STEPS))):
            sight = yield commands.send(sight)

    return dataclasses.replace(whole, duration_s=seconds, course=course)


@pytest.mark.parametrize("excitation", [pytest.param("fast_sweeps", marks=pytest.mark.scale), "slide_cube"])
def test_an_excitation_is_recorded_and_gives_the_same_numbers(excitation, tmp_path, monkeypatch):
    """`test_an_excitation_is_recorded_and_gives_the_same_numbers` has the begin of one that sees the cube without scale."""
    if excitation == "slide_cube":
        monkeypatch.setitem(EXCITATIONS, excitation, begin_of(excitation, 10.0))
    robot = Living(tmp_path)
    asked = Lease(
        trial_id="jtest-000", job_id="jtest", ordinal=0, fence=1, robot="robot-0", excitation=excitation, task="identify", seed=3
    )
    outcome = robot.run(asked, None)
    log = read_log(robot.log(asked))
    assert (outcome.kind, outcome.measures) == (OutcomeKind.RECORDED, None)
    assert robot.life.wrong is None
    assert len(log.joint_steps) == log.command_steps[-1] + 10
    assert np.isfinite(log.command_target_rad).all()
    assert log.goal is None
    assert verify_with_truth(log, read_truth(robot.truth(asked))).same
    forged = log.command_torque_nm.copy()
    forged[3] += 1e-6
    found = verify_with_truth(dataclasses.replace(log, command_torque_nm=forged), read_truth(robot.truth(asked)), log)
    assert (found.first_difference_step, found.largest_joint_difference_rad) == (log.command_steps[3], 0.0)


def test_beside_the_original_the_log_gives_the_same_numbers(trial, capsys):
    log, truth = map(str, trial)
    assert replay.main([log, "--verify", "--truth", truth, "--original", log, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"]


def _with_other_words(log):
    object_, manifest = log.metadata | {"object": "sphere"}, log.manifest.replace('"lpf_alpha":', '"lpf_alpha":  ')
    return {
        "seed": {"metadata": log.metadata | {"seed": "8"}},
        "object": {"metadata": object_},
        "task": {"metadata": log.metadata | {"task": "reach"}},
        "manifest": {"manifest": manifest + " "},
        "outcome": {"outcome": log.outcome | {"reason": "it was perfect"}},
    }


@pytest.mark.parametrize("name", ["seed", "object", "task", "manifest", "outcome"])
def test_other_words_than_the_originals_are_a_difference_and_ask_the_robot_nothing(trial, name):
    log, truth = read(*trial)
    found = verify_with_truth(dataclasses.replace(log, **_with_other_words(log)[name]), truth, log)
    assert (found.same, found.first_difference_step) == (False, 0)
    assert (found.largest_joint_difference_rad, found.largest_cube_difference_m) == (0.0, 0.0)


def test_a_made_up_log_measures_nothing_of_the_hidden_robot(trial):
    log, truth = read(*trial)
    forged = log.action.copy()
    forged[25] = 0.3
    found = verify_with_truth(dataclasses.replace(log, action=forged), truth, log)
    assert found.first_difference_step == log.policy_steps[25], "the action's own step, not that of what it would have done"
    assert (found.largest_joint_difference_rad, found.largest_cube_difference_m) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "forge", "step"),
    [
        ("action", lambda rows: rows[:30], 600),
        ("observation", lambda rows: rows[:, :-1], 0),
        ("observation", lambda rows: rows[:0], 0),
        ("tracked_position_world_m", lambda rows: rows[:0], 0),
        ("confidence", lambda rows: np.append(rows, 1.0), None),
        ("tracker", lambda rows: ({"raw_confidence": 2.0}, *rows[1:]), 0),
        ("joint_position_rad", lambda rows: np.where(np.arange(len(rows))[:, None] == 7, np.nan, rows), 7),
    ],
)
def test_whatever_is_missing_or_too_much_is_a_difference(trial, name, forge, step):
    log, truth = read(*trial)
    found = verify_with_truth(dataclasses.replace(log, **{name: forge(getattr(log, name))}), truth, log)
    assert not found.same
    assert step is None or found.first_difference_step == step
    json.dumps(dataclasses.asdict(found), allow_nan=False)


def test_numbers_that_are_none_are_a_clear_refusal(trial):
    log, truth = read(*trial)
    words = np.array(["soon"] * len(log.capture_s), dtype=object)
    with pytest.raises(LogUnreadableError, match="cannot be compared"):
        verify_with_truth(dataclasses.replace(log, capture_s=words), truth, log)


def test_what_went_wrong_inside_the_hidden_simulation_is_kept_apart(trial, monkeypatch, capsys):
    def diverge(*_):
        raise PhysicsDivergedError("the joints left the world at step 421")

    monkeypatch.setattr(replay_with_truth, "_simulate", diverge)
    log, truth = map(str, trial)
    with pytest.raises(NotRepeatableError, match="step 421"):
        verify_with_truth(read_log(trial[0]), read_truth(trial[1]))
    arguments = [log, "--verify", "--truth", truth, "--original", log]
    assert replay.main([*arguments, "--json"]) == replay.EXIT_UNREADABLE
    said = json.loads(capsys.readouterr().out)
    assert said["error"] == "the trial cannot be simulated again"
    assert "step 421" in said["hidden"]
    assert replay.main(arguments) == replay.EXIT_UNREADABLE
    assert "step 421" in capsys.readouterr().err


def test_an_unfit_original_is_not_the_logs_fault(trial, tmp_path, capsys):
    (tmp_path / "original.mcap").write_bytes(trial[0].read_bytes()[:-1000])
    log, truth = map(str, trial)
    arguments = [log, "--verify", "--truth", truth, "--original", str(tmp_path / "original.mcap"), "--json"]
    assert replay.main(arguments) == replay.EXIT_UNREADABLE
    assert "hidden" in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["trial_id", "object"])
def test_a_log_cannot_make_the_reason_as_long_as_it_likes(trial, monkeypatch, capsys, name):
    log = read_log(trial[0])
    monkeypatch.setattr(replay, "read_log", lambda _: dataclasses.replace(log, metadata=log.metadata | {name: "x" * 10**6}))
    assert replay.main([str(trial[0]), "--verify", "--truth", str(trial[1]), "--json"]) == replay.EXIT_UNREADABLE
    assert len(capsys.readouterr().out) < 800


def test_an_original_without_a_truth_is_wrong_usage(trial):
    with pytest.raises(SystemExit) as ended:
        replay.main([str(trial[0]), "--verify", "--original", str(trial[0])])
    assert ended.value.code == 2


def test_a_trial_whose_tracker_looked_at_images_is_not_said_to_differ(trial):
    log, truth = read(*trial)
    by_images = dataclasses.replace(log, outcome={**log.outcome, "tracker": "images"})
    with pytest.raises(LogUnreadableError, match="tracker looked at images"):
        verify_with_truth(by_images, truth)
