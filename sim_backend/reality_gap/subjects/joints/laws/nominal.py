"""The model that a study of joints starts from."""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot
from sim_backend.reality_gap.measured.outliers import PEAK, usual_peak_nm
from sim_backend.reality_gap.subjects.joints.laws.motor_law import LIMIT
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.trifinger import constants as c

_TRIFINGER_INERTIA_KG_M2 = 7.65e-3
"""About its first joints, as its model has them (MuJoCo's ``dof_M0``)."""


def nominal_state(plant: Plant, torques_nm: Sequence[np.ndarray], robot: Robot, nominal: Mapping[str, np.ndarray]) -> JointState:
    """A robot's nominal model, with its size by its largest torque, and by the largest inertia of its joints.

    Args:
        plant: of the nominal model.
        torques_nm: that were sent in each episode, shapes (k, s), N m.
        robot: what is known of it; of a TriFinger its largest torque is.
        nominal: as for :func:`starting_values`.
    """
    if isinstance(robot, KnownTriFinger):
        limit, size, inertia_size = c.MAX_TORQUE_NM, 1.0, 1.0
    else:
        limit = largest_torque_nm(torques_nm)
        size = max(1.0, float(np.max(limit)) / c.MAX_TORQUE_NM)
        inertia_size = max(size, plant.largest_inertia_kg_m2 / _TRIFINGER_INERTIA_KG_M2)
    return JointState(plant.joints, starting_values(plant, limit, nominal), size, inertia_size)


def largest_torque_nm(torques_nm: Sequence[np.ndarray]) -> float:
    """The largest torque of any joint, shapes (k, s), though no more than a motor that often gives what it gives can peak at."""
    largest = 0.0
    for torque in np.concatenate(torques_nm, axis=1):
        peak, often = float(np.abs(torque).max()), PEAK * usual_peak_nm(torque)
        largest = max(largest, min(peak, often) if often > 0.0 else peak)
    return largest


def starting_values(plant: Plant, limit_nm: float, nominal: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of effects that a study starts from: the motors' limit, and nominal values on top of those in the model itself.

    Args:
        plant: of the nominal model, whose dry friction, damping and armature count.
        limit_nm: torque that no motor gave more of.
        nominal: by parameter, shape (k,), (1,) or (3,); NaN for a motor whose limit is not stated.
    """
    own = {key: values + nominal.get(key, 0.0) for key, values in plant.own_values.items() if values.any()}
    limits = nominal.get(LIMIT, np.full(plant.joints, np.nan))
    return {**nominal, **own, LIMIT: np.where(np.isnan(limits), limit_nm, limits)}
