"""What a robot does between trials, with real trials of a second between."""

import dataclasses
import json

import numpy as np
import pytest
from mcap.reader import make_reader

from api_schemas.physics import ObjectName
from api_schemas.trial import Fault, OutcomeKind
from robot_farm import life as life_module
from robot_farm.arena.cooling import BETWEEN_TRIALS_S, cooled_k
from robot_farm.arena.motion import START_RAD
from robot_farm.arena.reset import HAND_POSITION_M
from robot_farm.life import OutOfServiceError, in_the_middle
from robot_farm.link.lease_keeper import TrialStoppedError
from robot_farm.policy.jail import JailedPolicy
from robot_farm.settings import Reset
from robot_farm.truth import TruthFile
from sim_backend.tasks.task import draw_trial
from tests.graphs import linear
from tests.unit.conftest import lease
from tests.unit.robot_farm.living import SHORT_TASKS, Living
from trial_logs import trial_log
from trial_logs.reader import read_log, read_truth

FAR_SEED = next(s for s in range(99) if np.hypot(*draw_trial(SHORT_TASKS["push"], s)[0].cube_position_world_m[0, :2]) > 0.1)
"""Of a start with the object far from the middle."""


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


def test_a_farm_that_comes_again_gives_the_same_outcomes_whatever_its_trials_are_called(policy, tmp_path):
    outcomes = []
    for name in ("j-one", "j-two"):
        (tmp_path / name).mkdir()
        robot = Living(tmp_path / name)
        outcomes.append([robot.run(lease(job_id=name, ordinal=n, seed=n), policy).measures for n in range(2)])
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][0] != outcomes[0][1]


def test_placement_starts_where_the_seed_says(policy, tmp_path):
    robot = Living(tmp_path, reset=Reset.PLACEMENT)
    robot.run(lease(ordinal=0), policy)
    start, _ = draw_trial(SHORT_TASKS["push"], 9)
    prepared = robot.prepare(lease(ordinal=1, seed=9))
    placed = prepared.start
    beside_m = np.abs(placed.cube_position_world_m - start.cube_position_world_m)[0, :2]
    assert (beside_m > 0).all()
    assert beside_m.max() < 5 * HAND_POSITION_M
    stands_m = robot.life.driver.rest_height_m(placed.cube_quat_wxyz)  # on its face: this robot's cube has a size of its own
    assert placed.cube_position_world_m[0, 2] == pytest.approx(stands_m[0], abs=1e-9)
    robot.life.driver.reset(placed)  # as the trial begins
    off_rad = sum(prepared.physics.value(key) for key in ("encoder_offset.offset_rad", "encoder_jump.offset_rad"))
    assert np.abs(off_rad).max() > 5e-3
    np.testing.assert_allclose(robot.life.driver.measure().joint_position_rad, start.joint_position_rad, atol=4e-5)
    np.testing.assert_allclose(placed.joint_position_rad, start.joint_position_rad - off_rad, atol=0.008)  # belts settle anew


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


class _Patience:
    """A reason to stop that comes after so many control periods."""

    def __init__(self, periods: int) -> None:
        self.left = periods

    def __call__(self) -> str | None:
        self.left -= 1
        return None if self.left >= 0 else "enough"


def _prepare(robot: Living, leased, periods: int):
    return robot.life.prepare(leased, TruthFile(robot.truth(leased), robot.truth_channels), _Patience(periods))


@pytest.mark.parametrize("reset", Reset)
def test_after_a_self_test_that_was_stopped_the_next_trial_has_one(reset, policy, tmp_path):
    robot = Living(tmp_path, reset=reset, self_test_every=1)
    robot.run(lease(ordinal=0), policy)
    with pytest.raises(TrialStoppedError, match="enough"):
        _prepare(robot, lease(ordinal=1), periods=100)
    assert np.abs(robot.life.driver.measure().joint_position_rad - START_RAD).max() > 0.3, "stopped far from the start pose"
    prepared = robot.prepare(lease(ordinal=2))
    assert "the robot passed its self-test" in prepared.events
    assert np.abs(prepared.start.joint_position_rad - START_RAD).max() < 0.05


