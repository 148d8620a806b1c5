"""What masses, springs, dampers, gravity and encoders change in the torques that a motion needs: each law and its image."""

import functools
from collections.abc import Callable, Mapping

import numpy as np

from sim_backend.effects.body import seen_from_tilted_table
from sim_backend.reality_gap.subjects.joints.laws.plant import InverseDynamics, LinkDerivatives
from sim_backend.reality_gap.subjects.joints.laws.state import LINK_CENTRES, LINK_INERTIA, JointState, Term
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory

_MASS, _GRAVITY, _OFFSET = "link_mass.factor", "gravity.offset_m_s2", "encoder_offset.offset_rad"
_ROLL, _PITCH = "table_tilt.roll_rad", "table_tilt.pitch_rad"
_ARMATURE, _DAMPING = "rotor_inertia.armature_kg_m2", "viscous_friction.damping_nm_s_rad"
_STIFFNESS, _REST = "joint_stiffness.stiffness_nm_rad", "joint_stiffness.reference_rad"
KEYS = frozenset({_MASS, _GRAVITY, _OFFSET, _ROLL, _PITCH, _ARMATURE, _DAMPING, _STIFFNESS, LINK_INERTIA, *LINK_CENTRES})
"""Numbers that have an image here."""


class BodyLaw:
    """The bodies along one episode of k joints and t rows.

    Args:
        dynamics: inverse dynamics of the nominal model along it.
        path: the smoothed episode.
        own_values: what the nominal model's dynamics contain of effects' values, by "effect.parameter", shape (k,).
        gravity_m_s2: nominal, shape (3,).
        links: gives what torques owe to inertia and centres of links, where somebody asks.
    """

    def __init__(
        self,
        dynamics: InverseDynamics,
        path: Trajectory,
        own_values: Mapping[str, np.ndarray],
        gravity_m_s2: np.ndarray,
        links: Callable[[], LinkDerivatives],
    ) -> None:
        self._dynamics, self._path, self._own, self._gravity_m_s2 = dynamics, path, own_values, gravity_m_s2
        self._links = functools.cache(links)
        self._by_tilt = tilt_images(dynamics.by_gravity, gravity_m_s2)

    def needed_nm(self, state: JointState, acceleration: np.ndarray, play: np.ndarray) -> np.ndarray:
        """Torques that the motion needs, shape (t, k), N m.

        Args:
            state: the present model.
            acceleration: of the joints, as reported or smoothed, shape (t, k), rad/s^2.
            play: how far rotors are ahead of their links, smoothed, shape (t, k), rad.
        """
        d, path = self._dynamics, self._path
        torque = d.torque_nm + np.einsum("tkl,tl->tk", d.by_acceleration, acceleration - path.acceleration)
        torque += np.einsum("tkl,l->tk", d.by_link_mass, state.value(_MASS) - 1.0)
        torque += (state.value(_ARMATURE) - self._own[_ARMATURE]) * acceleration
        torque += (state.value(_DAMPING) - self._own[_DAMPING]) * path.velocity
        torque += state.value(_STIFFNESS) * (path.position - state.value(_REST))
        torque += np.einsum("tkg,g->tk", d.by_gravity, self._gravity(state) - self._gravity_m_s2)
        torque -= np.einsum("tkl,tl->tk", d.by_position, encoder_offsets_rad(state) + play)
        if play.any():
            step_s = path.step_s * path.every
            torque -= np.einsum("tkl,tl->tk", d.by_acceleration, np.gradient(np.gradient(play, step_s, axis=0), step_s, axis=0))
        return torque

    def _gravity(self, state: JointState) -> np.ndarray:
        """Shape (3,)."""
        return gravity_of(state, self._gravity_m_s2)

    def image(self, state: JointState, term: Term) -> np.ndarray:
        """What a unit of a term adds to the mechanics, shape (t, k).

        Raises:
            KeyError: the term is none of :data:`KEYS`.
        """
        d, path, j = self._dynamics, self._path, term.index
        if term.key == LINK_INERTIA or term.key in LINK_CENTRES:
            return self._link_image(term)
        own = np.zeros_like(path.position)
        if term.key == _MASS:
            return d.by_link_mass[:, :, j]
        if term.key == _GRAVITY:
            return d.by_gravity[:, :, j]
        if term.key in (_ROLL, _PITCH):
            return self._by_tilt[:, :, (_ROLL, _PITCH).index(term.key)]
        if term.key == _OFFSET:
            return -d.by_position[:, :, j]
        if term.key == _ARMATURE:
            own[:, j] = path.acceleration[:, j]
        if term.key == _DAMPING:
            own[:, j] = path.velocity[:, j]
        if term.key not in KEYS:
            raise KeyError(f"{term.key} has no law of bodies")
        if term.key == _STIFFNESS:
            own[:, j] = path.position[:, j] - dict(term.shape).get(_REST, state.value(_REST)[j])
        return own

    def _link_image(self, term: Term) -> np.ndarray:
        links = self._links()
        if term.key == LINK_INERTIA:
            return links.by_inertia[:, :, term.index]
        return links.by_centre[:, :, term.index, LINK_CENTRES.index(term.key)]

    def play_image(self, play: np.ndarray, joint: int) -> np.ndarray:
        """What a joint's play adds to the mechanics, shapes (t,) rad and (t, k) N m."""
        d, row_s = self._dynamics, self._path.step_s * self._path.every
        faster = np.gradient(np.gradient(play, row_s), row_s)
        return d.by_position[:, :, joint] * play[:, None] + d.by_acceleration[:, :, joint] * faster[:, None]


def gravity_of(state: JointState, gravity_m_s2: np.ndarray) -> np.ndarray:
    """What a model makes of nominal gravity, shape (3,), m/s^2."""
    return tilted_gravity(gravity_m_s2, float(state.value(_ROLL)[0]), float(state.value(_PITCH)[0])) + state.value(_GRAVITY)


def encoder_offsets_rad(state: JointState) -> np.ndarray:
    """By how much the encoders of a model report too much, shape (k,), rad."""
    return state.value(_OFFSET)


_STEP_RAD = 1e-4


def tilted_gravity(gravity_m_s2: np.ndarray, roll_rad: float, pitch_rad: float) -> np.ndarray:
    """Gravity in the frame of a tilted table, shape (3,), m/s^2."""
    return seen_from_tilted_table(gravity_m_s2, roll_rad, pitch_rad)


def tilt_images(by_gravity: np.ndarray, gravity_m_s2: np.ndarray) -> np.ndarray:
    """What small tilts do to torques: by axes of gravity, shape (t, k, 3), to by roll and pitch, shape (t, k, 2), N m/rad."""
    changes = [
        (tilted_gravity(gravity_m_s2, roll_rad, pitch_rad) - gravity_m_s2) / _STEP_RAD
        for roll_rad, pitch_rad in ((_STEP_RAD, 0.0), (0.0, _STEP_RAD))
    ]
    return np.stack([by_gravity @ change for change in changes], axis=2)
