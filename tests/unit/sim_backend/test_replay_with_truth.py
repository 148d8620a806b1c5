"""Trials of robots with physics of their own are simulated again bit for bit, from log and truth together only."""

import dataclasses
import json

import numpy as np
import pytest
from mcap.reader import make_reader

from api_schemas.robot import Lease
from api_schemas.trial import OutcomeKind
from api_schemas.trial_log_reader import LogUnreadableError, read_log, read_truth
from robot_farm import life as life_module
from robot_farm.jail import JailedPolicy
from sim_backend import replay
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.replay_with_truth import verify_with_truth
from tests.graphs import linear
from tests.unit.conftest import lease
from tests.unit.robot_farm.living import SHORT_TASKS, Living


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
    log, truth = read_log(trial[0]), read_truth(trial[1])
    forged = getattr(log, name).copy()
    forged[700, 3] += 1e-9
    found = verify_with_truth(dataclasses.replace(log, **{name: forged}), truth)
    assert (found.same, found.first_difference_step) == (False, 700)


def test_a_forged_pose_of_the_tracker_is_found(trial):
    log, truth = read_log(trial[0]), read_truth(trial[1])
    forged = log.tracked_position_world_m.copy()
    forged[4, 0] += 1e-9
    found = verify_with_truth(dataclasses.replace(log, tracked_position_world_m=forged), truth)
    assert found.first_difference_step == round(1000 * log.delivery_s[4])


def test_a_forged_action_shows_after_its_delay(trial):
    log, truth = read_log(trial[0]), read_truth(trial[1])
    forged = log.action.copy()
    forged[25, 0] += 1e-6
    found = verify_with_truth(dataclasses.replace(log, action=forged), truth)
    assert found.first_difference_step is not None
    assert 500 <= found.first_difference_step <= 520


def test_the_truth_of_another_trial_is_refused(trial):
    log, truth = read_log(trial[0]), read_truth(trial[1])
    with pytest.raises(LogUnreadableError, match="the truth of trial other"):
        verify_with_truth(log, dataclasses.replace(truth, metadata=truth.metadata | {"trial_id": "other"}))


def test_a_log_that_lacks_actions_differs_and_does_not_break(trial):
    log, truth = read_log(trial[0]), read_truth(trial[1])
    found = verify_with_truth(dataclasses.replace(log, action=log.action[:30]), truth)
    assert not found.same


def test_a_measured_log_is_no_truth(trial):
    with pytest.raises(LogUnreadableError, match="'physics'"):
        read_truth(trial[0])


@pytest.mark.parametrize("excitation", ["fast_sweeps", "slide_cube"])
def test_an_excitation_is_recorded_and_gives_the_same_numbers(excitation, tmp_path):
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
