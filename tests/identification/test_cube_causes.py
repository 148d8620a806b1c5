"""Effects on the cube and its tracker, hidden in pushing and resting logs of robots with small errors everywhere, are found.

The full test is ``python -m sim_backend.reality_gap.bench.cube``; here each effect is large and tried once.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from sim_backend.effects.physics import Physics
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
JOINTS = "coulomb_friction.torque_nm"


@pytest.fixture(scope="module")
def studies() -> dict[str, CubeStudy]:
    rows = [healthy_physics(np.random.default_rng([SEED, i]), 1) for i in range(len(HIDDEN) + 2)]
    for i, hidden in enumerate(HIDDEN.values()):
        rows[i] = rows[i].changed({hidden.key: [hidden.value] if isinstance(hidden.value, list) else hidden.value})
    rows[-1] = rows[-1].changed({JOINTS: np.full((1, 9), 0.03)})
    replay, found = PushReplay(), {}
    sessions = sessions_with_pushes(Physics.stack(rows), [SEED + i for i in range(len(rows))])
    for name, recordings in zip([*HIDDEN, "healthy", JOINTS], sessions, strict=True):
        found[name] = study_cube(recordings, np.random.default_rng(1), replay=replay)
    return found


@pytest.mark.parametrize("effect", HIDDEN)
def test_the_effect_is_named_and_its_size_is_right(effect, studies):
    verdict, hidden = studies[effect].verdict, HIDDEN[effect]
    assert effect in {cause.effect for cause in verdict.causes}, verdict.summary
    value = np.array([cause.value for cause in verdict.causes if cause.effect == effect])
    assert np.linalg.norm(value - np.array(hidden.value)) < hidden.tolerance
    assert studies[effect].ranking[0].effect == effect or verdict.verdict is VerdictKind.CONFUSABLE


def test_a_healthy_robot_is_healthy(studies):
    assert studies["healthy"].verdict.verdict is VerdictKind.NOTHING_WRONG, studies["healthy"].verdict.summary


def test_friction_of_the_joints_is_not_named_as_the_cubes(studies):
    assert studies[JOINTS].verdict.verdict is VerdictKind.UNEXPLAINED
    assert studies[JOINTS].verdict.follows
