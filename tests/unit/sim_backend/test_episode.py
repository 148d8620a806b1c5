"""Time: what is observed, when an action acts, when a pose arrives."""

import numpy as np
import pytest

from api_schemas.observation import OBSERVATION_SIZES
from api_schemas.policy import LAYOUTS, ActionKind, PolicyManifest
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.episode import Episode
from sim_backend.observation import FIELDS
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial


def begin(manifest: PolicyManifest, seed: int = 1) -> Episode:
    episode = Episode(SimulatedDriver(), Tracker(), manifest)
    episode.begin(*draw_trial(TASKS["push"], seed))
    return episode


@pytest.mark.parametrize("delay_ms", [0, 2, 10, 19])
def test_an_action_acts_its_delay_after_the_observation(delay_ms):
    manifest = LAYOUTS["keypoints"].model_copy(update={"action_delay_s": delay_ms / 1000})
    episode = begin(manifest)
    episode.observe()
    episode.advance(np.full((1, 9), 0.01))
    episode.observe()
    desired = episode.advance(np.full((1, 9), 0.02)).segment.desired_torque_nm[0, :, 0]
    np.testing.assert_array_equal(desired, [0.01] * delay_ms + [0.02] * (20 - delay_ms))


def test_tracker_is_ten_hertz_and_ninety_milliseconds_late():
    episode = begin(LAYOUTS["keypoints"])
    tracked, positions = [], {}
    for _ in range(100):
        episode.observe()
        period = episode.advance(np.full((1, 9), -0.1))
        for row in range(20):
            positions[period.segment.first_step + row] = period.segment.cube_position_world_m[:, row]
        tracked += period.tracked
    assert [pose.capture_step.tolist() for pose in tracked] == [[step] for step in range(0, 2000, 100)]
    assert all((pose.delivery_step - pose.capture_step == 90).all() for pose in tracked)
    for pose in tracked:
        np.testing.assert_array_equal(pose.cube_position_world_m, positions[int(pose.capture_step[0])])


def test_a_pose_is_not_seen_before_it_arrives():
    episode = begin(LAYOUTS["pose"])
    seen = []
    for _ in range(10):
        observation = episode.observe()
        seen.append(observation[0, 18:25].copy())
        episode.advance(np.full((1, 9), -0.2))
    changes = [k for k in range(1, 10) if (seen[k] != seen[k - 1]).any()]
    assert set(changes) <= {5}  # the frame of 0 ms arrives at 90 ms and is first observed at 100 ms


def test_observation_fields_have_the_sizes_of_the_contract():
    assert set(FIELDS) == set(OBSERVATION_SIZES)
    for name, size in OBSERVATION_SIZES.items():
        manifest = PolicyManifest(observation=(name,))
        assert begin(manifest).observe().shape == (1, size), name


def test_joint_position_actions_hold_where_zero_torque_falls():
    def moved(kind: ActionKind, action: np.ndarray) -> float:
        episode = begin(LAYOUTS["keypoints"].model_copy(update={"action_kind": kind}))
        held = episode.measurement.joint_position_rad.copy()
        for _ in range(50):
            episode.observe()
            episode.advance(action)
        return float(np.abs(episode.measurement.joint_position_rad - held).max())

    held = begin(LAYOUTS["keypoints"]).measurement.joint_position_rad
    assert moved(ActionKind.TORQUE, np.zeros((1, 9))) > 0.3
    assert moved(ActionKind.JOINT_POSITION, held) < 0.05


def test_joint_position_delta_moves_by_it():
    episode = begin(LAYOUTS["keypoints"].model_copy(update={"action_kind": ActionKind.JOINT_POSITION_DELTA}))
    before = episode.measurement.joint_position_rad.copy()
    for _ in range(50):
        episode.observe()
        episode.advance(np.array([[0.05, 0, 0] * 3]))
    assert (episode.measurement.joint_position_rad - before)[0, ::3].min() > 0.1


def test_batched_and_single_episodes_agree_to_the_bit():
    manifest = LAYOUTS["keypoints"]
    from sim_backend.tasks.task import stack_goals, stack_starts

    drawn = [draw_trial(TASKS["push"], seed) for seed in (1, 2)]
    together = Episode(SimulatedDriver(robots=2), Tracker(), manifest)
    together.begin(stack_starts([s for s, _ in drawn]), stack_goals([g for _, g in drawn]))
    alone = begin(manifest, seed=2)
    rng = np.random.default_rng(0)
    for _ in range(50):
        both, one = together.observe(), alone.observe()
        np.testing.assert_array_equal(both[1], one[0])
        action = rng.uniform(-0.3, 0.3, (2, 9))
        together.advance(action)
        alone.advance(action[1:])
