"""The joints of a MuJoCo model as a plant: what torques a motion needs, and how that depends on masses, gravity and pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS

_ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
ARM_M = 0.1
"""What a slide moves for each radian that it is counted as."""


@dataclass(frozen=True)
class InverseDynamics:
    """What torques a motion needs, and its derivatives; all of shape (s, k) or (s, k, ...), N m and per unit.

    Attributes:
        torque_nm: shape (s, k).
        by_link_mass: by the factor of mass and inertia of the link behind joint l, shape (s, k, k).
        by_gravity: by each axis of the gravity vector, shape (s, k, 3).
        by_position: by the position of joint l, shape (s, k, k).
        by_acceleration: by the acceleration of joint l, shape (s, k, k), kg m^2.
    """

    torque_nm: np.ndarray
    by_link_mass: np.ndarray
    by_gravity: np.ndarray
    by_position: np.ndarray
    by_acceleration: np.ndarray


@dataclass(frozen=True)
class LinkDerivatives:
    """What torques for a motion owe to the shape of the links, N m.

    Attributes:
        by_inertia: by a share of the inertia of the link behind joint l about its centre of mass, shape (s, k, k).
        by_centre: by a move of that centre along each axis of the link's body, shape (s, k, k, 3), N m/m.
    """

    by_inertia: np.ndarray
    by_centre: np.ndarray


class Plant:
    """k joints of a model, without contacts, limits and friction; everything else of the model rests.

    Damping and armature of the model are in its torques, dry friction is not: MuJoCo makes a constraint of it.

    Args:
        model: any compiled model; it is copied.
        names: the joints that were recorded, all hinges or slides.
    """

    def __init__(self, model: mujoco.MjModel, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._model = _without_constraints(model)
        joints = self._joint_ids = [self._model.joint(name).id for name in names]
        wrong = [name for name, j in zip(names, joints, strict=True) if int(self._model.jnt_type[j]) not in _ONE_DOF]
        if wrong:
            raise ValueError(f"{', '.join(wrong)} is neither a hinge nor a slide; only those can be studied as joints")
        self._unchanged = model
        self._q, self._v = self._model.jnt_qposadr[joints], self._model.jnt_dofadr[joints]
        self._links = [_rigid_with(self._model, int(self._model.jnt_bodyid[j])) for j in joints]
        limited = self._model.jnt_limited[joints].astype(bool)
        self.range_rad = np.where(limited[:, None], self._model.jnt_range[joints], [[-np.inf, np.inf]])
        """Ends of each joint, shape (k, 2); infinite where there are none."""
        self.is_slide = self._model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        """Which of them slide, shape (k,)."""
        self.groups = _groups(self._model.dof_treeid[self._v])
        """Joints of different trees, which do not feel each other and may be probed together."""
        self._tree = self._model.dof_treeid[self._v]
        self.resting = _resting(self._model, joints)
        """Joints of the same trees that were not recorded, taken to rest where the model has them at first."""
        self.own_values = {
            key: getattr(model, number.model_field)[self._v].copy() for key, number in NUMBERS.items() if number.model_field
        }
        """What the model itself says of its joints that are effects' values, too, by "effect.parameter", shape (k,)."""

    @property
    def joints(self) -> int:
        """How many."""
        return len(self.names)

    @property
    def is_sprung(self) -> bool:
        """Whether the model has a spring at any joint."""
        return bool(self._model.jnt_stiffness[self._joint_ids].any())

    @property
    def largest_inertia_kg_m2(self) -> float:
        """Of any joint, where the model has them at first."""
        return float(self._model.dof_M0[self._v].max())

    @property
    def positions(self) -> np.ndarray:
        """Where the joints are in the model's ``qpos``, shape (k,)."""
        return self._q

    @property
    def velocities(self) -> np.ndarray:
        """Where the joints are in the model's ``qvel``, shape (k,)."""
        return self._v

    @property
    def joint_ids(self) -> list[int]:
        """Of the joints in the model."""
        return self._joint_ids

    @property
    def links(self) -> list[list[int]]:
        """Bodies of the link behind each joint."""
        return self._links

    def heaviest_of(self, joint: int) -> int:
        """The heaviest body of a joint's link: where its centre of mass is moved."""
        return _heaviest(self._model, self._links[joint])

    def centre_share(self, joint: int) -> float:
        """How far that body's centre moves for each metre of the link's."""
        mass = self._model.body_mass
        return float(mass[self._links[joint]].sum() / max(float(mass[self.heaviest_of(joint)]), 1e-12))

    def forward_model(self) -> mujoco.MjModel:
        """A copy to simulate: with dry friction, without contacts, limits, equalities, tendons' friction and actuators.

        What diverges stays so, and does not begin anew.
        """
        copy = mujoco.MjModel.__copy__(self._unchanged)
        for flag in ("CONTACT", "LIMIT", "EQUALITY", "ACTUATION", "AUTORESET"):
            copy.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
        copy.tendon_frictionloss[:] = 0.0
        copy.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return copy

    @property
    def gravity_m_s2(self) -> np.ndarray:
        """Nominal gravity, shape (3,)."""
        return self._model.opt.gravity.copy()

    def root(self) -> tuple[int, np.ndarray] | None:
        """The joint that turns all others, and its axis, shape (3,), in the world; None if several do, or if it slides."""
        model, first = self._model, 0
        carried = {int(model.jnt_bodyid[first])}
        for body in range(min(carried) + 1, model.nbody):
            if int(model.body_parentid[body]) in carried:
                carried.add(body)
        is_hinge = int(model.jnt_type[first]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        if first not in self._joint_ids or not is_hinge or not carried.issuperset(map(int, model.jnt_bodyid)):
            return None
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return self._joint_ids.index(first), data.xaxis[first].copy()

    def same_tree(self, joint: int) -> np.ndarray:
        """Which joints feel a joint, shape (k,)."""
        return self._tree == self._tree[joint]

    def torque_nm(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Torques for a motion; shapes (s, k) in rad, rad/s, rad/s^2 and N m."""
        return self._torque(self._model, position, velocity, acceleration)

    def load_nm(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """What gravity and motion ask of the joints, as MuJoCo's ``qfrc_bias``; shapes (s, k) in rad, rad/s and N m."""
        return self._torque(self._model, position, velocity, np.zeros_like(velocity), "qfrc_bias")

    def derivatives(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> InverseDynamics:
        """Torques for a motion and what they depend on; shapes (s, k)."""
        motion, k = (position, velocity, acceleration), self.joints
        base = self.torque_nm(*motion)
        mass, pose, inertia = (np.zeros((*base.shape, k)) for _ in range(3))
        for group in self.groups:
            model = mujoco.MjModel.__copy__(self._model)
            shifted, faster = position.copy(), acceleration.copy()
            for j in group:
                model.body_mass[self._links[j]] *= 2.0
                model.body_inertia[self._links[j]] *= 2.0
                shifted[:, j] += _POSITION_STEP
                faster[:, j] += 1.0
            for target, change in (
                (mass, self._torque(model, *motion) - base),
                (pose, (self.torque_nm(shifted, velocity, acceleration) - base) / _POSITION_STEP),
                (inertia, self.torque_nm(position, velocity, faster) - base),
            ):
                for j in group:
                    target[:, :, j] = np.where(self.same_tree(j), change, 0.0)
        gravity = np.zeros((*base.shape, 3))
        for axis in range(3):
            model = mujoco.MjModel.__copy__(self._model)
            model.opt.gravity[axis] += 1.0
            gravity[:, :, axis] = self._torque(model, *motion) - base
        return InverseDynamics(base, mass, gravity, pose, inertia)

    @property
    def centre_distance_m(self) -> np.ndarray:
        """How far the centre of mass of the link behind each joint is from the joint's axis or, if further, its anchor; (k,)."""
        model, found = self._model, []
        for j, links in zip(self._joint_ids, self._links, strict=True):
            found.append(float(np.linalg.norm(model.body_ipos[_heaviest(model, links)] - model.jnt_pos[j])))
        return np.array(found)

    def link_derivatives(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> LinkDerivatives:
        """What torques for a motion owe to inertia and centre of mass of each link; shapes (s, k)."""
        motion, k = (position, velocity, acceleration), self.joints
        base = self.torque_nm(*motion)
        inertia, centre = np.zeros((*base.shape, k)), np.zeros((*base.shape, k, 3))
        for group in self.groups:
            model = mujoco.MjModel.__copy__(self._model)
            for j in group:
                model.body_inertia[self._links[j]] *= 2.0
            change = self._torque(model, *motion) - base
            for j in group:
                inertia[:, :, j] = np.where(self.same_tree(j), change, 0.0)
            for axis in range(3):
                model = mujoco.MjModel.__copy__(self._model)
                for j in group:
                    model.body_ipos[self.heaviest_of(j), axis] += _CENTRE_STEP_M * self.centre_share(j)
                change = (self._torque(model, *motion) - base) / _CENTRE_STEP_M
                for j in group:
                    centre[:, :, j, axis] = np.where(self.same_tree(j), change, 0.0)
        return LinkDerivatives(inertia, centre)

    def _torque(
        self,
        model: mujoco.MjModel,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        field: str = "qfrc_inverse",
    ) -> np.ndarray:
        data = mujoco.MjData(model)
        out = np.empty_like(position)
        q, v = self._q, self._v
        qpos, qvel, qacc, found = data.qpos, data.qvel, data.qacc, getattr(data, field)  # to look them up costs more than a step
        for row in range(len(position)):
            qpos[q], qvel[v], qacc[v] = position[row], velocity[row], acceleration[row]
            mujoco.mj_inverse(model, data)
            out[row] = found[v]
        return out


_POSITION_STEP = 1e-4  # rad or m
_CENTRE_STEP_M = 1e-4


def _heaviest(model: mujoco.MjModel, links: Sequence[int]) -> int:
    return max(links, key=lambda body: float(model.body_mass[body]))


def _without_constraints(model: mujoco.MjModel) -> mujoco.MjModel:
    copy = mujoco.MjModel.__copy__(model)
    copy.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    copy.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    copy.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    return copy


def _rigid_with(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and those that hang on it without a joint."""
    found = [body]
    for other in range(body + 1, model.nbody):
        if model.body_parentid[other] in found and model.body_jntnum[other] == 0:
            found.append(other)
    return found


def _resting(model: mujoco.MjModel, joints: Sequence[int]) -> tuple[str, ...]:
    """Joints that were not recorded, but hang together with those that were."""
    trees = {int(model.dof_treeid[model.jnt_dofadr[j]]) for j in joints}
    others = [j for j in range(model.njnt) if j not in joints and int(model.dof_treeid[model.jnt_dofadr[j]]) in trees]
    return tuple(model.joint(j).name or f"joint {j}" for j in others)


def _groups(trees: np.ndarray) -> list[list[int]]:
    """The i-th joints of all trees together."""
    members = [list(np.flatnonzero(trees == tree)) for tree in dict.fromkeys(trees.tolist())]
    return [[int(m[i]) for m in members if i < len(m)] for i in range(max(map(len, members)))]
