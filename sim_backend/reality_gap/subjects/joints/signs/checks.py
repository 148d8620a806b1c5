"""What joints show without any fit: levels of noise, steps of encoders, jumps, joints that do not move, shifted ends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import ENDS, SEEN, Sign, effect_of
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot
from sim_backend.reality_gap.measured.sensor_noise import grows_with_speed, white_noise
from sim_backend.reality_gap.quantiles import MEDIAN_SIZE, MEDIAN_SQUARE, Z_90
from sim_backend.reality_gap.subjects.joints.laws.body_law import encoder_offsets_rad
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.laws.trajectory import filled_gaps
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

ODD_JOINT = 1.6
"""A level this many times that of the other joints is odd: levels are known to a few per cent."""
SLOW_SHARE = 0.15
"""Less of a noise may seem to last only because it is large."""
ODD_MOTOR = 1.3
HEALTHY_NOISE = {"position_rad": 1e-3, "velocity_rad_s": 0.05, "torque_nm": 0.01}
"""No cause below these, if all joints are alike: what sensors of such robots have (0.005 rad/s and 0.005 N m: benchmark-rrc)."""
HEALTHY_STEP_RAD = 2e-4
HEALTHY_ACTION_NOISE_NM = 1.5e-3
STUCK_RANGE_RAD = 0.02
STUCK_TORQUE_NM = 0.04
ASKED_RANGES = 2.0
"""Times that range a joint must be asked to move before its rest says anything."""
CREEPING_RANGE_RAD, CREEPING_TORQUE_NM = 0.15, 0.3
"""Others drag a jammed joint along a little, but never where three quarters of the motor's torque cannot move it."""
END_MARGIN_RAD = 4e-3
_PRESSING_NM = 0.05
_SOFT_END_RAD = 2e-3
"""Ends give way: where a joint is held is not known better than this."""
_JUMP_RAD = 2e-3
_STEPS_OF_JUMP = 1.5
"""An encoder that moves on by one of its steps has not jumped."""
_STALL_SAMPLES, _STALLED = 3, 0.25
"""So many samples in a row that move by less than this share of the motion after them are repeated."""
_ODD_AMONG_UNKNOWN, _ODD_THOUGH_SMALL = 5.0, 10.0
"""Where nobody knows the sensors, joints may have other encoders and gears than their neighbours; small noise all the more."""
_LEAST_ODD = {Sign.POSITION_STEPS: 4e-4, Sign.POSITION_NOISE: 2e-4, Sign.VELOCITY_NOISE: 0.05}
"""Below these nothing is said of one joint of such a robot: encoders of 14 bits come in steps of 4e-4 rad."""
_ODD_FLOOR = 0.02
"""Share of what is healthy that others are taken to have at least."""
_WHITE = 2.0
"""Noise is as large at half the rate; what smooth motion leaves of fourth differences is 16 times larger there."""


@dataclass(frozen=True)
class Finding:
    """A sign at a joint, whose effect needs no fit: its value with a 90 % interval, and how often beyond what is healthy it is.

    ``episode`` and ``sample`` say when it came, for what happens at one time.
    """

    sign: Sign
    joint: int | None
    value: float
    interval_90: tuple[float, float]
    excess: float
    episode: int = 0
    sample: int = 0

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return effect_of(self.sign)

    @property
    def parameter(self) -> str:
        """Of the effect, which the value is of."""
        return SEEN[self.sign].partition(".")[2]


def noise_findings(episodes: Sequence[EpisodeEquations], robot: Robot) -> list[Finding]:
    """Noise of positions and velocities, and steps of encoders, beyond what is healthy or what other joints have.

    Of sensors that nobody knows only a single joint's can be odd: beyond what a TriFinger's have, and far beyond its neighbours',
    hinges beside hinges and slides beside slides.
    """
    found: list[Finding] = []
    is_known = isinstance(robot, KnownTriFinger)
    odd = _odd if is_known else partial(_odd_among_unknown, episodes[0].plant.is_slide)
    noise = white_noise if is_known else _noise_that_is_white
    paths, joints = [episode.path for episode in episodes], [episode.path.joints for episode in episodes]
    found += odd(Sign.POSITION_STEPS, np.median([path.encoder_step_rad for path in paths], axis=0), HEALTHY_STEP_RAD, 0.02)
    if not any(f.sign is Sign.POSITION_STEPS for f in found):
        found += odd(Sign.POSITION_NOISE, _beyond_steps(episodes, noise), HEALTHY_NOISE["position_rad"], 0.05)
    if not is_known:
        of_clock = noise_of_clocks(episodes)
        found = [f for f in found if f.sign is not Sign.POSITION_NOISE or f.joint not in of_clock]
    if all(j.velocity_rad_s is not None for j in joints):
        reported = [(path, v) for path in paths if (v := path.joints.velocity_rad_s) is not None]
        velocity = np.median([path.by_own_samples(noise, v) for path, v in reported], axis=0)
        found += odd(Sign.VELOCITY_NOISE, velocity, HEALTHY_NOISE["velocity_rad_s"], 0.08)
    return found


