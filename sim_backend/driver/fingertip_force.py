"""What the push sensors in the fingertips show: the pressure on each tip, from the contacts of the present state."""

from collections.abc import Sequence

import mujoco
import numpy as np

from sim_backend.driver.physics_batch import BackendError, PhysicsBatch
from sim_backend.effects import record as r
from sim_backend.trifinger import constants as c

_TIPS = tuple(f"{finger}_tip" for finger in c.FINGER_NAMES)


def fingertip_force(batch: PhysicsBatch, models: Sequence[mujoco.MjModel]) -> np.ndarray:
    """Readings of the sensors of n robots, shape (n, 3), from 0 to 1 and without a unit.

    The sum of the normal forces of all contacts of a tip, over the force at which the sensor saturates, plus what it shows when
    nothing is touched (TS sim_finger.py).

    Args:
        batch: the simulations, which stay as they are.
        models: one for each.

    Raises:
        BackendError: the batch cannot give a whole simulation.
    """
    get_data = getattr(batch, "get_data", None)
    if get_data is None:
        raise BackendError("fingertip_force cannot be had on this physics back end; leave it out of the observation, or use cpu")
    pressed_n = np.stack([_pressed_n(model, get_data(robot)) for robot, model in enumerate(models)])
    return np.clip(pressed_n / c.TIP_SENSOR_SATURATION_N + c.TIP_SENSOR_AT_REST, 0.0, 1.0)


def _pressed_n(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Normal forces on the tips, shape (3,), N; ``data`` is a copy, in which the control callback is kept from acting again."""
    data.userdata[[r.SAFETY_ON, r.EFFECTS_ON]] = 0.0
    mujoco.mj_forward(model, data)
    tips = {model.geom(name).id: index for index, name in enumerate(_TIPS)}
    pressed_n, wrench = np.zeros(len(_TIPS)), np.zeros(6)
    for index in range(data.ncon):
        geoms = data.contact.geom[index]
        touched = [tips[geom] for geom in geoms.tolist() if geom in tips]
        if touched:
            mujoco.mj_contactForce(model, data, index, wrench)
            pressed_n[touched] += wrench[0]
    return pressed_n
