"""A trial on the farm and one row of many robots at once, with the same seeds and effects, give the same numbers over 2 s."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

from api_schemas.policy import LAYOUTS
from api_schemas.trial import OutcomeKind
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import Prepared
from robot_farm.trial import measured_channels, run_trial
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.effects.ranges import load_ranges
from sim_backend.episode import Episode, Period
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial, stack_goals, stack_starts
from tests.graphs import linear
from tests.unit.conftest import lease
from trial_logs.reader import TrialLog, TruthLog, read_log, read_truth

ROBOTS, ROW = 4, 2
SEEDS = (11, 12, 13, 14)
NOISE_SEEDS = np.array([900_001, 900_002, 900_003, 900_004])
TASK = dataclasses.replace(TASKS["push"], duration_s=2.0)
MANIFEST = LAYOUTS["rrc2022-push"]
TOLERANCE = 1e-9
SEGMENT_FIELDS = ("joint_position_rad", "joint_velocity_rad_s", "measured_torque_nm", "desired_torque_nm", "applied_torque_nm")


@dataclass(frozen=True)
class Both:
    """The trial's log and truth, and what the batch did: its control periods and the report that it began with."""

    log: TrialLog
    truth: TruthLog
    first: TrackedPose
    periods: list[Period]

    def row(self, name: str) -> np.ndarray:
        """A field of the batch's segments for the robot that had the trial, shape (steps, ...)."""
        return np.concatenate([getattr(period.segment, name)[ROW] for period in self.periods])

    def reports(self) -> list[TrackedPose]:
        """The batch's reports, each once: one for another robot repeats the newest of this one."""
        found = [self.first]
        for report in (report for period in self.periods for report in period.tracked):
            if report.capture_step[ROW] != found[-1].capture_step[ROW]:
                found.append(report)
        return found


@pytest.fixture(scope="module")
def both(tmp_path_factory) -> Both:
    folder = tmp_path_factory.mktemp("both")
    robots = load_ranges("real").draw(np.random.default_rng(20261121), ROBOTS)
    drawn = [draw_trial(TASK, seed) for seed in SEEDS]
    warm_k = np.random.default_rng(1).uniform(0.0, 20.0, (ROBOTS, 9))
    starts = [
        dataclasses.replace(start, noise_seed=NOISE_SEEDS[i : i + 1], motor_temperature_rise_k=warm_k[i : i + 1])
        for i, (start, _) in enumerate(drawn)
    ]
    with JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
        truth = TruthFile(folder / "trial.truth.mcap", truth_channels())
        one = robots.row(ROW)
        ready = Prepared(starts[ROW], drawn[ROW][1], Tracker(physics=one), TASK, physics=one, truth=truth)
        outcome = run_trial(
            lease(seed=SEEDS[ROW]),
            policy,
            SimulatedDriver(physics=one),
            measured_channels(),
            folder / "trial.mcap",
            stop_reason=lambda: None,
            physics="real",
            prepared=ready,
        )
        assert outcome.kind in {OutcomeKind.SUCCEEDED, OutcomeKind.FAILED}, outcome.reason
        policy.reset()
        episode = Episode(SimulatedDriver(robots=ROBOTS, threads=2, physics=robots), Tracker(physics=robots), MANIFEST)
        start = dataclasses.replace(stack_starts(starts), noise_seed=NOISE_SEEDS, motor_temperature_rise_k=warm_k)
        first = episode.begin(start, stack_goals([goal for _, goal in drawn]))
        periods = [
            episode.advance(np.stack([policy.act(row)[0] for row in episode.observe().astype(np.float32)]))
            for _ in range(TASK.steps // MANIFEST.period_steps)
        ]
    return Both(read_log(folder / "trial.mcap"), read_truth(truth.path), first, periods)


@pytest.mark.parametrize("name", SEGMENT_FIELDS)
def test_joints_and_torques_are_the_same(both, name):
    logged = getattr(both.log, name)
    assert logged.shape == (2000, 9)
    np.testing.assert_allclose(logged, both.row(name), rtol=0, atol=TOLERANCE)


def test_observations_and_actions_are_the_same(both):
    np.testing.assert_allclose(both.log.action, [period.action[ROW] for period in both.periods], rtol=0, atol=TOLERANCE)
    observed = np.array([period.observation[ROW] for period in both.periods]).astype(np.float32)
    np.testing.assert_allclose(both.log.observation, observed, rtol=0, atol=TOLERANCE)


def test_tracked_poses_are_the_same_and_come_at_the_same_time(both):
    reports = both.reports()
    assert len(reports) >= 15
    for logged, name in (
        (both.log.tracked_position_world_m, "cube_position_world_m"),
        (both.log.tracked_quat_wxyz, "cube_quat_wxyz"),
        (both.log.confidence, "confidence"),
    ):
        np.testing.assert_allclose(logged, [getattr(report, name)[ROW] for report in reports], rtol=0, atol=TOLERANCE)
    for logged, name in ((both.log.capture_s, "capture_step"), (both.log.delivery_s, "delivery_step")):
        np.testing.assert_allclose(logged, [getattr(report, name)[ROW] / 1000 for report in reports], rtol=0, atol=TOLERANCE)


def test_true_states_are_the_same(both):
    truth = both.truth
    assert truth.cube_steps[0] == 0 and truth.cube_steps[-1] >= 1990
    for steps, logged, name in (
        (truth.cube_steps, truth.cube_position_world_m, "cube_position_world_m"),
        (truth.cube_steps, truth.cube_quat_wxyz, "cube_quat_wxyz"),
        (truth.joint_steps, truth.joint_position_rad, "true_joint_position_rad"),
        (truth.joint_steps, truth.effective_torque_nm, "effective_torque_nm"),
    ):
        np.testing.assert_allclose(logged, both.row(name)[steps], rtol=0, atol=TOLERANCE)


def test_the_robot_had_effects_and_its_neighbours_did_something_else(both):
    assert np.abs(both.row("joint_position_rad") - both.row("true_joint_position_rad")).max() > 1e-4
    assert np.abs(both.row("effective_torque_nm") - both.row("applied_torque_nm")).max() > 1e-3
    cube = both.row("cube_position_world_m")
    assert np.linalg.norm(cube - cube[0], axis=1).max() > 1e-3  # the fingers reached it
    others = [np.concatenate([p.segment.joint_position_rad[i] for p in both.periods]) for i in range(ROBOTS) if i != ROW]
    assert all(np.abs(other - both.log.joint_position_rad).max() > 0.01 for other in others)
