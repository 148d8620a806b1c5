"""The arm that stands there, in fine steps of MuJoCo with hidden laws beside it, seen and commanded at the table's rate."""

import copy
from dataclasses import dataclass, field, fields, replace

import mujoco
import numpy as np

from tests.second_generator.laws import STEP_S, Friction, Motor


@dataclass
class Body:
    """What a hidden cause may change before an arm is simulated; arrays have shape (joints,)."""

    arm: object
    extra_viscous: np.ndarray
    extra_coulomb: np.ndarray
    stribeck: np.ndarray
    stribeck_speed: np.ndarray
    load: np.ndarray
    direction: np.ndarray
    delay_s: np.ndarray
    torque_error: np.ndarray
    limit_nm: np.ndarray
    loss_per_k: np.ndarray
    rise_k_nm2: np.ndarray
    warming_s: np.ndarray
    offset_rad: np.ndarray
    filter_s: np.ndarray
    gain_factor: np.ndarray
    step_rad: np.ndarray
    noise_rad: np.ndarray
    sag: object = None
    crosstalk: np.ndarray | None = None
    laws: dict = field(default_factory=dict)
    """Laws that give a torque, by joint: {joint: [law, ...]}."""
    dry: dict = field(default_factory=dict)
    """Laws that give dry friction, by joint."""
    drives: dict = field(default_factory=dict)
    """Rotors of their own, by joint."""
    gone: dict = field(default_factory=dict)
    """Times in which an encoder's reading stands still, by joint: [(begin, end), ...]."""


def plain_body(arm, step_rad, noise_rad, rise_k_nm2, warming_s):
    """A body without any hidden cause, with the sensors and motors of its owner."""
    n = arm.joints
    names = ["extra_viscous", "extra_coulomb", "stribeck", "load", "direction", "delay_s", "torque_error", "loss_per_k"]
    zeros = {name: np.zeros(n) for name in [*names, "offset_rad", "filter_s"]}
    ones = {"stribeck_speed": np.ones(n), "gain_factor": np.ones(n)}
    motor = {"rise_k_nm2": rise_k_nm2.copy(), "warming_s": warming_s.copy(), "limit_nm": np.array(arm.torque_limit_nm)}
    return Body(arm=arm, step_rad=step_rad.copy(), noise_rad=noise_rad.copy(), **zeros, **ones, **motor)


class Plant:
    """One arm in motion; the sole owner of its ``MjData`` and of the laws' state."""

    def __init__(self, body, supply_v=None):
        n = body.arm.joints
        self.body, self.joints, self.time_s = body, n, 0.0
        arm = body.arm
        damping = np.array([link.damping_nm_s_rad for link in arm.links]) + body.extra_viscous
        coulomb = np.array([link.frictionloss_nm for link in arm.links]) + body.extra_coulomb
        links = [
            replace(link, frictionloss_nm=0.0, damping_nm_s_rad=damping[i] * (i not in body.drives))
            for i, link in enumerate(arm.links)
        ]
        links = [replace(link, armature_kg_m2=0.0) if i in body.drives else link for i, link in enumerate(links)]
        self.model = mujoco.MjModel.from_xml_string(replace(arm, links=tuple(links)).mjcf())
        self.model.opt.timestep = STEP_S
        self.model.jnt_limited[:n] = 0
        if arm.loose is None:
            self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self.rotor_damping = damping
        b = body
        self.friction = Friction(coulomb, b.stribeck, b.stribeck_speed, b.load, b.direction, smallest_inertia(arm, b.drives))
        self.motor = Motor(b.delay_s, b.torque_error, b.limit_nm, b.loss_per_k, b.rise_k_nm2, b.warming_s, b.sag)
        self.laws, self.dry, self.drives = copy.deepcopy((b.laws, b.dry, b.drives))
        self.filtered, self.held = np.zeros(n), np.zeros(n)

    def start(self, position, velocity, command):
        """Begin at a position and velocity of the rotors, as if ``command`` had stood before."""
        n = self.joints
        self.data.qpos[:n], self.data.qvel[:n] = position, velocity
        for j, drive in self.drives.items():
            drive.place(float(position[j]), float(velocity[j]))
        self.motor.fill(command)
        self.filtered, self.held = np.array(velocity, dtype=float), np.array(position, dtype=float)
        mujoco.mj_forward(self.model, self.data)

    def turned(self):
        """Position and velocity where encoders sit, each of shape (joints,)."""
        q, v = self.data.qpos[: self.joints].copy(), self.data.qvel[: self.joints].copy()
        for j, drive in self.drives.items():
            q[j], v[j] = drive.q, drive.v
        return q, v

    def reading(self):
        """What encoders would say without noise and steps: position and velocity, each of shape (joints,)."""
        q, v = self.turned()
        for j, spans in self.body.gone.items():
            if any(begin <= self.time_s < end for begin, end in spans):
                q[j] = self.held[j]
        self.held = q.copy()
        return q + self.body.offset_rad, np.where(self.body.filter_s > 0, self.filtered, v)

    def step(self, command):
        """One fine step under the command in force, N m, shape (joints,)."""
        n, t = self.joints, self.time_s
        q, v = self.turned()
        motor = self.motor.torque(t, command)
        if self.body.crosstalk is not None:
            motor = self.body.crosstalk @ motor
        more = np.zeros(n)
        for j, laws in self.dry.items():
            more[j] = sum(law.dry(t, q[j]) for law in laws)
        torque = motor + self.friction.torque(v, motor, more)
        for j, laws in self.laws.items():
            torque[j] += sum(law.torque(t, float(q[j]), float(v[j]), float(motor[j])) for law in laws)
        for j, drive in self.drives.items():
            own = float(torque[j] - self.rotor_damping[j] * v[j])
            torque[j] = drive.step(float(self.data.qpos[j]), float(self.data.qvel[j]), own)
        self.data.qfrc_applied[:n] = torque
        mujoco.mj_step(self.model, self.data)
        self.time_s += STEP_S
        if self.body.filter_s.any():
            speed = self.turned()[1]
            self.filtered += (speed - self.filtered) * -np.expm1(-STEP_S / np.maximum(self.body.filter_s, 1e-9))

    def state(self):
        """A copy of all that a window needs to begin here."""
        kept = (self.motor, self.friction, self.laws, self.dry, self.drives, self.filtered, self.held)
        return self.time_s, self.data.qpos.copy(), self.data.qvel.copy(), copy.deepcopy(kept)


