"""What is left when all causes are in the model, and what it follows: a flexible function of one variable after the other.

Each function is a sum of hats over a variable, fitted to the whitened residual of one equation of one joint. Its gain is the
upper bound of what any cause that acts through this variable could still explain, and which variable gains most says where to
look.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel
from sim_backend.reality_gap.measured.sensor_noise import position_noise
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations, Equation
from sim_backend.reality_gap.subjects.joints.torques.look import Look
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import FOLDS, folds_of, normal_equations, reduced, whitened

HATS = 9
BEYOND_NOISE = 10.0
"""Standard deviations of a variable's own noise from knot to knot at least.

The noise of the positions is in the variable and in the residual alike: a finer function would follow more than a hundredth of
what it makes of the residual, whatever the robot does.
"""
_SCALE = {Channel.MECHANICS: 0.02, Channel.CURRENT: 0.02, Channel.CONTROLLER: 0.05, Channel.VELOCITY: 0.05}
_HEAT_S = 10.0
_LASTING = 0.4
"""Share of a gain that must be left without any two stretches. A joint that stuck once in 280 s had made 354 nats, all in one."""
VARIABLES = ("velocity", "position", "torque", "load against motion", "acceleration", "time", "time since reversal", "heat")


@dataclass(frozen=True)
class Pattern:
    """A residual that follows a variable: which equation of which joint, and what a function of it gains (nats)."""

    channel: Channel
    joint: int
    variable: str
    gain: float


def patterns(episodes: Sequence[EpisodeEquations], look: Look, size: float = 1.0) -> list[Pattern]:
    """All patterns in what a model leaves, the strongest first.

    Args:
        episodes: of the study.
        look: at the final model.
        size: of the robot, as :class:`JointState` has it: a larger one's torques may be off by more.
    """
    found: dict[tuple[Channel, int, str], float] = {}
    variables = [variables_of(episode) for episode in episodes]
    for equation in look.left:
        for name, (values, noise) in variables[equation.episode].items():
            series = np.interp(equation.time_s, episodes[equation.episode].path.time_s, values[:, equation.joint])
            gain = _gain(equation, hats(series, BEYOND_NOISE * noise[equation.joint]), size)
            key = (equation.channel, equation.joint, name)
            found[key] = found.get(key, 0.0) + gain
    ranked = [Pattern(channel, joint, name, gain) for (channel, joint, name), gain in found.items()]
    return sorted(ranked, key=lambda p: -p.gain)


def _gain(equation: Equation, hats: np.ndarray, size: float) -> float:
    """What hats gain, or what is left of it without the stretches that speak for them most, two neighbours at a time."""
    by = size if equation.channel in (Channel.MECHANICS, Channel.CURRENT) else 1.0
    scales = np.full(hats.shape[1], by * _SCALE[equation.channel])
    terms = tuple(range(hats.shape[1]))
    white = whitened(replace(equation, images=hats, terms=terms), scales, folds_of(equation, episodes=1))
    if white is None:
        return 0.0
    sums = normal_equations([white], len(terms), FOLDS)
    pairs = 1.0 - np.eye(FOLDS) - np.roll(np.eye(FOLDS), 1, axis=1)  # a moment may lie across the border of two
    whole, *without = (reduced(sums.weighted(weights), (), ()).gain(terms, scales) for weights in (np.ones(FOLDS), *pairs))
    return lasting(whole, min(without))


def lasting(whole: float, least: float) -> float:
    """A gain in nats, or the least that is left of it without some stretches if most went with them: one moment is no pattern."""
    return whole if whole <= 0.0 or least > _LASTING * whole else least


def shares(episodes: Sequence[EpisodeEquations], state: JointState, joint: int) -> dict[str, float]:
    """Of a joint's torque error with a model, the share of the variance that a function of each variable takes away."""
    counted = [episode.valid_mechanics[:, joint] for episode in episodes]
    error = np.concatenate([e.torque_error(state)[rows, joint] for e, rows in zip(episodes, counted, strict=True)])
    variables, found = [variables_of(episode) for episode in episodes], {}
    for name in VARIABLES:
        series = np.concatenate([v[name][0][rows, joint] for v, rows in zip(variables, counted, strict=True)])
        columns = hats(series, BEYOND_NOISE * max(float(v[name][1][joint]) for v in variables))
        left = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
        found[name] = 1.0 - float(left @ left) / max(float(error @ error), 1e-30)
    return found


def hats(series: np.ndarray, apart: float) -> np.ndarray:
    """Linear between quantiles of the series, as far as they are ``apart``; shape (r, m) with m of at most ``HATS``."""
    knots: list[float] = []
    for knot in np.unique(np.quantile(series, np.linspace(0.0, 1.0, HATS))):
        if not knots or knot - knots[-1] > apart:
            knots.append(float(knot))
    if len(knots) < 3:
        return np.zeros((len(series), 1))
    return np.stack([np.interp(series, knots, row) for row in np.eye(len(knots))], axis=1)


def variables_of(episode: EpisodeEquations) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What residuals may follow, each of shape (t, k), and its noise, shape (k,)."""
    path = episode.path
    positions = position_noise(path.joints.position_rad)
    speeds, none = path.velocity_noise(positions), np.zeros(len(positions))
    way = np.sign(path.velocity) * np.clip(np.abs(path.velocity) / (BEYOND_NOISE * speeds) - 1.0, 0.0, 1.0)
    torque = path.averaged(episode.driving_nm).T
    time_s = np.repeat(path.time_s[:, None], torque.shape[1], axis=1)
    row_s = path.step_s * path.every
    values = (
        (path.velocity, speeds),
        (path.position, positions),
        (torque, none),
        (torque * way, none),
        (path.acceleration, path.acceleration_noise(positions)),
        (time_s, none),
        (since_reversal_s(path.velocity, row_s), none),
        (heat(torque, row_s), none),
    )
    return dict(zip(VARIABLES, values, strict=True))


def since_reversal_s(velocity: np.ndarray, step_s: float) -> np.ndarray:
    """Time since each joint last turned round, at most 1 s; shapes (t, k)."""
    turned = np.zeros(velocity.shape, bool)
    turned[1:] = np.sign(velocity[1:]) != np.sign(velocity[:-1])
    rows = np.arange(len(velocity))[:, None]
    last = np.maximum.accumulate(np.where(turned, rows, -(10**9)), axis=0)
    return np.minimum((rows - last) * step_s, 1.0)


def heat(torque_nm: np.ndarray, step_s: float) -> np.ndarray:
    """Torque squared, through a first-order filter of 10 s: what warms a motor; shapes (t, k)."""
    share, out, level = step_s / _HEAT_S, np.empty_like(torque_nm), np.zeros(torque_nm.shape[1])
    for row, squared in enumerate(torque_nm**2):
        level = level + share * (squared - level)
        out[row] = level
    return out
