"""The compiled callback writes only where there is what it expects."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from sim_backend.driver import native_control
from sim_backend.driver.robot_model import compile_robot, parameter_slots
from sim_backend.effects import record as r
from sim_backend.effects.physics import Physics

PHYSICS = Physics.of(1, {"coulomb_friction.torque_nm": 0.02, "load_friction.coefficient": 0.2})


def positions(disabled: int) -> np.ndarray:
    """Joint positions after 0.3 s with moving friction bounds, with some of MuJoCo's features disabled."""
    native_control.install()
    model = compile_robot(PHYSICS, physics_step_s=0.001)
    model.opt.disableflags |= disabled
    batch = Batch(model, 1, nthread=1)
    batch.bind("qpos")[0, :9] = np.tile([0.3, 0.8, -1.4], 3)
    slots = batch.bind("userdata")
    slots[0, r.CONTROL_SLOTS : r.FILTERED_VELOCITY] = parameter_slots(PHYSICS, np.zeros(1))[0]
    slots[0, [r.EFFECTS_ON, r.BOUNDS_ON]] = 1.0
    slots[0, r.STEP_S] = 0.001
    return batch.rollout(300, np.full((1, 300, 9), 0.15), record=("qpos",))["qpos"][0, -1, :9]


def test_bounds_count_the_same_whether_the_solver_sorts_by_islands_or_not():
    sorted_by_islands, in_order = positions(0), positions(int(mujoco.mjtDisableBit.mjDSBL_ISLAND))
    assert in_order == pytest.approx(sorted_by_islands, abs=1e-6)
    free = positions(int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS))
    assert np.abs(free - sorted_by_islands).max() > 1e-3, "without constraints of friction there is none, and nothing breaks"


@pytest.mark.parametrize("slots", [0, r.CONTROL_SLOTS, r.SMALLEST - 1])
def test_models_with_a_smaller_record_are_left_alone(slots: int):
    native_control.install()
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>")
    spec.nuserdata = slots
    for _ in range(2):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        body.add_geom(size=[0.1, 0, 0])
    data = mujoco.MjData(spec.compile())
    data.userdata[:] = 0.0
    if slots:
        data.userdata[r.EFFECTS_ON] = 1.0
    mujoco.mj_step(data.model, data)
    assert np.isfinite(data.qpos).all() and (data.userdata[2:] == 0.0).all()
