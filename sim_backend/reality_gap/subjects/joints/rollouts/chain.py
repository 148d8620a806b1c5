"""Joints of plain trees of bodies, simulated many times over by compiled code: the forward side of a fit by rollouts.

A fit simulates some hundred million steps of models of a few joints each, of which MuJoCo's general step spends most on what
these models lack. Here a link is six numbers of motion and ten of inertia, both in the frame that coincides with the world while
all joints are where the model has them at first (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6, with the
product of exponentials for the joints). Dry friction is a bounded impulse of each joint that stops what it can stop, or all that
a bearing holds which gives before it slips.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np

from sim_backend.reality_gap.subjects.joints.laws.motor_law import PLAY, ROTOR, SAG
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.rollouts.chain_steps import simulate

_AT_ONCE = 64
"""Simulations that a thread takes together."""


@dataclass(frozen=True)
class Bodies:
    """What each of m models makes of the bodies: masses (m, b), principal inertias (m, b, 3) and centres of mass (m, b, 3)."""

    mass_kg: np.ndarray
    inertia_kg_m2: np.ndarray
    centre_m: np.ndarray


@dataclass(frozen=True)
class ChainModels:
    """m models of k joints.

    Attributes:
        bodies: of each model.
        gravity_m_s2: shape (m, 3).
        armature, damping, stiffness, rest_rad: of each joint, shape (m, k).
        motors: values of the motor law, shape (m, k, p).
        offset_rad: what encoders report too much, shape (m, k).
        late_s: of what was recorded, or what a controller sends, shape (m, k).
        of_gain: share of its position gain that a controller has, shape (m, k).
        of_own_voltage: share of its own voltage that a motor has, which its torque constant makes, too, shape (m, k).
        give_rad, creep_rad_s: how far a bearing gives before it slips, and how fast it creeps before it does, shape (m, k).
    """

    bodies: Bodies
    gravity_m_s2: np.ndarray
    armature: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    rest_rad: np.ndarray
    motors: np.ndarray
    offset_rad: np.ndarray
    late_s: np.ndarray
    of_gain: np.ndarray
    of_own_voltage: np.ndarray
    give_rad: np.ndarray
    creep_rad_s: np.ndarray


@dataclass(frozen=True)
class Drives:
    """What drives w windows of s samples: recorded torques, and the law of a controller where it is known.

    Attributes:
        sent_nm: shape (w, s, k).
        feedback: by the fields of :class:`Feedback`, shape (7, w, lead + s, k), or (7, 1, 1, k) if none is known.
        is_known: joints that the controller drives, shape (k,).
        sample_s: between samples.
        held_steps: steps for which a controller holds its torque; 0 where it computes all the time.
        lead: samples before each window of which the feedback is known, too.
    """

    sent_nm: np.ndarray
    feedback: np.ndarray
    is_known: np.ndarray
    sample_s: float
    held_steps: int = 0
    lead: int = 0


class Chain:
    """The trees of a plant's joints, everything else at rest.

    Args:
        plant: whose model it is.
        step_s: of the simulation.
        substeps: steps to a sample.
    """

    def __init__(self, plant: Plant, step_s: float, substeps: int) -> None:
        self._step_s, self._substeps = step_s, substeps
        model = plant.forward_model()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        every = sorted(range(plant.joints), key=lambda j: plant.joint_ids[j])  # parents before children
        self._whole = _Tree(plant, model, data, every)
        roots = _roots(self._whole.parent)
        self._trees = [_Tree(plant, model, data, [every[i] for i in np.flatnonzero(roots == root)]) for root in np.unique(roots)]

    def positions(
        self,
        drives: Drives,
        begin_rad: np.ndarray,
        begin_rad_s: np.ndarray,
        models: ChainModels,
        window: np.ndarray,
        which: np.ndarray,
        begin_k: np.ndarray,
    ) -> np.ndarray:
        """Reported positions after each sample, shape (n, s, k); of a tree whose simulation diverges they are not finite.

        Trees do not feel each other, unless their motors' supply sags: a change of one leaves the others as they were, so what
        would be simulated twice is simulated once.

        Args:
            drives: of all windows.
            begin_rad: where each simulation begins, as reported, shape (n, k).
            begin_rad_s: how fast it moves there, shape (n, k).
            models: to simulate with.
            window: of each simulation, shape (n,).
            which: model of each simulation, shape (n,).
            begin_k: how much warmer its motors are than their surroundings at first, shape (n, k).
        """
        begins = np.stack([begin_rad, begin_rad_s, begin_k], axis=1)
        found = np.empty((len(window), drives.sent_nm.shape[1], begin_rad.shape[1]))
        is_one = len(self._trees) == 1 or bool((models.motors[:, :, SAG] != 0.0).any())
        for tree in [self._whole] if is_one else self._trees:
            o, of_models = tree.order, tree.of(models)
            if is_one:
                found[:, :, o] = self._simulated(tree, drives, of_models, begins[:, :, o], window, which)
                continue
            alike = _numbered(np.concatenate([part.reshape(len(part), -1) for part in of_models], axis=1))[1][which]
            first, again = _numbered(np.column_stack([window, alike, begins[:, :, o].reshape(len(window), -1)]))
            went = self._simulated(tree, drives, of_models, begins[first][:, :, o], window[first], which[first])
            found[:, :, o] = went[again]
        return found

    def _simulated(
        self,
        tree: "_Tree",
        drives: Drives,
        of_models: tuple[np.ndarray, ...],
        begins: np.ndarray,
        window: np.ndarray,
        which: np.ndarray,
    ) -> np.ndarray:
        inertias, gravity, joints, motors = of_models
        o, sent = tree.order, drives.sent_nm[:, :, tree.order]
        arrays = (
            *(
                np.ascontiguousarray(x)
                for x in (sent, _sums(sent), drives.feedback[..., o], drives.is_known[o], inertias, gravity)
            ),
            np.ascontiguousarray(joints.swapaxes(0, 1)),
            *(np.ascontiguousarray(x) for x in (motors, tree.parent, tree.axis, tree.anchor, tree.slides, tree.first)),
        )
        begins = np.ascontiguousarray(begins)
        found = np.full((len(window), drives.sent_nm.shape[1], len(o)), np.nan)
        settings = (self._step_s, self._substeps, drives.sample_s, drives.held_steps, drives.lead)

        steps = simulate()  # compiled before threads ask for it

        def run(rows: slice) -> None:
            steps(*arrays, *settings, begins[rows], window[rows], which[rows], found[rows])

        if len(window) <= _AT_ONCE:
            run(slice(None))  # most fits ask for no more: to begin a thread takes as long as a short simulation
            return found
        parts = [slice(i, i + _AT_ONCE) for i in range(0, len(window), _AT_ONCE)]
        with ThreadPoolExecutor() as threads:
            list(threads.map(run, parts))
        return found


class _Tree:
    """Joints that feel each other, or all there are, parents before children.

    Args:
        plant: whose joints they are.
        model: compiled, without what does not move them.
        data: of the model where joints are at first.
        order: of its joints, as indices of the plant's.
    """

    def __init__(self, plant: Plant, model: mujoco.MjModel, data: mujoco.MjData, order: Sequence[int]) -> None:
        self.order = np.array(order)
        ids = [plant.joint_ids[j] for j in order]
        link_of = _link_of_bodies(model, ids)
        self._members = [np.flatnonzero(link_of == i) for i in range(len(ids))]
        self.parent = np.array([_link_before(model, joint, ids, link_of) for joint in ids])
        self.axis, self.anchor = data.xaxis[ids].copy(), data.xanchor[ids].copy()
        self.slides = model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        self.first = model.qpos0[plant.positions[order]].copy()
        self._place, self._turn = data.xpos.copy(), data.xmat.reshape(-1, 3, 3).copy()
        self._principal = data.ximat.reshape(-1, 3, 3).copy()

    def of(self, models: ChainModels) -> tuple[np.ndarray, ...]:
        """What models make of the tree: inertias (m, k, 10), gravity (m, 3), numbers of joints (m, 12, k), motors (m, k, p)."""
        m, o, motors = models, self.order, models.motors.copy()
        play, rotor = m.motors[:, :, PLAY], np.where(m.armature > 0.0, m.armature, m.motors[:, :, ROTOR])
        motors[:, :, PLAY] = 0.0  # here rotors with play are bodies of their own
        controllers = [m.offset_rad, m.late_s, m.of_gain, m.of_own_voltage]
        own = [m.armature, m.damping, m.stiffness, m.rest_rad, *controllers, play, rotor, m.give_rad, m.creep_rad_s]
        return self._inertias(m.bodies), m.gravity_m_s2, np.stack(own, axis=1)[:, :, o], motors[:, o]

    def _inertias(self, bodies: Bodies) -> np.ndarray:
        """Mass, mass times centre, and the six moments about the origin of each link, shape (m, k, 10)."""
        found = np.zeros((len(bodies.mass_kg), len(self._members), 10))
        for i, members in enumerate(self._members):
            for body in members:
                mass = bodies.mass_kg[:, body]
                centre = self._place[body] + bodies.centre_m[:, body] @ self._turn[body].T
                turn = self._principal[body]
                about = np.einsum("ab,mb,cb->mac", turn, bodies.inertia_kg_m2[:, body], turn)
                square = (centre**2).sum(axis=1)[:, None, None] * np.eye(3) - centre[:, :, None] * centre[:, None, :]
                about += mass[:, None, None] * square
                found[:, i, 0] += mass
                found[:, i, 1:4] += mass[:, None] * centre
                found[:, i, 4:] += about[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return found


def is_plain(model: mujoco.MjModel) -> bool:
    """Whether nothing acts on a model's joints but gravity, springs, dampers, friction and motors."""
    flags = mujoco.mjtDisableBit
    off = int(flags.mjDSBL_SPRING) | int(flags.mjDSBL_DAMPER) | int(flags.mjDSBL_GRAVITY)
    acts = (
        *(model.tendon_stiffness, model.tendon_damping, model.tendon_armature, model.body_gravcomp),
        *(getattr(model, name) for name in ("jnt_stiffnesspoly", "dof_dampingpoly") if hasattr(model, name)),
    )
    is_dry = float(model.opt.density) == 0.0 == float(model.opt.viscosity)
    return is_dry and not model.nflex and not (int(model.opt.disableflags) & off) and not any(np.any(x) for x in acts)


