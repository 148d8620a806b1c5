"""Evaluation: the same numbers as trials one by one."""

import numpy as np

from api_schemas.policy import LAYOUTS
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import evaluate
from sim_backend.tasks import TASKS
from sim_backend.trifinger import constants as c

MANIFEST = LAYOUTS["rrc2022-push"]
WEIGHTS = np.random.default_rng(3).normal(scale=0.1, size=(MANIFEST.observation_size, 9))


def act(observation: np.ndarray) -> np.ndarray:
    """A policy of sorts; row by row, so that the size of a batch cannot change its rounding."""
    return np.stack([np.clip(row.astype(float) @ WEIGHTS, -1, 1) * c.MAX_TORQUE_NM for row in observation])


def test_many_trials_are_the_same_as_one_by_one():
    physics = Physics.of(3, {"torque_constant.error": [0.0, 0.05, -0.05], "joint_noise.position_rad": 0.002})
    physics = physics.changed({"tracking_noise.position_m": 0.003, "occlusion_by_fingers.strength": 1.0})
    task = TASKS["reach"]
    many = evaluate(act, MANIFEST, task, [4, 5, 6], physics=physics)
    for index, seed in enumerate((4, 5, 6)):
        one = evaluate(act, MANIFEST, task, [seed], physics=physics.row(index), threads=1)
        assert one.position_error_m[0] == many.position_error_m[index]
    assert len(np.unique(many.position_error_m)) == 3