def test_after_a_sweep_that_was_stopped_the_fingers_go_back_first(policy, tmp_path):
    robot = Living(tmp_path)
    robot.run(lease(ordinal=0), policy)
    arena = robot.life._arena
    assert arena is not None
    at_the_wall = in_the_middle(arena.driver.shape)
    at_the_wall.cube_position_world_m[0, :2] = [0.155, 0.0]
    arena.place(at_the_wall)
    arena.is_placed = False
    with pytest.raises(TrialStoppedError, match="enough"):
        _prepare(robot, lease(ordinal=1), periods=90)  # of more than two hundred
    stopped_rad = robot.life.driver.measure().joint_position_rad
    assert np.abs(stopped_rad - START_RAD).max() > 0.3
    assert not arena.is_settled
    arena.place(in_the_middle(arena.driver.shape))  # somebody has taken the object away, so that no sweep is due
    arena._restart(dataclasses.replace(arena.start_here(), joint_position_rad=stopped_rad))
    arena.is_settled = arena.is_placed = False
    prepared = robot.prepare(lease(ordinal=2))
    assert not any("sweep" in event for event in prepared.events)
    assert np.abs(prepared.start.joint_position_rad - START_RAD).max() < 0.05


def test_a_base_joint_stuck_where_it_starts_is_no_policys_fault(policy, tmp_path):
    robot = Living(tmp_path, "stuck_joint:finger240_base_to_upper@0+0")
    outcome = robot.run(lease(ordinal=0), policy)
    assert outcome.fault is Fault.PLATFORM
    assert "joint finger240_base_to_upper" in outcome.reason


@pytest.mark.parametrize("task", ["push", "lift"])
def test_outcomes_are_exact_only_in_the_truth(task, policy, tmp_path):
    robot, asked = Living(tmp_path), lease(task=task)
    outcome = robot.run(asked, policy)
    seen = outcome.measures
    assert seen is not None
    assert json.loads(read_log(robot.log(asked)).outcome["measures"]) == seen.model_dump(mode="json")
    with robot.truth(asked).open("rb") as stream:
        records = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    exact = json.loads(records[trial_log.OUTCOME_METADATA]["measures"])
    for name, digits in (("final_position_error_m", 3), ("final_angle_error_rad", 2), ("episode_return", 1)):
        shown = getattr(seen, name)
        if exact[name] is None:
            assert shown is None
        else:
            assert shown == round(exact[name], digits) != exact[name]
    assert exact["success_fraction"] == seen.success_fraction


def test_after_something_nobody_understands_it_begins_anew(policy, tmp_path):
    robot = Living(tmp_path)
    robot.run(lease(ordinal=0), policy)
    robot.life.forget()
    assert "the object was placed" in robot.prepare(lease(ordinal=1)).events


@pytest.mark.parametrize("outcome", ["passed", "out of service"])
def test_joints_are_tried_again_with_the_object_out_of_their_way(outcome, tmp_path, monkeypatch):
    robot, tried_m = Living(tmp_path), []

    def jammed_unless_in_the_middle(motion):
        distance_m = float(np.hypot(*motion.driver.measure().cube_position_world_m[0, :2]))
        tried_m.append(distance_m)
        return None if outcome == "passed" and distance_m < 0.02 else "joint finger0_base_to_upper is blocked"

    monkeypatch.setattr(life_module, "try_joints", jammed_unless_in_the_middle)
    far_away = lease(ordinal=0, seed=FAR_SEED)
    if outcome == "passed":
        assert "the robot passed its self-test" in robot.prepare(far_away).events
    else:
        with pytest.raises(OutOfServiceError, match="is blocked"):
            robot.prepare(far_away)
    assert len(tried_m) == 2
    assert tried_m[0] > 0.05
    assert tried_m[1] < 0.02
