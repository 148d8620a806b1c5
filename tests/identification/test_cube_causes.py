"""Effects on the cube and its tracker, hidden in pushing and resting logs of robots with small errors everywhere, are found.

The full test is ``python -m sim_backend.reality_gap.bench.cube``; here each effect is large and tried once.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from sim_backend.reality_gap.bench.cube_sessions import healthy_physics, sessions_with_pushes
from sim_backend.reality_gap.subjects.cube.replay import PushReplay
from sim_backend.reality_gap.subjects.cube.study import CubeStudy, study_cube
from sim_backend.reality_gap.verdict import VerdictKind

SEED = 730_000


@dataclass(frozen=True)
class Hidden:
    """An effect, what it is at, and how near to that the tool must come."""

    key: str
    value: float | list[float]
    tolerance: float


HIDDEN = {
    "tracking_latency": Hidden("tracking_latency.extra_s", 0.02, 0.004),
    "tracking_dropout": Hidden("tracking_dropout.probability", 0.08, 0.04),
    "orientation_jumps": Hidden("orientation_jumps.probability", 0.03, 0.025),
    # On other seeds (730013, 730023, 730033), in two forms of the scene, values are 2.0 mm off in the root mean square; 4 mm are
    # then the 99 % quantile of a normal error in three directions.
    "tracking_offset": Hidden("tracking_offset.position_m", [0.005, -0.004, 0.002], 0.004),
    "cube_mass": Hidden("cube_mass.factor", 1.40, 0.1),
    "table_friction": Hidden("table_friction.coefficient", 0.7, 0.08),
    "fingertip_friction": Hidden("fingertip_friction.coefficient", 0.6, 0.1),
}
AT_SCALE = ("tracking_dropout", "orientation_jumps", "tracking_offset", "cube_mass", "fingertip_friction")
"""Those of which another of the same kind is named without scale."""
JOINTS = "coulomb_friction.torque_nm"


ROBOTS = (*HIDDEN, "healthy", JOINTS)


@pytest.fixture(scope="module")
def replay() -> PushReplay:
    return PushReplay()


def study_of(robot: str, replay: PushReplay) -> CubeStudy:
    index = ROBOTS.index(robot)
    physics = healthy_physics(np.random.default_rng([SEED, index]), 1)
    if robot == JOINTS:
        physics = physics.changed({JOINTS: np.full((1, 9), 0.03)})
    elif robot in HIDDEN:
        hidden = HIDDEN[robot]
        physics = physics.changed({hidden.key: [hidden.value] if isinstance(hidden.value, list) else hidden.value})
    (recordings,) = sessions_with_pushes(physics, [SEED + index])
    return study_cube(recordings, np.random.default_rng(1), replay=replay)


@pytest.mark.parametrize("effect", [pytest.param(name, marks=[pytest.mark.scale] * (name in AT_SCALE)) for name in HIDDEN])
def test_the_effect_is_named_and_its_size_is_right(effect, replay):
    """`test_the_effect_is_named_and_its_size_is_right` has one of contact and one of time without scale, and
    `test_many_losses_and_jumps_are_named` both of what reports are counted for.
    """
    study, hidden = study_of(effect, replay), HIDDEN[effect]
    assert effect in {cause.effect for cause in study.verdict.causes}, study.verdict.summary
    value = np.array([cause.value for cause in study.verdict.causes if cause.effect == effect])
    assert np.linalg.norm(value - np.array(hidden.value)) < hidden.tolerance
    assert study.ranking[0].effect == effect or study.verdict.verdict is VerdictKind.CONFUSABLE


def test_a_healthy_robot_is_healthy(replay):
    verdict = study_of("healthy", replay).verdict
    assert verdict.verdict is VerdictKind.NOTHING_WRONG, verdict.summary


def test_friction_of_the_joints_is_not_named_as_the_cubes(replay):
    verdict = study_of(JOINTS, replay).verdict
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert verdict.follows
