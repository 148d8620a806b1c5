"""How far robots end up from their model that nothing is wrong with: drawn within the tolerances, in a study's own windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.forward import Windows
from sim_backend.reality_gap.subjects.joints.linearisation import SAMPLES_OF_WINDOW, probed
from sim_backend.reality_gap.subjects.joints.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollout_fit import FAR_SHARE, TOLERATED, RolloutFit, RolloutProblem, moved_by
from sim_backend.reality_gap.subjects.joints.state import CLOCK, JointState, Term

_AT_ONCE = 20
"""Healthy robots that are simulated together."""
_USUAL = 0.95
"""Share of robots that nothing is wrong with that are off by no more."""
_STEPS, _SHARES = 4, (1.0, 0.4, 0.15)
"""A model is fitted to each drawn robot in so many steps, each as far as the robot is nearer there."""


@dataclass(frozen=True)
class Healthy:
    """What windows of healthy robots end up off, of all but 5 % of the robots no more at any joint; shapes (k,), rad.

    Attributes:
        as_it_is_rad: usual windows from the model as it was given.
        fitted_rad: from a model that was fitted within the tolerances: what bends with a tolerated error, and noise.
        fitted_far_rad: what nine windows of ten stay below there.
    """

    as_it_is_rad: np.ndarray
    fitted_rad: np.ndarray
    fitted_far_rad: np.ndarray


def draw_healthy(
    problem: RolloutProblem, rng: np.random.Generator, draws: int = 200, around: RolloutFit | None = None
) -> Healthy:
    """Draw robots within the tolerances and simulate them in windows of a study, with the noise of its encoders and torques.

    To each, as to the recorded one, a model is fitted within the tolerances whose windows begin where they fit best, and the
    median of its errors and the ninth of ten count.

    Args:
        problem: whose windows.
        rng: draws.
        draws: robots.
        around: the model about which they are drawn, whose causes are fitted, too; the nominal one if None.
    """
    rows = np.linspace(0, len(problem.windows) - 1, min(LEAST_WINDOWS, len(problem.windows))).astype(int)
    windows, loose = problem.windows.some(rows), problem.loose_terms(() if around is None else around.terms[: around.causes])
    own = [] if around is None else list(zip(around.terms, around.scales, strict=True))[: around.causes]
    state, begin = (problem.start, problem.begin()) if around is None else (around.state, around.begin)
    terms, scales = [term for term, _ in (*own, *loose)], np.array([scale for _, scale in (*own, *loose)])
    model = _Model(problem, windows, state, (begin[0][rows], begin[1][rows]), terms)
    if not model.fine.any():
        return Healthy(problem.noise_rad, problem.noise_rad, problem.noise_rad)
    varies = np.array([i >= len(own) and term.key != CLOCK for i, term in enumerate(terms)])
    off = scales * varies * np.clip(rng.standard_normal((draws, len(terms))), -TOLERATED, TOLERATED)
    robots = model.went(off, rng)
    widest = np.nanmax(np.abs(robots - model.nominal), initial=0.0)
    robots = np.where(np.isfinite(robots), robots, model.nominal + widest)  # what diverges is as far as any
    noise = np.tile(problem.noise_rad, robots.shape[2] // len(problem.noise_rad))
    robots = robots + noise * rng.standard_normal(robots.shape)
    as_it_is, fitted = model.left(robots, scales, len(own), np.sqrt(SAMPLES_OF_WINDOW / windows.position_rad.shape[1]) / noise)
    shares = ((as_it_is, 0.5), (fitted, 0.5), (fitted, FAR_SHARE))
    joints = len(problem.noise_rad)
    return Healthy(*(_below(left.transpose(1, 2, 0), joints, share) for left, share in shares))


def _below(left_rad: np.ndarray, joints: int, share: float) -> np.ndarray:
    """Of errors (n, s * k, draws) what a share of the windows of nearly all robots stays below at every joint, shape (k,).

    Of many joints one is further off than its own usual more often than each of them: all limits are raised alike.
    """
    squares = (left_rad.reshape(len(left_rad), -1, joints, left_rad.shape[2]) ** 2).mean(axis=1)
    off_rad = np.sqrt(np.quantile(squares, share, axis=0))
    usual_rad = np.quantile(off_rad, _USUAL, axis=1)
    return usual_rad * max(1.0, float(np.quantile((off_rad.T / usual_rad).max(axis=1), _USUAL)))


class _Model:
    """A model in windows, where it goes, and what its start and terms change there.

    Attributes:
        nominal: where it goes, shape (n, s * k).
        fine: windows in which all of it is finite, shape (n,).
    """

    def __init__(
        self,
        problem: RolloutProblem,
        windows: Windows,
        state: JointState,
        begin: tuple[np.ndarray, np.ndarray],
        terms: Sequence[Term],
    ) -> None:
        n, m = len(windows), len(terms)
        self._problem, self._windows, self._state, self._begin, self._terms = problem, windows, state, begin, terms
        went, moves = probed(problem.forward, windows, state, terms, begin)
        moves = moves.reshape(len(moves), n, -1).transpose(1, 2, 0)
        self.nominal, self._by_term, self._at_start = went.reshape(n, -1), moves[:, :, :m], moves[:, :, m:]
        self.fine = np.isfinite(moves).all(axis=(1, 2))

    def went(self, off: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
        """Where models go that differ from this one, shape (models, n, s * k), rad.

        Args:
            off: by how much each term differs, shape (models, m).
            rng: torques are measured with noise, or a controller sees noisy positions and velocities; none if None.
        """
        n, found = len(self._windows), []
        for some in (off[first : first + _AT_ONCE] for first in range(0, len(off), _AT_ONCE)):
            states = [moved_by(self._state, self._terms, change) for change in some]
            many = self._windows.some(np.tile(np.arange(n), len(states)))
            many = many if rng is None else _noisy(self._problem, many, rng)
            begin_rad, begin_rad_s = (np.tile(begin, (len(states), 1)) for begin in self._begin)
            which = np.repeat(np.arange(len(states)), n)
            went = self._problem.forward.positions(many, begin_rad, begin_rad_s, states, which)
            found.append(went.reshape(len(states), n, -1))
        return np.concatenate(found)

    def left(self, robots: np.ndarray, scales: np.ndarray, causes: int, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What robots are off from this model as it is, and from those that are fitted to them, (draws, n, s * k), rad.

        Args:
            robots: where they went, shape (draws, n, s * k).
            scales: standard deviations of the terms.
            causes: number of the first terms, whose values no tolerance limits.
            weights: of each sample, shape (s * k,), one over its noise.
        """
        fine, joints = self.fine, self._begin[0].shape[1]
        by_term, at_start = weights[:, None] * self._by_term[fine], weights[:, None] * self._at_start[fine]
        robots, nominal = robots[:, fine] * weights, self.nominal[fine] * weights
        begun = np.linalg.pinv(at_start)
        free = by_term - at_start @ (begun @ by_term)
        of_joint = free.reshape(len(free), -1, joints, len(scales))
        informs = np.einsum("nsjm,nsjl->jml", of_joint, of_joint, optimize=True)
        most = np.where(np.arange(len(scales)) < causes, np.inf, TOLERATED * scales)

        def best_begun(error: np.ndarray) -> np.ndarray:
            """Errors where windows begin as fits best, by a straight line: they began where the robot did."""
            return error - np.einsum("nab,dnb->dna", at_start, np.einsum("nba,dna->dnb", begun, error))

        def squares(error: np.ndarray) -> np.ndarray:
            return (error.reshape(len(error), len(nominal), -1, joints) ** 2).mean(axis=2)

        off, error, going = np.zeros((len(robots), len(scales))), best_begun(robots - nominal), np.arange(len(robots))
        as_it_is = error.copy()
        for _ in range(_STEPS):
            noise = np.maximum(np.median(squares(error), axis=1), 1.0)
            least = np.log1p(squares(error) / noise[:, None]).sum(axis=(1, 2))
            precision = np.einsum("dj,jml->dml", 1.0 / noise, informs) + np.diag(1.0 / scales**2)
            weighed = error.reshape(len(error), len(nominal), -1, joints) / noise[:, None, None]
            pull = np.einsum("nsjm,dnsj->dm", of_joint, weighed, optimize=True) - off / scales**2
            change = np.clip(off + np.linalg.solve(precision, pull[..., None])[..., 0], -most, most) - off
            nearer = np.zeros(len(robots), bool)
            for share in _SHARES:
                rows = going[~nearer[going]]
                if not len(rows):
                    break
                there = off[rows] + share * change[rows]
                went = self.went(there)[:, fine] * weights
                rest = best_begun(np.where(np.isfinite(went), robots[rows] - went, np.inf))
                now = np.nan_to_num(np.log1p(squares(rest) / noise[rows, None]).sum(axis=(1, 2)), nan=np.inf)
                took = now < least[rows]
                chosen = rows[took]
                off[chosen], error[chosen] = there[took], rest[took]
                nearer[chosen] = True
            going = going[nearer[going]]
        return as_it_is / weights, error / weights


def _noisy(problem: RolloutProblem, windows: Windows, rng: np.random.Generator) -> Windows:
    """Driven by torques that were measured with noise, or by a controller that sees noisy positions and velocities."""
    shape, law = windows.sent_nm.shape, windows.feedback
    felt = windows.sent_nm + problem.torque_noise_nm * rng.standard_normal(shape)
    if law is not None:
        position = law.stiffness_nm_rad * problem.noise_rad * rng.standard_normal(shape)
        velocity = law.damping_nm_s_rad * problem.velocity_noise_rad_s * rng.standard_normal(shape)
        law = replace(law, desired_nm=law.desired_nm - position - velocity)
    return replace(windows, sent_nm=felt, feedback=law)
