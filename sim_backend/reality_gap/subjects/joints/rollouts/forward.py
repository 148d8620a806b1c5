"""Forward simulation of an extended model over windows of recordings: where would this robot have gone?

Many windows under many models run together, in the loop in which the data were made: where it is known what turned position
targets into torque that law acts on the simulated motion, otherwise the recorded torques do. Laws between torque and joint are
those of the equations (``motor_law``). Models of bodies, springs and dampers alone run in ``chain``, all others in MuJoCo, where
dry friction is its own constraint; a test holds both to each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from sim_backend.driver.native_control import silence_warnings
from sim_backend.effects.friction import make_stiff
from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.joint_effects import POSITION_GAIN, TORQUE_CONSTANT
from sim_backend.reality_gap.knowledge.unnamed_laws import BRAKING, CREEP, GIVE
from sim_backend.reality_gap.subjects.joints.laws.body_law import gravity_of
from sim_backend.reality_gap.subjects.joints.laws.motor_law import in_simulations
from sim_backend.reality_gap.subjects.joints.laws.past import Past, warming, warms
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, LINK_CENTRES, LINK_INERTIA, JointState, values_of
from sim_backend.reality_gap.subjects.joints.rollouts.chain import Bodies, Chain, ChainModels, Drives, is_plain

LONGEST_STEP_S, LONGEST_IN_LOOP_S = 0.0025, 0.001
"""Of a simulation; shorter where a controller is in the loop, which sees a motion a step late."""
HELD_KG_M2 = 1e6
"""Armature of joints that were not recorded: they rest."""
_MOST_SIMULATIONS = 6000


@dataclass(frozen=True)
class Windows:
    """n stretches of recordings, of s samples each, of k joints.

    Attributes:
        step_s: between samples.
        position_rad: as reported after each sample's time, shape (n, s, k).
        begin_rad, begin_rad_s: where and how fast the joints were at the begin, as reported, shape (n, k).
        sent_nm: what was sent from each sample to the next, shape (n, s, k).
        feedback: what made it of position targets, arrays of shape (n, lead + s, k); None if that is of no joint known.
        owner: recording of each window, shape (n,).
        past: what drove the joints before each window; None where they begin cold.
        lead: samples before each window of which the feedback is known, too: targets may come late.
    """

    step_s: float
    position_rad: np.ndarray
    begin_rad: np.ndarray
    begin_rad_s: np.ndarray
    sent_nm: np.ndarray
    feedback: Feedback | None
    owner: np.ndarray
    past: Past | None = None
    lead: int = 0

    def __len__(self) -> int:
        return len(self.begin_rad)

    def some(self, index: np.ndarray) -> "Windows":
        """Those of some indices, which may come more than once."""
        feedback = None if self.feedback is None else self.feedback.at(index)
        position, begin, speed, sent = (a[index] for a in (self.position_rad, self.begin_rad, self.begin_rad_s, self.sent_nm))
        past = None if self.past is None else self.past.some(index)
        return Windows(self.step_s, position, begin, speed, sent, feedback, self.owner[index], past, self.lead)


class Forward:
    """Simulates windows, without contacts, ends of joints and the model's own actuators.

    Args:
        plant: whose model it is.
        step_s: between samples.
        held_s: for which a controller holds its torque; 0 where it computes all the time.
        longest_step_s: of the simulation.
    """

    def __init__(self, plant: Plant, step_s: float, *, held_s: float = 0.0, longest_step_s: float = LONGEST_STEP_S) -> None:
        self._plant = plant
        self._substeps = int(np.ceil(step_s / longest_step_s - 1e-9))
        self._model = plant.forward_model()
        self._model.opt.timestep = step_s / self._substeps
        self._held_steps = max(1, round(held_s / self._model.opt.timestep)) if held_s > 0.0 else 0
        self._model.dof_armature[np.setdiff1d(np.arange(self._model.nv), plant.velocities)] = HELD_KG_M2
        make_stiff(self._model, plant.velocities)
        silence_warnings()
        self._chain = Chain(plant, float(self._model.opt.timestep), self._substeps) if is_plain(self._model) else None

    @property
    def has_bearings(self) -> bool:
        """Whether its bearings can give before they slip."""
        return self._chain is not None

    def positions(
        self,
        windows: Windows,
        begin_rad: np.ndarray,
        begin_rad_s: np.ndarray,
        states: Sequence[JointState],
        which: np.ndarray,
        over: np.ndarray | None = None,
    ) -> np.ndarray:
        """Reported positions after each sample, shape (n, s, k); not finite where a simulation diverges.

        Args:
            windows: what is simulated.
            begin_rad: where each simulation begins, as reported, shape (n, k).
            begin_rad_s: how fast it moves there, shape (n, k).
            states: models.
            which: of the models each simulation has, shape (n,).
            over: which of the windows it runs over, shape (n,); None if each window is simulated once.
        """
        over = np.arange(len(windows)) if over is None else over
        if self._chain is not None:
            drives = drives_of(windows, self._held_steps)
            warm = _warm(windows, states, which, over)
            return self._chain.positions(drives, begin_rad, begin_rad_s, self.models(states), over, which, warm)
        found = [
            self._simulated(windows.some(over[rows]), begin_rad[rows], begin_rad_s[rows], states, which[rows])
            for rows in np.array_split(np.arange(len(over)), max(1, -(-len(over) // _MOST_SIMULATIONS)))
        ]
        return np.concatenate(found)

    def _simulated(
        self, windows: Windows, begin_rad: np.ndarray, begin_rad_s: np.ndarray, states: Sequence[JointState], which: np.ndarray
    ) -> np.ndarray:
        plant, model = self._plant, self._model
        step_s, shape = float(model.opt.timestep), (len(windows), plant.joints)
        batch = Batch(model, len(windows), nthread=0)
        self._set_bodies(batch, states, which)
        bounds = batch.expand("dof_frictionloss")
        position, velocity, applied, bias = (batch.bind(name) for name in ("qpos", "qvel", "qfrc_applied", "qfrc_bias"))
        offset = _by_window(states, which, "encoder_offset.offset_rad")
        batch.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        position[:, plant.positions], velocity[:, plant.velocities] = begin_rad - offset, begin_rad_s
        late_s = _by_window(states, which, "action_delay.delay_s") + _by_window(states, which, CLOCK)
        recorded = _Recorded(windows, late_s, step_s)
        of_gain = _by_window(states, which, POSITION_GAIN)
        of_own = (1.0 + _by_window(states, which, TORQUE_CONSTANT)) * (1.0 + _by_window(states, which, BRAKING))
        feedback = windows.feedback
        on_board = np.zeros(plant.joints, bool) if feedback is None else feedback.is_on_board
        behind = np.where(on_board, 0.0, late_s / step_s + (0.5 if self._held_steps else 0.0))
        line, targets_late_s = _DelayLine(np.maximum(0.0, behind)), np.where(on_board, late_s, 0.0)
        values = np.array([state.motors() for state in states])[which]
        memory, at_joint, bound = np.zeros((*shape, 3)), np.empty(shape), np.empty(shape)
        memory[:, :, 0], memory[:, :, 1] = _warm(windows, states, which, np.arange(len(windows))), begin_rad_s
        found, step = np.empty((*shape[:1], windows.sent_nm.shape[1], shape[1])), in_simulations()
        made, moved = np.zeros(shape), begin_rad_s
        with np.errstate(all="ignore"):
            for now in range(found.shape[1] * self._substeps):
                sample = now // self._substeps
                is_at = np.ascontiguousarray(position[:, plant.positions])
                moves = np.ascontiguousarray(velocity[:, plant.velocities])
                arrived = recorded.arriving_nm(now)
                if feedback is not None:
                    is_computed = on_board | (self._held_steps == 0 or now % self._held_steps == 0)
                    if is_computed.any():
                        begins = windows.lead + (now * step_s - targets_late_s) / windows.step_s
                        law = feedback.of_step(windows.lead + sample, begins, step_s / windows.step_s)
                        stiffness, own = of_gain * law.stiffness_nm_rad, of_own * law.back_emf_nm_s_rad
                        law = replace(law, stiffness_nm_rad=stiffness, back_emf_nm_s_rad=own)
                        # velocities are those of half a step ago
                        now_made = law.torque_nm(is_at + memory[:, :, 2] + offset, moves + 0.5 * (moves - moved))
                        made = np.where(is_computed, np.nan_to_num(now_made), made)
                    arrived = np.where(feedback.is_known, line.after(made), arrived)
                moved = moves
                asked = np.ascontiguousarray(bias[:, plant.velocities])  # a step ago
                step(arrived, is_at, moves, asked, step_s, values, memory, at_joint, bound)
                applied[:, plant.velocities], bounds[:, plant.velocities] = at_joint, bound
                batch.step()
                if now % self._substeps == self._substeps - 1:
                    found[:, sample] = position[:, plant.positions] + memory[:, :, 2] + offset  # encoders sit on rotors
        found[batch.warning.reshape(len(windows), -1).any(axis=1)] = np.nan
        return found

    def models(self, states: Sequence[JointState]) -> ChainModels:
        """What models make of bodies, joints and motors."""
        plant = self._plant

        def of(key: str) -> np.ndarray:
            return values_of(states, key)

        own, rest = self._model.jnt_stiffness[plant.joint_ids], self._model.qpos_spring[plant.positions]
        stiffness = own + of("joint_stiffness.stiffness_nm_rad")
        force = own * rest + of("joint_stiffness.stiffness_nm_rad") * of("joint_stiffness.reference_rad")
        return ChainModels(
            self._bodies(*(of(key) for key in ("link_mass.factor", LINK_INERTIA, *LINK_CENTRES))),
            np.array([gravity_of(state, plant.gravity_m_s2) for state in states]),
            of("rotor_inertia.armature_kg_m2"),
            of("viscous_friction.damping_nm_s_rad"),
            stiffness,
            force / np.where(stiffness == 0.0, 1.0, stiffness),
            np.array([state.motors() for state in states]),
            of("encoder_offset.offset_rad"),
            of("action_delay.delay_s") + of(CLOCK),
            of(POSITION_GAIN),
            (1.0 + of(TORQUE_CONSTANT)) * (1.0 + of(BRAKING)),
            of(GIVE),
            of(CREEP),
        )

    def _bodies(self, mass: np.ndarray, inertia: np.ndarray, *centres: np.ndarray) -> Bodies:
        """Factors of masses, shares of inertias and moves of centres, shapes (m, k), as what they make of all bodies."""
        plant, many = self._plant, (len(mass), 1)
        masses = np.tile(self._model.body_mass, many)
        inertias, places = (np.tile(x, (*many, 1)) for x in (self._model.body_inertia, self._model.body_ipos))
        for j, bodies in enumerate(plant.links):
            masses[:, bodies] *= mass[:, j, None]
            inertias[:, bodies] *= (mass[:, j] * (1.0 + inertia[:, j]))[:, None, None]
            places[:, plant.heaviest_of(j)] += plant.centre_share(j) * np.stack(centres, axis=2)[:, j]
        return Bodies(masses, inertias, places)

    def _set_bodies(self, batch: Batch, states: Sequence[JointState], which: np.ndarray) -> None:
        """Give each simulation the masses, inertias, springs, dampers and gravity of its model."""
        plant = self._plant

        def of(key: str) -> np.ndarray:
            return _by_window(states, which, key)

        batch.expand("dof_damping")[:, plant.velocities] = of("viscous_friction.damping_nm_s_rad")
        batch.expand("dof_armature")[:, plant.velocities] = of("rotor_inertia.armature_kg_m2")
        stiffness = of("joint_stiffness.stiffness_nm_rad")
        if stiffness.any():  # beside whatever spring the model itself has, at its own rest
            own, rest = self._model.jnt_stiffness[plant.joint_ids], self._model.qpos_spring[plant.positions]
            together = own + stiffness
            batch.expand("jnt_stiffness")[:, plant.joint_ids] = together
            reference = of("joint_stiffness.reference_rad")
            batch.expand("qpos_spring")[:, plant.positions] = (own * rest + stiffness * reference) / np.maximum(together, 1e-12)
        batch.expand("opt.gravity")[:] = np.array([gravity_of(state, plant.gravity_m_s2) for state in states])[which]
        bodies = self._bodies(*(of(key) for key in ("link_mass.factor", LINK_INERTIA, *LINK_CENTRES)))
        for name, values in (("mass", bodies.mass_kg), ("inertia", bodies.inertia_kg_m2), ("ipos", bodies.centre_m)):
            batch.expand(f"body_{name}")[:] = values
        batch.set_const()


def _warm(windows: Windows, states: Sequence[JointState], which: np.ndarray, over: np.ndarray) -> np.ndarray:
    """How much warmer than their surroundings motors begin simulations, K, shape (n, k): of models that warm alike once."""
    found, past = np.zeros((len(which), windows.begin_rad.shape[1])), windows.past
    alike: dict[bytes, list[int]] = {}
    for number, state in enumerate(states):
        if past is not None and warms(state):
            alike.setdefault(warming(state), []).append(number)
    for numbers in alike.values():
        rows = np.isin(which, numbers)
        if past is not None and rows.any():
            found[rows] = past.some(over[rows]).warm_k(states[numbers[0]])
    return found


def drives_of(windows: Windows, held_steps: int = 0) -> Drives:
    """What drives some windows."""
    law, k = windows.feedback, windows.sent_nm.shape[2]
    none = np.zeros((len(fields(Feedback)), 1, 1, k))
    feedback = none if law is None else np.stack([getattr(law, field.name) for field in fields(Feedback)])
    is_known = np.zeros(k, bool) if law is None else law.is_known
    return Drives(windows.sent_nm, feedback, is_known, windows.step_s, held_steps, windows.lead)


class _Recorded:
    """Torques that were recorded, each held from its sample to the next, as they act some time later or earlier.

    A step of MuJoCo moves velocities by what acts about its begin, so that it takes the mean of half a step before and after.

    Args:
        windows: n of them.
        late_s: shape (n, k); at both ends of a window the first and the last torque go on.
        step_s: of the simulation.
    """

    def __init__(self, windows: Windows, late_s: np.ndarray, step_s: float) -> None:
        self._step_s, self._sample_s, self._sent = step_s, windows.step_s, windows.sent_nm
        self._sums = np.concatenate([np.zeros_like(windows.sent_nm[:, :1]), np.cumsum(windows.sent_nm, axis=1)], axis=1)
        self._late_s = late_s + 0.5 * step_s
        self._before = self._until(0.0)

    def _until(self, time_s: float) -> np.ndarray:
        """Integral of what has arrived, shape (n, k), in samples."""
        at = (time_s - self._late_s) / self._sample_s
        sample = np.clip(np.floor(at).astype(int), 0, self._sent.shape[1] - 1)
        sums, held = (np.take_along_axis(x, sample[:, None], axis=1)[:, 0] for x in (self._sums, self._sent))
        return sums + (at - sample) * held

    def arriving_nm(self, step: int) -> np.ndarray:
        """What acts in a step of the simulation, shape (n, k); steps are asked for one after the other."""
        until = self._until((step + 1) * self._step_s)
        mean, self._before = (until - self._before) * (self._sample_s / self._step_s), until
        return mean


class _DelayLine:
    """Torques that arrive some steps after they were sent, each simulation and joint after its own time.

    Args:
        late: steps, shape (n, k).
    """

    def __init__(self, late: np.ndarray) -> None:
        self._whole = np.floor(late + 1e-9).astype(int)
        self._share = np.where(late - self._whole > 1e-6, late - self._whole, 0.0)
        self._sent: list[np.ndarray] = []

    def after(self, sent_nm: np.ndarray) -> np.ndarray:
        """What arrives in a step in which something is sent, shapes (n, k), N m."""
        if not self._whole.any() and not self._share.any():
            return sent_nm
        self._sent.append(sent_nm)
        del self._sent[: -int(self._whole.max()) - 2]
        past, newest = np.stack(self._sent), len(self._sent) - 1
        newer, older = (np.take_along_axis(past, np.maximum(0, newest - self._whole - more)[None], axis=0)[0] for more in (0, 1))
        return newer + self._share * (older - newer)


def _by_window(states: Sequence[JointState], which: np.ndarray, key: str) -> np.ndarray:
    """A parameter of the model of each window, shape (n, k) for one of joints."""
    return values_of(states, key)[which]
