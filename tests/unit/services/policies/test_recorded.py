"""The recorded observations are what robots see: every field is there, and fields that follow from others do."""

import numpy as np
import pytest
from safetensors import safe_open

from api_schemas import physics
from api_schemas.observation import OBSERVATION_SIZES
from api_schemas.policy import LAYOUTS, PolicyManifest
from services.policies.recorded import RECORDING, observations, recorded_trials
from sim_backend.tasks import TASKS
from sim_backend.tasks.keypoints import cube_keypoints_world_m
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from tests.benchmarks.record_observations import COMMAND, SEED, STEPS, TASK_NAMES

TRIALS = recorded_trials()


def test_the_file_says_how_it_was_made():
    with safe_open(RECORDING, "np") as file:
        made = file.metadata()
    assert (made["command"], made["seed"]) == (COMMAND, str(SEED))
    assert RECORDING.stat().st_size < 100_000
    assert [trial.task for trial in TRIALS] == list(TASK_NAMES)
    assert set(TASK_NAMES) <= set(TASKS)


@pytest.mark.parametrize("trial", TRIALS, ids=lambda trial: trial.task)
def test_fields_follow_from_each_other_as_on_a_robot(trial):
    seen = trial.fields
    tips = fingertip_position_world_m(seen["joint_position_rad"].astype(float))
    np.testing.assert_allclose(seen["fingertip_position_world_m"], tips, atol=1e-6)
    for what in ("cube", "goal"):
        corners = cube_keypoints_world_m(seen[f"{what}_position_world_m"].astype(float), seen[f"{what}_quat_wxyz"].astype(float))
        np.testing.assert_allclose(seen[f"{what}_keypoints_world_m"], corners, atol=1e-6)
    assert np.ptp(seen["joint_position_rad"], axis=0).max() > 0.3
    assert all(rows.dtype == np.float32 and np.isfinite(rows).all() for rows in seen.values())


@pytest.mark.parametrize("layout", [*LAYOUTS, "everything", "everything backwards"])
def test_every_layout_gets_its_fields_in_its_order(layout):
    names = list(OBSERVATION_SIZES) if layout == "everything" else list(OBSERVATION_SIZES)[::-1]
    manifest = LAYOUTS.get(layout) or PolicyManifest(observation=tuple(names))
    rows = observations(manifest)
    assert rows.shape == (len(TRIALS) * STEPS, manifest.observation_size)
    action, at = np.arange(9.0), 0
    seen = TRIALS[1].observation(7, manifest, action)
    for name in manifest.observation:
        part = seen[at : (at := at + OBSERVATION_SIZES[name])]
        np.testing.assert_array_equal(part, action if name == "previous_action" else TRIALS[1].fields[name][7])


def test_the_limits_are_those_of_the_simulated_robot():
    assert pytest.approx(c.MAX_TORQUE_NM) == physics.MAX_TORQUE_NM
    np.testing.assert_array_equal(physics.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_LOWER_RAD)
    np.testing.assert_array_equal(physics.SOFT_LIMIT_UPPER_RAD, c.SOFT_LIMIT_UPPER_RAD)
