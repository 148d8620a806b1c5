"""Four equations for each joint that a healthy robot fulfils but for noise, and what each effect adds to them.

controller
    what was sent is what the safety pipeline makes of targets and of what the encoders reported;
current
    what the motor board measured is what was sent;
mechanics
    the torque at the motor is what inverse dynamics needs for the motion that was measured;
velocity
    the reported velocity is the derivative of the reported position.

Every number that an effect may change has an image in them: the difference that a small change makes, with signs such that a
residual is the sum of images times the true deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim_backend.driver.safety import applied_torque_nm
from sim_backend.effects.body import table_tilt
from sim_backend.reality_gap import motor_law
from sim_backend.reality_gap.joint_state import CLOCK, SENSED, JointState, Term
from sim_backend.reality_gap.plant import InverseDynamics, Plant
from sim_backend.reality_gap.trajectory import Trajectory, filled_gaps, position_noise, white_noise


class Channel(StrEnum):
    """Which equation."""

    CONTROLLER = "controller"
    CURRENT = "current"
    MECHANICS = "mechanics"
    VELOCITY = "velocity"


@dataclass(frozen=True)
class Equation:
    """One equation of one joint in one episode.

    Attributes:
        channel: which.
        joint: index.
        episode: index of the recording.
        time_s: of the rows, shape (r,).
        residual: with the present state, shape (r,), N m or rad/s.
        images: of the terms in ``terms``, shape (r, m), per unit of the parameter.
        terms: indices into the list of terms.
        valid: rows that count, shape (r,).
        sensor_noise: of mechanics: the encoders' white noise times inertia over the square of the time between rows.
        in_windows: whether that noise decides, so that rows are to be integrated twice over windows.
    """

    channel: Channel
    joint: int
    episode: int
    time_s: np.ndarray
    residual: np.ndarray
    images: np.ndarray
    terms: tuple[int, ...]
    valid: np.ndarray
    sensor_noise: float = 0.0
    in_windows: bool = False


STANDSTILL_RAD_S = 0.02
"""Below it friction may hold anything, so that mechanics says nothing."""
_SMALLEST_IMAGE = 1e-9
_STILL_S = 0.03
_NEAR_END_RAD = 0.012
_NEAR_END_S = 0.06
_CONTROLLER_KEYS = ("position_gain.factor", "safety_damping.factor", "timing_jitter.std_s", "controller_restart.off")


class EpisodeEquations:
    """The equations of one episode.

    Args:
        plant: of the nominal model.
        path: the episode.
        episode: its index.
        has_safety_pipeline: whether the driver's own pipeline made the sent torque.
        in_torques: whether errors of the torques, not noise of the encoders, decide how well the mechanics can be known.
    """

    def __init__(
        self, plant: Plant, path: Trajectory, episode: int, *, has_safety_pipeline: bool, in_torques: bool = False
    ) -> None:
        self._in_torques = in_torques
        self._plant, self._path, self._episode = plant, path, episode
        self._dynamics: InverseDynamics = plant.derivatives(path.position, path.velocity, path.acceleration)
        self._raw_acceleration = path.raw_acceleration
        self._motor_images: tuple | None = None
        joints = path.joints
        sent, measured = joints.commanded_torque_nm, joints.measured_torque_nm
        if sent is None and measured is None:
            raise ValueError(f"episode {path.recording.name} has no torque")
        self._sent = None if sent is None else filled_gaps(sent)
        self._measured = None if measured is None else filled_gaps(measured)
        self._has_pipeline = has_safety_pipeline and sent is not None and joints.position_target_rad is not None
        driving = self._sent if self._sent is not None else self._measured
        assert driving is not None
        self._driving = np.ascontiguousarray(driving.T)
        self._through = None if self._measured is None or self._sent is None else np.ascontiguousarray(self._measured.T)
        self._total = np.abs(driving).sum(axis=1)
        self._turning = np.ascontiguousarray(path.fast_position.T), np.ascontiguousarray(path.fast_velocity.T)
        self._tilt_images = _tilt_images(self._dynamics.by_gravity, plant.gravity_m_s2)
        self._torque_noise = self._sensor_noise_nm()
        self._ends = plant.range_rad.copy()
        self.valid_mechanics = path.valid & ~self._still() & ~self._near_end()

    @property
    def path(self) -> Trajectory:
        """The smoothed episode."""
        return self._path

    @property
    def dynamics(self) -> InverseDynamics:
        """Inverse dynamics of the nominal model along it."""
        return self._dynamics

    def empty_equation(self, channel: Channel) -> Equation:
        """The frame of a mechanics or velocity equation: times without values."""
        rows = len(self._path.time_s)
        nothing = np.zeros(rows)
        return Equation(channel, 0, self._episode, self._path.time_s, nothing, np.zeros((rows, 0)), (), np.ones(rows, bool))

    @property
    def driving_nm(self) -> np.ndarray:
        """Torques that were sent, or measured if nothing else is known, shape (k, s), N m."""
        return self._driving

    @property
    def acting_nm(self) -> np.ndarray:
        """Torques that drive the mechanics: measured where they are known, shape (k, s), N m."""
        return self._driving if self._through is None else self._through

    @property
    def ends_rad(self) -> np.ndarray:
        """Ends of the joints' ranges, shape (k, 2)."""
        return self._plant.range_rad

    @property
    def pressing_nm(self) -> np.ndarray:
        """What the motors give beyond what the motion needs, shape (t, k), N m."""
        return self._path.averaged(self._driving).T - self._dynamics.torque_nm

    def current_difference(self, state: JointState) -> np.ndarray | None:
        """What was measured beyond what the model makes of what was sent, shape (s, k), N m; None without both."""
        return None if self._through is None else -self.mechanics(state)[1]

    def _sensor_noise_nm(self) -> np.ndarray:
        """What noise of encoders and torque sensors gives the residual of the mechanics, shape (k,), N m."""
        path = self._path
        inertia = np.sqrt(np.mean(self._dynamics.by_acceleration**2, axis=0))
        return inertia @ (position_noise(path.joints.position_rad) / (path.step_s * path.every) ** 2)

    def keep_off(self, joint: int, side: int, shift_rad: float) -> None:
        """Let rows near a shifted end of a joint not count: something else than the motor acts there."""
        self._ends[joint, side] += shift_rad
        self.valid_mechanics &= ~self._near_end()

    def ignore_joint(self, joint: int) -> None:
        """Let no row of a joint's mechanics count."""
        self.valid_mechanics[:, joint] = False

    def _still(self) -> np.ndarray:
        speed, width = np.abs(self._path.fast_velocity), max(1, round(_STILL_S / self._path.step_s))
        share = _moving_mean((speed < STANDSTILL_RAD_S).astype(float), width)
        return share[:: self._path.every] > 0.5

    def _near_end(self) -> np.ndarray:
        q, ends = self._path.fast_position, self._ends
        near = (q < ends[:, 0] + _NEAR_END_RAD) | (q > ends[:, 1] - _NEAR_END_RAD)
        width = max(1, round(2 * _NEAR_END_S / self._path.step_s))
        return _moving_mean(near.astype(float), width)[:: self._path.every] > 1e-9

    # ---- mechanics and current -------------------------------------------------------------------------------------

    def _motor(self, state: JointState, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torque of the current, torque left at the joint, and play, at full rate; shape (s,)."""
        values = state.motor(j)
        motion = self._total, self._turning[0][j], self._turning[1][j], self._path.step_s
        if self._through is None:
            return motor_law.along(self._driving[j], *motion, values)
        before, after = values.copy(), values.copy()
        before[3:], after[:3] = motor_law.absent_values()[3:], motor_law.absent_values()[:3]
        current = motor_law.along(self._driving[j], *motion, before)[0]
        _, net, play = motor_law.along(self._through[j], *motion, after)
        return current, net, play

    def _nominal_motor(self, state: JointState, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As :meth:`_motor`, driven by what was sent: images must not hold the noise that residuals hold."""
        motion = self._total, self._turning[0][j], self._turning[1][j], self._path.step_s
        return motor_law.along(self._driving[j], *motion, state.motor(j))

    def _needed(self, state: JointState, play: np.ndarray, *, smooth: bool = False) -> np.ndarray:
        """Torques that the motion needs; ``play`` smoothed, shape (t, k)."""
        d, path = self._dynamics, self._path
        acceleration = path.acceleration if smooth else self._raw_acceleration
        torque = d.torque_nm + np.einsum("tkl,tl->tk", d.by_acceleration, acceleration - path.acceleration)
        torque += np.einsum("tkl,l->tk", d.by_link_mass, state.value("link_mass.factor") - 1.0)
        torque += state.value("rotor_inertia.armature_kg_m2") * acceleration
        torque += state.value("viscous_friction.damping_nm_s_rad") * path.velocity
        stiffness, reference = (state.value(f"joint_stiffness.{name}") for name in ("stiffness_nm_rad", "reference_rad"))
        torque += stiffness * (path.position - reference)
        torque += np.einsum("tkg,g->tk", d.by_gravity, self._gravity(state) - self._plant.gravity_m_s2)
        moved = state.value("encoder_offset.offset_rad") + play
        torque -= np.einsum("tkl,tl->tk", d.by_position, moved)
        if play.any():
            step_s = path.step_s * path.every
            torque -= np.einsum("tkl,tl->tk", d.by_acceleration, np.gradient(np.gradient(play, step_s, axis=0), step_s, axis=0))
        return torque

    def _gravity(self, state: JointState) -> np.ndarray:
        tilt = {"roll_rad": state.value("table_tilt.roll_rad")[0], "pitch_rad": state.value("table_tilt.pitch_rad")[0]}
        return _tilted(self._plant.gravity_m_s2, tilt) + state.value("gravity.offset_m_s2")

    def mechanics(self, state: JointState) -> tuple[np.ndarray, np.ndarray]:
        """Residual of the mechanics, shape (t, k), and of the current at full rate, shape (s, k); N m."""
        motors = [self._motor(state, j) for j in range(self._plant.joints)]
        net = self._path.averaged(np.stack([m[1] for m in motors])).T
        plays = np.stack([m[2] for m in motors])
        play = self._path.smoothed(plays).T if plays.any() else np.zeros_like(net)
        current = np.zeros(self._path.fast_position.shape)
        if self._through is not None:
            current = (np.stack([m[0] for m in motors]) - self._through).T
        return net - self._needed(state, play), current

    def _mechanics_images(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[tuple[int, int, np.ndarray]]]:
        """Images in the mechanics, shape (t, k, m); in the current as (term, joint, (s,))."""
        images, currents = self._images_of_motors(state, terms)
        images = images.copy()
        for i, term in enumerate(terms):
            if term.key not in (CLOCK, SENSED) and term.key not in motor_law.KEYS:
                images[:, :, i] = self._body_image(state, term)
        return images, currents

    def torque_error(self, state: JointState) -> np.ndarray:
        """What the motors gave beyond what the smoothed motion needs, both smoothed alike, shape (t, k), N m."""
        motors = [self._motor(state, j) for j in range(self._plant.joints)]
        net = self._path.smoothed(np.stack([m[1] for m in motors])).T
        plays = np.stack([m[2] for m in motors])
        play = self._path.smoothed(plays).T if plays.any() else np.zeros_like(net)
        return net - self._needed(state, play, smooth=True)

    @property
    def torque_error_floor_nm(self) -> np.ndarray:
        """What the sensors' noise alone makes of :meth:`torque_error`, shape (k,), N m."""
        path = self._path
        inertia = np.sqrt(np.mean(self._dynamics.by_acceleration**2, axis=0))
        moved = inertia @ path.acceleration_noise(position_noise(path.joints.position_rad))
        measured = path.joints.measured_torque_nm
        sensed = 0.0 if measured is None else white_noise(measured) * np.sqrt(2.0 * path.cutoff_hz * path.step_s)
        return np.hypot(moved, sensed)

    def _images_of_motors(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[tuple[int, int, np.ndarray]]]:
        """Those of the motor law and of the clock; kept for the next call with the same state and terms."""
        if self._motor_images is not None and self._motor_images[0] is state and self._motor_images[1] is terms:
            return self._motor_images[2]
        k, rows = self._plant.joints, len(self._path.position)
        thin = self._path.smoothed if self._in_torques else self._path.averaged
        base = [self._nominal_motor(state, j) for j in range(k)]
        images, currents = np.zeros((rows, k, len(terms))), []
        nets, plays, owners, played = [], [], [], []
        for i, term in enumerate(terms):
            if term.key == CLOCK:
                torque = thin(np.stack([net for _, net, _ in base])).T
                images[:, :, i] = np.gradient(torque, self._path.step_s * self._path.every, axis=0)
            if term.key == SENSED and self._through is not None:
                images[:, term.index, i] = thin(self._through[term.index] - base[term.index][0])
            if term.key not in motor_law.KEYS:
                continue
            for j in [term.index] if state.width(term.key) > 1 else range(k):
                if term.effect == "cogging":  # a phase of its own beside the one that the state has
                    nets.append(self._cogging_image(state, term, j))
                    owners.append((i, j))
                    continue
                current, net, play = self._nominal_motor(state.moved(term, term.probe), j)
                if term.key in motor_law.KEYS[:3] and self._through is not None:
                    currents.append((i, j, (base[j][0] - current) / term.probe))
                    continue
                nets.append((base[j][1] - net) / term.probe)
                owners.append((i, j))
                if term.key == "backlash.gap_rad":
                    plays.append((base[j][2] - play) / term.probe)
                    played.append((i, j))
        for (i, j), image in zip(owners, thin(np.stack(nets)) if nets else (), strict=True):
            images[:, j, i] += image
        for (i, j), image in zip(played, self._path.smoothed(np.stack(plays)) if plays else (), strict=True):
            images[:, :, i] += self._play_image(image, j)
        self._motor_images = state, terms, (images, currents)
        return images, currents

    def _cogging_image(self, state: JointState, term: Term, j: int) -> np.ndarray:
        values = state.moved(term, 0.0).motor(j)
        cycles, phase = (values[motor_law.KEYS.index(f"cogging.{name}")] for name in ("cycles_per_rad", "phase_rad"))
        return -np.sin(2.0 * np.pi * cycles * self._turning[0][j] + phase)

    def _play_image(self, play: np.ndarray, j: int) -> np.ndarray:
        step_s = self._path.step_s * self._path.every
        faster = np.gradient(np.gradient(play, step_s), step_s)
        return self._dynamics.by_position[:, :, j] * play[:, None] + self._dynamics.by_acceleration[:, :, j] * faster[:, None]

    def _body_image(self, state: JointState, term: Term) -> np.ndarray:
        d, path, j = self._dynamics, self._path, term.index
        image = np.zeros_like(path.position)
        match term.key:
            case "link_mass.factor":
                return d.by_link_mass[:, :, j]
            case "rotor_inertia.armature_kg_m2":
                image[:, j] = path.acceleration[:, j]
            case "viscous_friction.damping_nm_s_rad":
                image[:, j] = path.velocity[:, j]
            case "joint_stiffness.stiffness_nm_rad":
                shape = dict(term.shape).get("joint_stiffness.reference_rad", state.value("joint_stiffness.reference_rad")[j])
                image[:, j] = path.position[:, j] - shape
            case "gravity.offset_m_s2":
                return d.by_gravity[:, :, j]
            case "table_tilt.roll_rad":
                return self._tilt_images[:, :, 0]
            case "table_tilt.pitch_rad":
                return self._tilt_images[:, :, 1]
            case "encoder_offset.offset_rad":
                return -d.by_position[:, :, j]
        return -image if term.key == "encoder_offset.offset_rad" else image

    # ---- velocity and controller -----------------------------------------------------------------------------------

    def velocity(self, state: JointState) -> np.ndarray | None:
        """Residual of the reported velocity, shape (t, k), rad/s; None without such a channel."""
        reported, path = self._path.joints.velocity_rad_s, self._path
        if reported is None:
            return None
        constant = state.value("velocity_filter.time_constant_s")
        speed = path.fast_velocity
        if self._has_pipeline:  # these robots report the mean speed since the last sample
            speed = 0.5 * (speed + np.concatenate([speed[:1], speed[:-1]]))
        turning = _lagged(speed, constant, path.step_s)
        return path.smoothed((filled_gaps(reported) - turning).T).T

    def _velocity_image(self, state: JointState, term: Term) -> np.ndarray:
        path, constant = self._path, state.value(term.key)[term.index]
        series = path.fast_velocity[:, [term.index] * 2]
        pair = _lagged(series, np.array([constant, constant + term.probe]), path.step_s)
        return path.smoothed(pair[:, 1] - pair[:, 0]) / term.probe

    def controller(self, state: JointState) -> np.ndarray | None:
        """Residual of the sent torque, shape (s, k), N m; None where the pipeline is not known."""
        if not self._has_pipeline:
            return None
        assert self._sent is not None
        residual = self._sent - self._pipeline(state)
        off = state.value("controller_restart.off")[0]
        return residual if off == 0.0 else residual * 0.0 + self._sent

    def _pipeline(self, state: JointState, *, previous: bool = False) -> np.ndarray:
        joints = self._path.joints
        assert joints.position_target_rad is not None and joints.velocity_rad_s is not None
        desired = joints.desired_torque_nm if joints.desired_torque_nm is not None else np.zeros_like(joints.position_rad)
        target = joints.position_target_rad
        if previous:
            desired, target = _command_before(desired, target)
        return applied_torque_nm(
            desired,
            target,
            joints.position_rad,
            joints.velocity_rad_s,
            position_gain_factor=state.value("position_gain.factor"),
            damping_factor=state.value("safety_damping.factor"),
        )

    def _controller_image(self, state: JointState, term: Term) -> np.ndarray:
        """What a term does if all joints have it, shape (s, k)."""
        base = self._pipeline(state)
        if term.key == "timing_jitter.std_s":
            joints = self._path.joints
            assert joints.position_target_rad is not None
            since_s = _time_since_change(joints.position_target_rad, self._path.step_s)
            late = np.maximum(0.0, 1.0 - since_s / (2.0 * term.probe))[:, None]  # roughly the chance of half-normal lateness
            return late * (self._pipeline(state, previous=True) - base) / term.probe
        if term.key == "controller_restart.off":
            return -base
        moved = JointState(state.joints, {**state.given, term.key: state.value(term.key) + term.probe})
        return (self._pipeline(moved) - base) / term.probe

    # ---- all -------------------------------------------------------------------------------------------------------

    def equations(self, state: JointState, terms: Sequence[Term]) -> list[Equation]:
        """All equations of the episode with the images of all terms that have one in them."""
        residual, current = self.mechanics(state)
        if self._in_torques:
            residual = self.torque_error(state)
        images, currents = self._mechanics_images(state, terms)
        found = [self._mechanics_equation(j, residual, images) for j in range(self._plant.joints)]
        full = slice(None, None, _thinning(self._path.step_s))
        if self._through is not None and not self._in_torques:  # what unknown boards do before they report is not an effect
            known = ~np.isnan(self._path.joints.position_rad)
            found += self._full_rate(Channel.CURRENT, current, currents, known, full)
        velocity, controller = self.velocity(state), self.controller(state)
        if velocity is not None and not self._in_torques:
            filters = [(i, t.index, self._velocity_image(state, t)) for i, t in enumerate(terms) if t.effect == "velocity_filter"]
            found += self._full_rate(Channel.VELOCITY, velocity, filters, self._path.valid, slice(None), self._path.time_s)
        if controller is not None:
            everywhere = np.ones(controller.shape, bool)
            found += self._full_rate(Channel.CONTROLLER, controller, self._controller_images(state, terms), everywhere, full)
        return found

    def _mechanics_equation(self, j: int, residual: np.ndarray, images: np.ndarray) -> Equation:
        used = np.flatnonzero(np.abs(images[:, j]).max(axis=0) > _SMALLEST_IMAGE)
        valid, time_s = self.valid_mechanics[:, j], self._path.time_s
        terms, noise, rows = tuple(used.tolist()), float(self._torque_noise[j]), slice(None)
        if self._in_torques:
            rows = slice(None, None, max(1, round(0.4 / (self._path.cutoff_hz * self._path.step_s * self._path.every))))
        return Equation(
            Channel.MECHANICS,
            j,
            self._episode,
            time_s[rows],
            residual[rows, j],
            images[rows, j][:, used],
            terms,
            valid[rows],
            noise,
            in_windows=not self._in_torques,
        )

    def _full_rate(self, channel, residual, images, valid, rows: slice, time_s: np.ndarray | None = None) -> list[Equation]:
        """One equation for each joint from images given as (term, joint, series)."""
        time_s = self._path.recording.time_s if time_s is None else time_s
        found = []
        for j in range(self._plant.joints):
            own = [(i, image) for i, owner, image in images if owner == j]
            stacked = np.stack([x[rows] for _, x in own], axis=1) if own else np.zeros((len(time_s[rows]), 0))
            terms = tuple(i for i, _ in own)
            found.append(Equation(channel, j, self._episode, time_s[rows], residual[rows, j], stacked, terms, valid[rows, j]))
        return found

    def _controller_images(self, state: JointState, terms: Sequence[Term]) -> list[tuple[int, int, np.ndarray]]:
        """As (term, joint, (s,)); a term of one joint has an image in that joint only, so that all are taken together."""
        found, taken = [], {}
        for i, term in enumerate(terms):
            if term.key not in _CONTROLLER_KEYS:
                continue
            if (term.key, term.probe) not in taken:
                taken[term.key, term.probe] = self._controller_image(state, term)
            image = taken[term.key, term.probe]
            joints = [term.index] if state.width(term.key) > 1 else range(self._plant.joints)
            found += [(i, j, image[:, j]) for j in joints if image[:, j].any()]
        return found


def _tilted(gravity_m_s2: np.ndarray, tilt: dict) -> np.ndarray:
    """Gravity as the catalogue's tilt turns it, shape (3,)."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = gravity_m_s2
    table_tilt(spec, tilt)
    return np.array(spec.option.gravity)


def _tilt_images(by_gravity: np.ndarray, gravity_m_s2: np.ndarray) -> np.ndarray:
    step = 1e-4
    changes = [
        (_tilted(gravity_m_s2, {"roll_rad": roll, "pitch_rad": pitch}) - gravity_m_s2) / step
        for roll, pitch in ((step, 0.0), (0.0, step))
    ]
    return np.stack([by_gravity @ change for change in changes], axis=2)


def _thinning(step_s: float) -> int:
    """Samples from one counted sample to the next where noise is white and there are more than enough."""
    return max(1, round(0.003 / step_s))


def _moving_mean(series: np.ndarray, width: int) -> np.ndarray:
    """Over ``width`` samples around each, along the first axis."""
    padded = np.concatenate([np.zeros((1, series.shape[1])), np.cumsum(series, axis=0)])
    low, high = np.arange(len(series)) - width // 2, np.arange(len(series)) + width // 2 + 1
    low, high = np.clip(low, 0, len(series)), np.clip(high, 0, len(series))
    return (padded[high] - padded[low]) / (high - low)[:, None]


def _lagged(series: np.ndarray, time_constant_s: np.ndarray, step_s: float) -> np.ndarray:
    """The catalogue's first-order filter for each column."""
    from scipy import signal

    share = step_s / (time_constant_s + step_s)
    return np.stack(
        [
            signal.lfilter([a], [1.0, a - 1.0], column, zi=[column[0] * (1.0 - a)])[0]
            for a, column in zip(share, series.T, strict=True)
        ],
        axis=1,
    )


def _command_before(desired: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each sample the command that the present one replaced."""
    changes = _changes(target)
    starts = np.flatnonzero(changes)
    latest = np.searchsorted(starts, np.arange(len(target)), side="right") - 1
    before = np.where(latest >= 0, starts[np.maximum(latest, 0)] - 1, 0)
    return desired[before], target[before]


def _time_since_change(target: np.ndarray, step_s: float) -> np.ndarray:
    starts = np.concatenate([[0], np.flatnonzero(_changes(target))])
    latest = starts[np.searchsorted(starts, np.arange(len(target)), side="right") - 1]
    return step_s * (np.arange(len(target)) - latest)


def _changes(target: np.ndarray) -> np.ndarray:
    same = (target[1:] == target[:-1]) | (np.isnan(target[1:]) & np.isnan(target[:-1]))
    return np.concatenate([[False], ~same.all(axis=1)])
