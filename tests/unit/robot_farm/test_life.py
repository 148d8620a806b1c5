"""What a robot does between trials, with real trials of a second between."""

import numpy as np
import pytest

from api_schemas.object import ObjectName
from api_schemas.trial import Fault, OutcomeKind
from api_schemas.trial_log_reader import read_truth
from robot_farm import life as life_module
from robot_farm.cooling import BETWEEN_TRIALS_S, cooled_k
from robot_farm.jail import JailedPolicy
from robot_farm.lease_keeper import TrialStoppedError
from robot_farm.life import OutOfServiceError
from robot_farm.settings import Reset
from robot_farm.truth import TruthFile
from sim_backend.tasks.task import draw_trial
from tests.graphs import linear
from tests.unit.conftest import lease
from tests.unit.robot_farm.living import SHORT_TASKS, Living


@pytest.fixture(autouse=True)
def _one_second(monkeypatch):
    monkeypatch.setattr(life_module, "TASKS", SHORT_TASKS)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    with JailedPolicy("linear", linear(tmp_path_factory.mktemp("policy") / "linear.onnx")) as policy:
        yield policy


def test_a_trial_starts_where_the_last_one_left_the_object(tmp_path):
    robot = Living(tmp_path)
    robot.prepare(lease(ordinal=0))
    left = robot.life.driver.measure()
    second = robot.prepare(lease(ordinal=1, seed=9))
    np.testing.assert_allclose(second.start.cube_position_world_m, left.cube_position_world_m, atol=1e-3)
    np.testing.assert_allclose(second.start.joint_position_rad, left.true_joint_position_rad, atol=0.05)
    assert second.goal.cube_position_world_m.tolist() == draw_trial(SHORT_TASKS["push"], 9)[1].cube_position_world_m.tolist()


def test_placement_starts_where_the_seed_says(policy, tmp_path):
    robot = Living(tmp_path, reset=Reset.PLACEMENT)
    robot.run(lease(ordinal=0), policy)
    start, _ = draw_trial(SHORT_TASKS["push"], 9)
    placed = robot.prepare(lease(ordinal=1, seed=9)).start
    assert placed.cube_position_world_m[0, :2].tolist() == start.cube_position_world_m[0, :2].tolist()
    stands_m = robot.life.driver.rest_height_m(placed.cube_quat_wxyz)  # on its face: this robot's cube has a size of its own
    assert placed.cube_position_world_m[0, 2] == pytest.approx(stands_m[0], abs=1e-9)
    assert placed.joint_position_rad.tolist() == start.joint_position_rad.tolist()


def test_another_object_is_placed_and_keeps_the_motors_warm(policy, tmp_path):
    robot = Living(tmp_path)
    robot.run(lease(ordinal=0), policy)
    warm_k = robot.life.driver.motor_temperature_rise_k[0]
    ball = lease(ordinal=1).model_copy(update={"object": ObjectName.SPHERE, "object_scale": 1.2})
    prepared = robot.prepare(ball)
    assert robot.life.driver.shape.name == "sphere"
    assert "the object was placed" in prepared.events
    assert prepared.start.cube_position_world_m[0, 2] == pytest.approx(
        robot.life.driver.shape.rest_height_m * prepared.physics.value("cube_size.factor")[0]
    )
    assert prepared.start.motor_temperature_rise_k is not None
    expected_k = cooled_k(warm_k, prepared.physics, BETWEEN_TRIALS_S)
    np.testing.assert_allclose(prepared.start.motor_temperature_rise_k[0], expected_k, rtol=1e-9)


def test_a_hot_robot_waits_and_says_so(policy, tmp_path):
    robot = Living(tmp_path)
    robot.run(lease(ordinal=0), policy)
    assert robot.life._arena is not None
    robot.life._arena.set_temperature(np.full(9, 60.0))
    prepared = robot.prepare(lease(ordinal=1))
    assert any(event.startswith("the robot waited") for event in prepared.events)
    assert prepared.start.motor_temperature_rise_k is not None
    assert prepared.start.motor_temperature_rise_k.max() < 26.0


def test_it_tests_itself_after_every_so_many_trials(policy, tmp_path):
    robot, tested = Living(tmp_path, self_test_every=2), []
    for ordinal in range(4):
        leased = lease(ordinal=ordinal)
        prepared = robot.prepare(leased)
        tested.append("the robot passed its self-test" in prepared.events)
    assert tested == [True, False, True, False]


def test_a_joint_that_gets_stuck_ends_as_the_platforms_fault(policy, tmp_path):
    robot = Living(tmp_path, "stuck_joint:finger120_base_to_upper@1+0.5")
    assert robot.run(lease(ordinal=0), policy).fault is Fault.NONE
    outcome = robot.run(lease(ordinal=1), policy)
    assert (outcome.kind, outcome.fault) == (OutcomeKind.PLATFORM_ERROR, Fault.PLATFORM)
    assert "joint finger120_base_to_upper" in outcome.reason
    assert "joint finger120_base_to_upper" in str(robot.life.wrong)
    changes = read_truth(robot.truth(lease(ordinal=1))).physics["changes"]
    assert [change["step"] for change in changes] == [500]
    with pytest.raises(OutOfServiceError, match="finger120_base_to_upper"):
        robot.prepare(lease(ordinal=2))
    assert "finger120_base_to_upper" in str(robot.life.test_again(lambda: None))


def test_a_camera_that_dies_ends_as_the_platforms_fault(policy, tmp_path):
    robot = Living(tmp_path, "dead_camera:camera180@0+0.5")
    outcome = robot.run(lease(ordinal=0), policy)
    assert outcome.fault is Fault.PLATFORM
    assert robot.life.wrong == "camera180 sees nothing of the resting object"


def test_an_encoder_that_jumps_ends_the_trial_at_once(policy, tmp_path):
    robot = Living(tmp_path, "encoder_jump:finger0_middle_to_lower:-0.3@0+0.5")
    outcome = robot.run(lease(ordinal=0), policy)
    assert outcome.fault is Fault.PLATFORM
    assert "the encoder of joint finger0_middle_to_lower jumped by -0." in outcome.reason
    assert robot.life.wrong is not None
    assert read_truth(robot.truth(lease(ordinal=0))).joint_steps[-1] == 510


def test_a_controller_that_restarts_costs_one_trial_and_not_the_robot(policy, tmp_path):
    robot = Living(tmp_path, "controller_restart@0+0.4")
    outcome = robot.run(lease(ordinal=0), policy)
    assert outcome.fault is Fault.PLATFORM
    assert "restarted" in outcome.reason
    assert robot.life.wrong is None
    assert robot.run(lease(ordinal=1), policy).fault is Fault.NONE


def test_faults_by_chance_come_and_are_mended_by_whoever_sends_for_a_test(policy, tmp_path):
    robot = Living(tmp_path, fault_rate=1.0)
    robot.prepare(lease(ordinal=0))
    assert len(robot.life._by_chance) == 1
    assert robot.life.test_again(lambda: None) is None
    assert not robot.life._by_chance


def test_a_robot_that_must_stop_stops_while_it_gets_ready(tmp_path):
    robot = Living(tmp_path)
    truth = TruthFile(tmp_path / "t.truth.mcap", robot.truth_channels)
    with pytest.raises(TrialStoppedError, match="enough"):
        robot.life.prepare(lease(), truth, lambda: "enough")


def test_after_something_nobody_understands_it_begins_anew(policy, tmp_path):
    robot = Living(tmp_path)
    robot.run(lease(ordinal=0), policy)
    robot.life.forget()
    assert "the object was placed" in robot.prepare(lease(ordinal=1)).events
