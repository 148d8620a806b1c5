"""The controller carries the cube, on robots as they should be and on robots as they are."""

import numpy as np
import pytest

from api_schemas.builtin_policies import GRASP, GRASP_TURN
from sim_backend.evaluation import evaluate
from sim_backend.grasping import controller
from sim_backend.grasping.controller import GraspPolicy, Hand, Phase
from sim_backend.grasping.sight import Sight
from sim_backend.grasping.turning import LARGEST_RAD, yaw_between_rad
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial
from sim_backend.training.trying import robots_of
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad


@pytest.mark.parametrize("physics", [pytest.param("nominal", marks=pytest.mark.scale), "real"])
def test_the_cube_is_lifted_to_its_place(physics):
    """`test_the_cube_is_lifted_to_its_place` has robots that differ without scale, and turning nominal ones."""
    seeds = range(910, 914)
    robots = robots_of(physics, len(seeds), 910)
    found = evaluate(GraspPolicy(), GraspPolicy().manifest, TASKS["move_cube_2"], seeds, physics=robots, threads=1)
    assert found.success.sum() >= 3


def test_the_cube_is_turned_by_several_grasps_where_one_does_not_do():
    seeds = (41_000_010, 41_000_016)
    policy = GraspPolicy(GRASP_TURN)
    found = evaluate(policy, GRASP_TURN, TASKS["floor_pose"], seeds, threads=1)
    start = [draw_trial(TASKS["floor_pose"], seed) for seed in seeds]
    assert all(abs(yaw_between_rad(at.cube_quat_wxyz[0], goal.cube_quat_wxyz[0])) > LARGEST_RAD - 0.1 for at, goal in start)
    assert found.success.all()
    assert found.angle_error_rad.max() < 0.17


def test_without_an_orientation_of_the_goal_nothing_is_turned():
    row = np.array([*c.START_JOINT_POSITION_RAD, 0.02, 0.03, c.CUBE_REST_HEIGHT_M, 0.0, 0.0, 0.0, 1.0, 0.09, 0.1, 0.0, 0.08])
    assert Sight.of(row, GRASP).turn_rad == 0.0
    turned = Sight.of(np.array([*row, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]), GRASP_TURN)
    assert turned.turn_rad == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize(("yaw_rad", "left_alone"), [(0.05, True), (0.5, False)])
def test_a_cube_in_its_place_is_left_alone_if_it_is_turned_as_it_should_be(yaw_rad, left_alone):
    hand, cube_m = Hand(), np.array([0.02, 0.03, c.CUBE_REST_HEIGHT_M])
    goal_quat = np.array([np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)])
    for _ in range(30):
        hand.next(Sight(c.START_JOINT_POSITION_RAD, cube_m, np.array([1.0, 0, 0, 0]), 0.09, cube_m, goal_quat))
    assert (hand.phase is Phase.LOOK) == left_alone


def test_a_cube_that_is_there_is_left_alone():
    hand, cube_m = Hand(), np.array([0.02, 0.03, c.CUBE_REST_HEIGHT_M])
    for _ in range(60):
        hand.next(Sight(c.START_JOINT_POSITION_RAD, cube_m, np.array([1.0, 0, 0, 0]), 0.09, cube_m))
    assert hand.phase is Phase.LOOK


def test_it_waits_for_a_cube_that_moves():
    hand = Hand()
    for k in range(40):
        cube_m = np.array([0.01 * k - 0.1, 0.0, c.CUBE_REST_HEIGHT_M])
        hand.next(Sight(c.START_JOINT_POSITION_RAD, cube_m, np.array([1.0, 0, 0, 0]), 0.09, np.zeros(3)))
    assert hand.phase is Phase.LOOK


def test_it_begins_again_when_the_cube_was_lost():
    """Reports go on saying that the cube lies where it was, while the hand believes to carry it."""
    hand, cube_m, joints = Hand(), np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M]), c.START_JOINT_POSITION_RAD
    for _ in range(400):
        tip_m, _ = hand.next(Sight(joints, cube_m, np.array([1.0, 0, 0, 0]), 0.09, np.array([0.05, 0.05, 0.09])))
        joints = joint_position_rad(tip_m.reshape(9))
        if hand.failures:
            break
    assert hand.failures == 1
    assert hand.phase is Phase.OPEN


def carrying(goal_m):
    """A hand that has carried the cube to a goal, with a function that goes on for some periods to another goal."""
    hand, held_m, joints = Hand(), np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M]), c.START_JOINT_POSITION_RAD

    def go_on(goal_m, periods):
        nonlocal joints, held_m
        for _ in range(periods):
            tip_m, _ = hand.next(Sight(joints, held_m, np.array([1.0, 0, 0, 0]), 0.0, goal_m))
            joints = joint_position_rad(tip_m.reshape(9))
            if hand.phase is Phase.CARRY and hand.grasp is not None:
                held_m = (tip_m - hand.grasp.tip_m).mean(axis=0)
        return held_m

    assert go_on(goal_m, 400) == pytest.approx(goal_m, abs=5e-3) and hand.phase is Phase.CARRY
    return hand, go_on


def test_a_cube_in_the_hand_is_carried_on_to_the_next_goal():
    hand, go_on = carrying(np.array([0.02, 0.0, 0.08]))
    following = np.array([-0.02, 0.02, 0.07])
    lowest = min(go_on(following, 1)[2] for _ in range(100))
    assert hand.phase is Phase.CARRY and lowest > 0.065, "it is not set down on the way"
    assert go_on(following, 1) == pytest.approx(following, abs=5e-3)


def test_a_cube_is_set_down_to_be_grasped_anew_where_the_next_goal_is_out_of_this_grasp_s_reach():
    hand, go_on = carrying(np.array([0.02, 0.0, 0.08]))
    far_m = np.array([0.5, 0.0, 0.08])
    while go_on(far_m, 1)[2] > c.CUBE_REST_HEIGHT_M + 1e-3:
        assert hand.phase is Phase.CARRY, "it does not fall"
    go_on(far_m, 20)
    assert hand.phase is Phase.OPEN


def test_a_cube_is_let_go_in_the_air_only_where_it_cannot_be_set_down(monkeypatch):
    hand, go_on = carrying(np.array([0.02, 0.0, 0.08]))
    monkeypatch.setattr(controller, "carried_to", lambda *_: None)
    go_on(np.array([0.0, 0.0, 0.08]), 1)
    assert hand.phase is Phase.OPEN


def test_another_goal_before_the_cube_is_held_is_planned_anew():
    hand, cube_m = Hand(), np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M])
    for goal_m in ([0.05, 0.0, 0.0325], [0.0, 0.06, 0.0325]):
        for _ in range(20):
            hand.next(Sight(c.START_JOINT_POSITION_RAD, cube_m, np.array([1.0, 0, 0, 0]), 0.0, np.array(goal_m)))
        assert hand.grasp is not None and np.linalg.norm(hand.grasp.goal_m - goal_m) < 0.02


def test_many_trials_are_as_one_after_the_other():
    seen = np.random.default_rng(2).normal(0.0, 0.02, (3, 20)) + np.array(
        [*c.START_JOINT_POSITION_RAD, *np.zeros(3), 1, *np.zeros(7)]
    )
    together = GraspPolicy()
    together.begin(3)
    for each, expected in zip(seen, together(seen), strict=True):
        np.testing.assert_allclose(GraspPolicy()(each[None])[0], expected, atol=1e-12)