def noise_of_clocks(episodes: Sequence[EpisodeEquations]) -> dict[int, float]:
    """Joints of an unknown robot whose noise of positions, rad, would be odd, but is made by time stamps that are not exact.

    Such noise is the speed times the error of the time, so that it is larger where a joint is quick; that of a sensor is not.
    """
    level = _beyond_steps(episodes, _noise_that_is_white)
    found = _odd_among_unknown(episodes[0].plant.is_slide, Sign.POSITION_NOISE, level, HEALTHY_NOISE["position_rad"], 0.05)
    grows = np.median([e.path.by_own_samples(grows_with_speed, e.path.joints.position_rad) for e in episodes], axis=0) > 0.5
    return {f.joint: f.value for f in found if f.joint is not None and grows[f.joint]}


def _beyond_steps(episodes: Sequence[EpisodeEquations], noise: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Noise of positions that rounding to the steps of their encoders does not make, shape (k,)."""
    paths = [episode.path for episode in episodes]
    steps = np.median([path.encoder_step_rad for path in paths], axis=0)
    level = np.median([path.by_own_samples(noise, path.joints.position_rad) for path in paths], axis=0)
    return np.sqrt(np.maximum(level**2 - steps**2 / 12.0, 0.0))


def _noise_that_is_white(series: np.ndarray) -> np.ndarray:
    """White noise of each column, 0 where motion between few samples looks like it, shape (k,)."""
    level = white_noise(series)
    return np.where(white_noise(series[::2]) < _WHITE * level, level, 0.0)


def torque_noise_findings(
    episodes: Sequence[EpisodeEquations], state: JointState, sensed_share: np.ndarray, share_error: np.ndarray
) -> list[Finding]:
    """Noise between what was sent and what was measured, told apart by whether the joint felt it.

    Args:
        episodes: of a study.
        state: the present model.
        sensed_share: share of the difference that the joint did not feel, shape (k,).
        share_error: its standard error.
    """
    differences = [d for episode in episodes if (d := episode.current_difference(state)) is not None]
    if not differences:
        return []
    joined = np.concatenate(differences)
    white = np.median([white_noise(d) for d in differences], axis=0)
    slow = np.sqrt(np.maximum(_autocovariance(joined, 3), 0.0))
    found = _odd(
        Sign.SLOW_FELT_TORQUE,
        np.where(slow > np.maximum(HEALTHY_ACTION_NOISE_NM, SLOW_SHARE * white), slow, 0.0),
        HEALTHY_ACTION_NOISE_NM,
        0.1,
    )
    felt = white * np.sqrt(np.clip(1.0 - sensed_share, 0.0, 1.0))
    felt_low = white * np.sqrt(np.clip(1.0 - sensed_share - 3.0 * share_error, 0.0, 1.0))
    acting = _odd(Sign.FELT_TORQUE, np.where(felt_low > HEALTHY_ACTION_NOISE_NM, felt, 0.0), HEALTHY_ACTION_NOISE_NM, 0.15)
    if not found:
        found += acting
    if not found:
        found += _odd(Sign.TORQUE_NOISE, white, HEALTHY_NOISE["torque_nm"], 0.05)
    return found


def _autocovariance(series: np.ndarray, lag: int) -> np.ndarray:
    """Of the part that lasts for some samples but is no slow drift, shape (k,)."""
    fast = series - np.median(series, axis=0)
    products = fast[lag:] * fast[:-lag]
    return np.median(products, axis=0) / MEDIAN_SQUARE if len(products) else np.zeros(series.shape[1])


def _odd(sign: Sign, levels: np.ndarray, healthy: float, relative_error: float) -> list[Finding]:
    """Joints whose level is odd among the others, or all of them if all are beyond what is healthy."""

    def finding(joint: int | None, value: float, excess: float) -> Finding:
        return Finding(sign, joint, value, (value * (1 - relative_error), value * (1 + relative_error)), excess)

    found = []
    for joint, level in enumerate(levels):
        others = np.delete(levels, joint)
        usual = float(np.median(others)) if len(others) else healthy
        if level > ODD_JOINT * max(usual, _ODD_FLOOR * healthy) and (len(others) > 1 or level > healthy):
            found.append(finding(joint, float(level), float(level / max(usual, _ODD_FLOOR * healthy))))
    if len(found) <= len(levels) // 2 and np.median(levels) > healthy:
        value = float(np.median(levels))
        return [finding(None, value, value / healthy)]
    return found


def _odd_among_unknown(
    is_slide: np.ndarray, sign: Sign, levels: np.ndarray, healthy: float, relative_error: float
) -> list[Finding]:
    """Single joints whose level is far beyond that of others of their kind; without any there is nothing to be beyond."""
    found = []
    for joint, level in enumerate(map(float, levels)):
        others = np.delete(levels, joint)[np.delete(is_slide, joint) == is_slide[joint]]
        excess = level / max(float(np.median(others)), _ODD_FLOOR * healthy) if len(others) else 0.0
        if level > _LEAST_ODD[sign] and excess > (_ODD_AMONG_UNKNOWN if level > healthy else _ODD_THOUGH_SMALL):
            found.append(Finding(sign, joint, level, (level * (1 - relative_error), level * (1 + relative_error)), excess))
    return found


def noisy_motors(episodes: Sequence[EpisodeEquations], state: JointState) -> list[int]:
    """Joints whose motors' torques differ from what was sent by far more than those of the others."""
    differences = [d for episode in episodes if (d := episode.current_difference(state)) is not None]
    if not differences:
        return []
    white = np.median([white_noise(d) for d in differences], axis=0)
    return [j for j in range(len(white)) if white[j] > ODD_MOTOR * np.median(np.delete(white, j))] if len(white) > 2 else []


def fault_findings(episodes: Sequence[EpisodeEquations], size: float | None = None) -> list[Finding]:
    """Joints that do not move, and encoders that jump.

    Args:
        episodes: of a study.
        size: of a robot that is no TriFinger, as :class:`JointState` has it; None for a TriFinger, whose joints are all moved.
    """
    found: list[Finding] = []
    for joint in range(len(episodes[0].ends_rad)):
        stuck = _stuck(episodes, joint) if size is None else _stuck_off_target(episodes, joint, size)
        found += stuck or _jump(episodes, joint)
    return found


def end_findings(episodes: Sequence[EpisodeEquations], state: JointState) -> list[Finding]:
    """Ends of joints that are not where they should be, once encoders are known to be off by what the model says."""
    offsets = encoder_offsets_rad(state)
    return [f for joint, offset in enumerate(offsets) for f in _shifted_end(episodes, joint, float(offset))]


def beside_jumps(findings: Sequence[Finding]) -> list[Finding]:
    """The same without ends of joints that an encoder's jump has moved: what was read before it and after is not one place."""
    jumped = {f.joint: abs(f.value) for f in findings if f.sign is Sign.POSITION_JUMP}
    return [f for f in findings if f.sign not in ENDS or abs(f.value) > jumped.get(f.joint, 0.0) + END_MARGIN_RAD]


def _stuck(episodes: Sequence[EpisodeEquations], joint: int) -> list[Finding]:
    spans, pushes = [], []
    for episode in episodes:
        series = episode.path.fast_position[:, joint]
        spans.append(np.ptp(series))
        pushes.append(np.quantile(np.abs(episode.driving_nm[joint]), 0.99))
    rests = max(spans) <= STUCK_RANGE_RAD and max(pushes) >= STUCK_TORQUE_NM
    creeps = max(spans) <= CREEPING_RANGE_RAD and max(pushes) >= CREEPING_TORQUE_NM
    if not (rests or creeps):
        return []
    held = float(max(pushes))
    return [Finding(Sign.REST_UNDER_LOAD, joint, held, (held, 20.0), held / STUCK_TORQUE_NM)]


def _stuck_off_target(episodes: Sequence[EpisodeEquations], joint: int, size: float) -> list[Finding]:
    """Of any robot: it rests although it was asked to move, and its motor gives torque that the model does not need for resting.

    A joint that was to hold still does so, against gravity too; without targets nobody knows what it was to do.
    """
    spans, asked, needless = [], [], []
    for episode in episodes:
        targets, rows = episode.path.joints.position_target_rad, episode.path.valid[:, joint]
        if targets is None or not rows.any():
            return []
        spans.append(np.ptp(episode.path.fast_position[:, joint]))
        known = targets[:, joint][~np.isnan(targets[:, joint])]
        asked.append(np.ptp(known) if len(known) else 0.0)
        needless.append(np.quantile(np.abs(episode.pressing_nm[rows, joint]), 0.99))
    if max(spans) > STUCK_RANGE_RAD or max(asked) < ASKED_RANGES * STUCK_RANGE_RAD or max(needless) < size * STUCK_TORQUE_NM:
        return []
    held = float(max(needless))
    return [Finding(Sign.REST_UNDER_LOAD, joint, held, (held, 20.0 * size), held / (size * STUCK_TORQUE_NM))]


def _jump(episodes: Sequence[EpisodeEquations], joint: int) -> list[Finding]:
    """The largest jump of the first episode that has any."""
    for index, episode in enumerate(episodes):
        seen = jump_in(episode.path.joints.position_rad[:, joint], float(episode.path.encoder_step_rad[joint]))
        if seen is not None:
            size, error = seen.size_rad, 2.0 * seen.usual_rad
            interval, excess = (size - error, size + error), abs(size) / _JUMP_RAD
            return [Finding(Sign.POSITION_JUMP, joint, size, interval, excess, index, seen.before + 1)]
    return []


@dataclass(frozen=True)
class Jump:
    """After a sample a position is elsewhere and stays so; moves from sample to sample differ by ``usual_rad`` else."""

    before: int
    size_rad: float
    usual_rad: float


def jump_in(position_rad: np.ndarray, step_rad: float) -> Jump | None:
    """The largest step between two samples that a joint's speed does not explain and that stays; None if there is none.

    Args:
        position_rad: as reported, shape (s,), NaN in gaps.
        step_rad: in which its encoder reports, 0 for none.
    """
    moves = np.diff(filled_gaps(position_rad[:, None])[:, 0])
    if len(moves) < 50:
        return None
    usual = float(np.median(np.abs(np.diff(moves)))) / MEDIAN_SIZE
    around = 0.5 * (np.roll(moves, 2) + np.roll(moves, -2))
    odd = np.where(_near_gap(position_rad), 0.0, np.abs(moves - around))
    at = int(np.argmax(odd[5:-5])) + 5
    before, after = moves[at - 3 : at], moves[at + 1 : at + 4]
    size = float(moves[at] - np.median(np.concatenate([before, after])))
    is_clear = abs(size) > max(_JUMP_RAD, 12.0 * usual, _STEPS_OF_JUMP * step_rad)
    is_clear = is_clear and max(np.ptp(before), np.ptp(after)) < 0.3 * abs(size)
    return Jump(at, size, usual) if is_clear and not _catches_up(moves, at) else None


def _catches_up(moves: np.ndarray, at: int) -> bool:
    """Whether positions that stood still for some samples, but for noise, come after the motion that went on: that is no jump.

    How fast it went on nobody saw: a controller that is told that its joint stands lets it go faster, or turn. At one end of the
    time it is fastest.
    """
    stall, slow = 0, _STALLED * abs(float(np.mean(moves[at + 1 : at + 1 + _STALL_SAMPLES])))
    while stall < at and abs(moves[at - 1 - stall]) <= slow:
        stall += 1
    if stall < _STALL_SAMPLES:
        return False
    ends = moves[: at - stall][-_STALL_SAMPLES:], moves[at + 1 : at + 1 + _STALL_SAMPLES]
    missed = stall * max(float(part.sum()) / max(len(part), 1) * np.sign(moves[at]) for part in ends)
    return 0.5 * abs(moves[at]) < missed


def _near_gap(position_rad: np.ndarray) -> np.ndarray:
    """Moves from sample to sample beside a gap, where a filled-in line turns off; shapes (s,) and (s - 1,)."""
    near = np.convolve(np.isnan(position_rad), np.ones(9), mode="same") > 0.5
    return near[1:] | near[:-1]


def _shifted_end(episodes: Sequence[EpisodeEquations], joint: int, offset_rad: float) -> list[Finding]:
    """An end that is passed, or a place inside the range where the joint is held although the motor presses outwards."""
    found: list[Finding] = []
    for side, sign in ((0, Sign.LOWER_END), (1, Sign.UPPER_END)):
        end = float(episodes[0].ends_rad[joint, side]) + offset_rad
        if not np.isfinite(end):
            continue
        outward = 1.0 if side else -1.0
        held = []
        for episode in episodes:
            q = episode.path.position[:, joint]
            still = np.abs(episode.path.velocity[:, joint]) < 0.05
            pressing = outward * episode.pressing_nm[:, joint]
            near = np.abs(q - end) < 0.3
            held += list(q[still & (pressing > _PRESSING_NM) & near])
        if len(held) < 8:
            continue
        shift = float(np.median(np.array(held)) - end)
        if abs(shift) > END_MARGIN_RAD:
            error = max(_SOFT_END_RAD, float(np.std(held)))
            found.append(
                Finding(
                    sign,
                    joint,
                    shift,
                    (shift - Z_90 * error, shift + Z_90 * error),
                    abs(shift) / END_MARGIN_RAD,
                )
            )
    return found


def place(names: tuple[str, ...], joint: int | None) -> str:
    """Name of a joint, or all of them."""
    return ALL_JOINTS if joint is None else names[joint]