def smallest_inertia(arm, drives):
    """Inertia that friction works on when all other joints are free (that of the rotor in a drive), kg m^2, shape (joints,)."""
    model = mujoco.MjModel.from_xml_string(replace(arm, loose=None).mjcf())
    data = mujoco.MjData(model)
    data.qpos[:] = arm.home_rad
    mujoco.mj_forward(model, data)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    inertia = 1.0 / np.diag(np.linalg.inv(dense))
    for j, drive in drives.items():
        inertia[j] = drive.rotor
    return inertia


@dataclass(frozen=True)
class Trace:
    """One recording as it was, sampled at the table's rate; all but ``time_s`` have shape (rows, joints).

    ``position_rad`` and ``velocity_rad_s`` are what encoders say without noise and steps, ``seen_*`` with both; ``turned_*`` is
    the truth where encoders sit. ``current_nm`` is the motors' torque by their current just after the row's command.
    """

    time_s: np.ndarray
    position_rad: np.ndarray
    velocity_rad_s: np.ndarray
    seen_rad: np.ndarray
    seen_rad_s: np.ndarray
    turned_rad: np.ndarray
    turned_rad_s: np.ndarray
    command_nm: np.ndarray
    current_nm: np.ndarray
    heat_k: np.ndarray
    target_rad: np.ndarray
    desired_nm: np.ndarray
    states: dict


COLUMNS = tuple(each.name for each in fields(Trace) if each.name not in {"time_s", "states"})


def run(plant, controller, seconds, period_s, rng, velocity_noise, state_every=0):
    """A recording of ``seconds``: at each row observe, ask the controller, hold its command.

    ``controller(t, seen position, seen velocity)`` gives command, position target and desired torque. The state is kept at every
    ``state_every``-th row. The recording ends early where a joint leaves 2.8 rad, which the caller sees at its length.
    """
    count, fine = round(seconds / period_s), round(period_s / STEP_S)
    n = plant.joints
    columns = np.full((len(COLUMNS), count, n), np.nan)
    states = {}
    for k in range(count):
        if state_every and k % state_every == 0:
            states[k] = plant.state()
        q, v = plant.reading()
        step = plant.body.step_rad
        seen_q = np.round((q + plant.body.noise_rad * rng.standard_normal(n)) / step) * step
        seen_v = v + velocity_noise * rng.standard_normal(n)
        command, target, desired = controller(k * period_s, seen_q, seen_v)
        if k == 0:
            plant.motor.fill(command)
        columns[:7, k] = q, v, seen_q, seen_v, *plant.turned(), command
        columns[9, k], columns[10, k] = target, desired
        for i in range(fine):
            plant.step(command)
            if i == 0:
                columns[7, k], columns[8, k] = plant.motor.current, plant.motor.heat_k
        if not np.all(np.abs(plant.data.qpos[:n]) < 2.8):
            columns = columns[:, : k + 1]
            break
    named = dict(zip(COLUMNS, columns, strict=True))
    return Trace(time_s=np.arange(columns.shape[1]) * period_s, states=states, **named)