def _numbered(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of rows, those that differ, as the indices of the first ones; and which of these each row is."""
    rows = np.ascontiguousarray(rows, float)
    same = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1])))[:, 0]
    _, first, again = np.unique(same, return_index=True, return_inverse=True)
    return first, again


def _roots(parent: np.ndarray) -> np.ndarray:
    """The first joint of each joint's tree; parents come before children."""
    found = np.arange(len(parent))
    for i, before in enumerate(parent):
        found[i] = i if before < 0 else found[before]
    return found


def _sums(sent: np.ndarray) -> np.ndarray:
    """Of what was sent before each sample, shape (w, s + 1, k)."""
    return np.concatenate([np.zeros_like(sent[:, :1]), np.cumsum(sent, axis=1)], axis=1)


def _link_of_bodies(model: mujoco.MjModel, ids: Sequence[int]) -> np.ndarray:
    """The last of some joints that moves each body, as an index into them; -1 for bodies that rest."""
    found = np.full(model.nbody, -1)
    for body in range(1, model.nbody):
        first = int(model.body_jntadr[body])
        own = [joint for joint in range(first, first + int(model.body_jntnum[body])) if joint in ids]
        found[body] = ids.index(own[-1]) if own else found[model.body_parentid[body]]
    return found


def _link_before(model: mujoco.MjModel, joint: int, ids: Sequence[int], link_of: np.ndarray) -> int:
    """The joint that moves a joint's anchor; -1 if none does."""
    body = int(model.jnt_bodyid[joint])
    same = [other for other in ids if other < joint and int(model.jnt_bodyid[other]) == body]
    return ids.index(same[-1]) if same else int(link_of[model.body_parentid[body]])
