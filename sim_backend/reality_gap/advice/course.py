"""An excitation as numbers for a robot elsewhere: how far, how fast, how long, and its position targets as a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.excitations.course import COMMAND_S, Sight, command_times_s, commands
from sim_backend.excitations.excitation import EXCITATIONS, RAISED_RAD
from sim_backend.trifinger import constants as c

WAY_UP_S = 1.5
"""How long a TriFinger takes from its start to the pose about which the motions of an excitation go."""
FOREIGN_SHARE = 0.5
"""Share of half a foreign joint's range that its motion takes: a caution, as nothing is known of what stands around the robot."""
FREE_REACH_RAD = 0.5
"""To either side, for a foreign joint without a range."""
_UNSEEN = Sight(np.zeros(9), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


class NoFixedCourseError(ValueError):
    """The excitation follows what is seen, so that there is no table of targets."""


@dataclass(frozen=True)
class Targets:
    """Commands on a grid of 10 ms.

    Attributes:
        joint_names: k of them.
        time_s: when each command begins, shape (m,).
        position_rad: targets, shape (m, k), rad, or m for a slide joint.
        torque_nm: to be added to the position controller's torque, shape (m, k), N m; None if there is none.
    """

    joint_names: tuple[str, ...]
    time_s: np.ndarray
    position_rad: np.ndarray
    torque_nm: np.ndarray | None

    @property
    def amplitude_rad(self) -> float:
        """Half the way of the joint that goes farthest."""
        return float(np.ptp(self.position_rad, axis=0).max() / 2)

    @property
    def speed_rad_s(self) -> float:
        """Of the quickest joint."""
        return float(np.abs(np.diff(self.position_rad, axis=0)).max() / COMMAND_S)

    @property
    def push_nm(self) -> float:
        """Largest torque beside that of the position controller."""
        return 0.0 if self.torque_nm is None else float(np.abs(self.torque_nm).max())


def targets(name: str, rng: np.random.Generator) -> Targets:
    """What an excitation commands a TriFinger.

    Raises:
        NoFixedCourseError: it depends on what the tracker sees.
    """
    if name == "slide_cube":
        fixed = ", ".join(other for other in EXCITATIONS if other != name)
        raise NoFixedCourseError(
            f"{name} follows the cube that the tracker sees, so that it has no table of targets; choose from {fixed}"
        )
    course = EXCITATIONS[name].course(rng)
    command, _ = next(course)
    sent = [command]
    while True:
        try:
            command, _ = course.send(_UNSEEN)
        except StopIteration:
            break
        sent.append(command)
    torque = np.concatenate([command.desired_torque_nm for command in sent])
    position = np.array([command.position_target_rad[0] for command in sent if command.position_target_rad is not None])
    return Targets(c.JOINT_NAMES, command_times_s(len(sent) * COMMAND_S), position, torque if torque.any() else None)


def targets_for(model: mujoco.MjModel, name: str, rng: np.random.Generator) -> Targets:
    """The same motion about the middle of the range of every hinge and slide joint of another robot's model.

    Each joint moves over a share of its own range in the excitation's own time, so that frequencies stay and speeds scale. The
    pushes are left out: which torque another motor may take is not known here.

    Raises:
        NoFixedCourseError: as for :func:`targets`.
        ValueError: the model has no such joint.
    """
    movable = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in movable]
    if not joints:
        raise ValueError("the model has no hinge or slide joint")
    motion = targets(name, rng).position_rad[commands(WAY_UP_S) :] - np.tile(RAISED_RAD, 3)
    shape = motion / np.maximum(np.abs(motion).max(axis=0), 1e-9)
    limited = model.jnt_limited[joints].astype(bool)
    middle = np.where(limited, model.jnt_range[joints].mean(axis=1), model.qpos0[model.jnt_qposadr[joints]])
    reach = np.where(limited, FOREIGN_SHARE * np.ptp(model.jnt_range[joints], axis=1) / 2, FREE_REACH_RAD)
    columns = shape[:, np.arange(len(joints)) % shape.shape[1]]
    names = tuple(model.joint(j).name or f"joint{j}" for j in joints)
    return Targets(names, command_times_s(len(shape) * COMMAND_S), middle + reach * columns, None)


def write_csv(table: Targets, path: Path) -> None:
    """Columns ``time_s``, one of the joint's name for each joint's target, and ``JOINT_torque_nm`` where there are pushes."""
    columns: list[np.ndarray] = [table.time_s[:, None], table.position_rad]
    names: Sequence[str] = ("time_s", *table.joint_names)
    if table.torque_nm is not None:
        columns.append(table.torque_nm)
        names = (*names, *(f"{joint}_torque_nm" for joint in table.joint_names))
    np.savetxt(path, np.hstack(columns), fmt="%.6f", delimiter=",", header=",".join(names), comments="")
