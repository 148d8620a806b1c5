"""What is left when all causes are in the model, and what it follows: a flexible function of one variable after the other.

Each function is a sum of hats over a variable, fitted to the whitened residual of one equation of one joint. Its gain is the
upper bound of what any cause that acts through this variable could still explain, and which variable gains most says where to
look.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.joints.equations import Channel, EpisodeEquations, Equation
from sim_backend.reality_gap.joints.evidence import FOLDS, folds_of, normal_equations, reduced, whitened
from sim_backend.reality_gap.joints.look import Look

HATS = 9
_SCALE = {Channel.MECHANICS: 0.02, Channel.CURRENT: 0.02, Channel.CONTROLLER: 0.05, Channel.VELOCITY: 0.05}
_HEAT_S = 10.0
VARIABLES = ("velocity", "position", "torque", "load against motion", "acceleration", "time", "time since reversal", "heat")


@dataclass(frozen=True)
class Pattern:
    """A residual that follows a variable: which equation of which joint, and what a function of it gains (nats)."""

    channel: Channel
    joint: int
    variable: str
    gain: float


def patterns(episodes: Sequence[EpisodeEquations], look: Look) -> list[Pattern]:
    """All patterns in what a model leaves, the strongest first.

    Args:
        episodes: of the study.
        look: at the final model.
    """
    found: dict[tuple[Channel, int, str], float] = {}
    variables = [_variables(episode) for episode in episodes]
    for equation in look.left:
        for name, values in variables[equation.episode].items():
            series = np.interp(equation.time_s, episodes[equation.episode].path.time_s, values[:, equation.joint])
            gain = _gain(equation, _hats(series), len(episodes))
            key = (equation.channel, equation.joint, name)
            found[key] = found.get(key, 0.0) + gain
    ranked = [Pattern(channel, joint, name, gain) for (channel, joint, name), gain in found.items()]
    return sorted(ranked, key=lambda p: -p.gain)


def _gain(equation: Equation, hats: np.ndarray, episodes: int) -> float:
    scales = np.full(hats.shape[1], _SCALE[equation.channel])
    terms = tuple(range(hats.shape[1]))
    white = whitened(replace(equation, images=hats, terms=terms), scales, folds_of(equation, episodes))
    if white is None:
        return 0.0
    sums = normal_equations([white], len(terms), FOLDS)
    return reduced(sums.weighted(np.ones(FOLDS)), (), ()).gain(terms, scales)


def _hats(series: np.ndarray) -> np.ndarray:
    """Shape (r, HATS): linear between the quantiles of the series."""
    knots = np.unique(np.quantile(series, np.linspace(0.0, 1.0, HATS)))
    if len(knots) < 3:
        return np.zeros((len(series), 1))
    return np.stack([np.interp(series, knots, row) for row in np.eye(len(knots))], axis=1)


def _variables(episode: EpisodeEquations) -> dict[str, np.ndarray]:
    """What residuals may follow, each of shape (t, k)."""
    path = episode.path
    torque = path.averaged(episode.driving_nm).T
    time_s = np.repeat(path.time_s[:, None], torque.shape[1], axis=1)
    row_s = path.step_s * path.every
    values = (
        path.velocity,
        path.position,
        torque,
        torque * np.sign(path.velocity),
        path.acceleration,
        time_s,
        since_reversal_s(path.velocity, row_s),
        heat(torque, row_s),
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
