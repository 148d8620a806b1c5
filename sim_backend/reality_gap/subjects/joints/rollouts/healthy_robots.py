"""How far robots end up from their model that nothing is wrong with: drawn within the tolerances, in a study's own windows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.unnamed_laws import BEARING
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import TOLERATED, ends_of, moved_by, step_within
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Windows
from sim_backend.reality_gap.subjects.joints.rollouts.linearisation import SAMPLES_OF_WINDOW, probed
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import (
    FAR_SHARE,
    RolloutFit,
    RolloutProblem,
)

_AT_ONCE = 20
"""Healthy robots that are simulated together."""
_USUAL = 0.95
"""Share of robots that nothing is wrong with that are off by no more."""
_STEPS, _SHARES = 4, (1.0, 0.4, 0.15)
"""A model is fitted to each drawn robot in so many steps, each as far as the robot is nearer there."""
_MARGIN, _MARGIN_OF_RIGID = 3.5, 5.0
"""Times what drawn robots are off: the recorded one is fitted to more windows, and has errors that nobody draws.

Of 60 healthy arms of the second generator (seed 657713) eight were somewhere off by more than 5 times the noise and 0.3 % of
their motion: seven of them at most 0.8 times as far as 95 % of those drawn for them, one 2.6 times, in far windows 1.6 times.
More where bearings are simulated as if they did not give: of 60 arms of seed 763475 17 were then further off than is enough
there, in usual windows 0.4 to 4.6 times as far as those drawn, in far ones 16 of them up to 3.3 times.
"""
_CLOSELY, _DECIDE = 20, 2
"""So many drawn robots are fitted closely; fewer if so many of them are far enough off to decide."""


@dataclass(frozen=True)
class Enough:
    """What is near enough whatever healthy robots are; shapes (k,).

    Attributes:
        usual_rad: in usual windows.
        far_rad: in far ones, where all windows are off alike.
        few_rad: in far ones, where most windows are much nearer.
        apart: times as far as usual windows that far ones move.
    """

    usual_rad: np.ndarray
    far_rad: np.ndarray
    few_rad: np.ndarray
    apart: np.ndarray


@dataclass(frozen=True)
class Healthy:
    """What windows of healthy robots end up off, of all but 5 % of the robots no more at any joint; shapes (k,), rad.

    Attributes:
        as_it_is_rad: usual windows from the model as it was given.
        fitted_rad: from a model that was fitted within the tolerances: what bends with a tolerated error, and noise.
        fitted_far_rad: what nine windows of ten stay below there.
        margin: times of it that a recorded robot may be off.
    """

    as_it_is_rad: np.ndarray
    fitted_rad: np.ndarray
    fitted_far_rad: np.ndarray
    margin: float = _MARGIN


class DrawnRobots:
    """Robots drawn within the tolerances, simulated in windows of a study, with the noise of its encoders and torques.

    To each, as to the recorded one, a model is fitted within the tolerances whose windows begin where they fit best, and the
    median of its errors and the ninth of ten count.

    Args:
        problem: whose windows.
        rng: draws.
        draws: robots.
        around: the model about which they are drawn, whose causes are fitted, too; the nominal one if None.
    """

    def __init__(
        self, problem: RolloutProblem, rng: np.random.Generator, draws: int = 200, around: RolloutFit | None = None
    ) -> None:
        rows = np.linspace(0, len(problem.windows) - 1, min(LEAST_WINDOWS, len(problem.windows))).astype(int)
        own = [] if around is None else list(zip(around.terms, around.scales, strict=True))[: around.causes]
        state, begin = (problem.start, problem.begin()) if around is None else (around.state, around.begin)
        begin, loose = (begin[0][rows], begin[1][rows]), problem.beside(state, [term for term, _ in own])
        terms, scales = [term for term, _ in (*own, *loose)], np.array([scale for _, scale in (*own, *loose)])
        self._part, self._state, self._begin, self._terms, self._causes = problem.part(rows), state, begin, terms, len(own)
        self._model = _Model(problem, self._part.windows, state, begin, terms)
        margin = _MARGIN if problem.forward.has_bearings else _MARGIN_OF_RIGID
        if not self._model.fine.any():
            self._robots, self._off = np.empty((0, 0, 0)), np.empty((0, len(terms)))
            self.coarse = Healthy(problem.noise_rad, problem.noise_rad, problem.noise_rad, margin)
            return
        varies = np.array([i >= len(own) and term.key != CLOCK for i, term in enumerate(terms)])
        off = scales * varies * np.clip(rng.standard_normal((draws, len(terms))), -TOLERATED, TOLERATED)
        bears = self._model.bears
        off[:, bears] = np.abs(off[:, bears]) - self._model.given[bears]
        robots = self._model.went(off, rng)
        widest = np.nanmax(np.abs(robots - self._model.nominal), initial=0.0)
        robots = np.where(np.isfinite(robots), robots, self._model.nominal + widest)  # what diverges is as far as any
        noise = np.tile(problem.noise_rad, robots.shape[2] // len(problem.noise_rad))
        self._robots = robots + noise * rng.standard_normal(robots.shape)
        weights = np.sqrt(SAMPLES_OF_WINDOW / self._part.windows.position_rad.shape[1]) / noise
        self._close = dict[int, RolloutFit]()
        self._off, as_it_is, fitted = self._model.left(self._robots, scales, len(own), weights)
        squares = [(left.reshape(*left.shape[:2], -1, len(problem.noise_rad)) ** 2).mean(axis=2) for left in (as_it_is, fitted)]
        self._usual_rad, self._far_rad = (np.sqrt(np.quantile(squares[1], share, axis=1)) for share in (0.5, FAR_SHARE))
        as_it_is_rad = _below(np.sqrt(np.median(squares[0], axis=1)))
        self.coarse = Healthy(as_it_is_rad, _below(self._usual_rad), _below(self._far_rad), margin)
        """Limits after a few steps from the model, all along its first linearisation: where it bends they are too wide."""

    def closely(
        self,
        enough: Enough,
        asked_rad: np.ndarray,
        asked_far_rad: np.ndarray,
        progress: Callable[[str, float], None] = lambda *_: None,
    ) -> Healthy:
        """Limits of some of the robots, to each of which a model is fitted once more, all anew, from where coarse steps led.

        Of both fits to a robot the nearer one counts: what friction holds may lead the closer one away.

        Args:
            enough: robots below it in usual windows and in far ones are near enough.
            asked_rad: what limits are compared with, shape (k,): no more robots are fitted once they are clearly above it.
            asked_far_rad: the same of far windows.
            progress: told which share is done.
        """
        if not len(self._robots):
            return self.coarse
        usual_rad, far_rad, done = self._usual_rad[:_CLOSELY].copy(), self._far_rad[:_CLOSELY].copy(), 0
        for robot in range(len(usual_rad)):
            if (usual_rad[robot] > enough.usual_rad).any() or (far_rad[robot] > enough.far_rad).any():
                progress("fitting models to healthy robots", robot / len(usual_rad))
                fit = self._closely_fitted(robot)
                if _off(fit.usual_rad, fit.far_rad) < _off(usual_rad[robot], far_rad[robot]):
                    usual_rad[robot], far_rad[robot] = fit.usual_rad, fit.far_rad
            done = robot + 1
            above = (usual_rad[:done] >= asked_rad).sum(axis=0), (far_rad[:done] >= asked_far_rad).sum(axis=0)
            if min(counts.min() for counts in above) >= _DECIDE:
                break
        return replace(self.coarse, fitted_rad=_below(usual_rad[:done]), fitted_far_rad=_below(far_rad[:done]))

    def _closely_fitted(self, robot: int) -> RolloutFit:
        """The model that is fitted to a robot, probed anew at each step; each robot's is made once."""
        if robot not in self._close:
            fine = np.flatnonzero(self._model.fine)
            part = self._part.part(fine)
            went = self._robots[robot][fine].reshape(part.windows.position_rad.shape)
            part.windows = replace(part.windows, position_rad=went)
            there = moved_by(self._state, self._terms, self._off[robot])
            begin = self._begin[0][fine], self._begin[1][fine]
            self._close[robot] = part.fitted(there, self._terms[: self._causes], begin)
        return self._close[robot]


def _off(usual_rad: np.ndarray, far_rad: np.ndarray) -> float:
    """How far off windows are, of all joints, each by its own measure."""
    return float(np.log(usual_rad).sum() + np.log(far_rad).sum())


def _below(off_rad: np.ndarray) -> np.ndarray:
    """What nearly all robots stay below at every joint, shape (k,), of what they are off, shape (draws, k).

    Of many joints one is further off than its own usual more often than each of them: all limits are raised alike.
    """
    usual_rad = np.quantile(off_rad, _USUAL, axis=0)
    return usual_rad * max(1.0, float(np.quantile((off_rad / usual_rad).max(axis=1), _USUAL)))


class _Model:
    """A model in windows, where it goes, and what its start and terms change there.

    Attributes:
        nominal: where it goes, shape (n, s * k).
        fine: windows in which all of it is finite, shape (n,).
        bears: terms that are numbers of bearings, which are not below none, shape (m,).
        given: values that the model has, shape (m,).
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
        self.bears = np.array([term.key in BEARING for term in terms], bool)
        self.given = np.array([float(state.value(term.key)[term.index]) for term in terms])
        self._ends = np.array([ends_of(state, term) for term in terms]).reshape(-1, 2) - self.given[:, None]

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

    def left(
        self, robots: np.ndarray, scales: np.ndarray, causes: int, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Terms fitted to robots, (draws, m), and what they are off from the model as it is and as fitted, (draws, n, s * k).

        Args:
            robots: where they went, shape (draws, n, s * k).
            scales: standard deviations of the terms.
            causes: number of the first terms, which go as far as the catalogue.
            weights: of each sample, shape (s * k,), one over its noise.
        """
        fine, joints = self.fine, self._begin[0].shape[1]
        by_term, at_start = weights[:, None] * self._by_term[fine], weights[:, None] * self._at_start[fine]
        robots, nominal = robots[:, fine] * weights, self.nominal[fine] * weights
        begun = np.linalg.pinv(at_start)
        free = by_term - at_start @ (begun @ by_term)
        of_joint = free.reshape(len(free), -1, joints, len(scales))
        informs = np.einsum("nsjm,nsjl->jml", of_joint, of_joint, optimize=True)
        is_cause = np.arange(len(scales)) < causes
        most = np.where(is_cause, self._ends[:, 1], TOLERATED * scales)
        least = np.where(is_cause, self._ends[:, 0], np.where(self.bears, -self.given, -most))
        most = np.where(self.bears, most - self.given, most)
        first = np.where(self.bears, self.given, 0.0)

        def best_begun(error: np.ndarray) -> np.ndarray:
            """Errors where windows begin as fits best, by a straight line: they began where the robot did."""
            return error - np.einsum("nab,dnb->dna", at_start, np.einsum("nba,dna->dnb", begun, error))

        def squares(error: np.ndarray) -> np.ndarray:
            return (error.reshape(len(error), len(nominal), -1, joints) ** 2).mean(axis=2)

        off, error, going = np.zeros((len(robots), len(scales))), best_begun(robots - nominal), np.arange(len(robots))
        as_it_is = error.copy()
        for _ in range(_STEPS):
            noise = np.maximum(np.median(squares(error), axis=1), 1.0)
            loss = np.log1p(squares(error) / noise[:, None]).sum(axis=(1, 2))
            precision = np.einsum("dj,jml->dml", 1.0 / noise, informs) + np.diag(1.0 / scales**2)
            weighed = error.reshape(len(error), len(nominal), -1, joints) / noise[:, None, None]
            pull = np.einsum("nsjm,dnsj->dm", of_joint, weighed, optimize=True) - (off + first) / scales**2
            change = np.array(
                [step_within(p, q, least - here, most - here) for p, q, here in zip(precision, pull, off, strict=True)]
            )
            nearer = np.zeros(len(robots), bool)
            for share in _SHARES:
                rows = going[~nearer[going]]
                if not len(rows):
                    break
                there = off[rows] + share * change[rows]
                went = self.went(there)[:, fine] * weights
                rest = best_begun(np.where(np.isfinite(went), robots[rows] - went, np.inf))
                now = np.nan_to_num(np.log1p(squares(rest) / noise[rows, None]).sum(axis=(1, 2)), nan=np.inf)
                took = now < loss[rows]
                chosen = rows[took]
                off[chosen], error[chosen] = there[took], rest[took]
                nearer[chosen] = True
            going = going[nearer[going]]
        return off, as_it_is / weights, error / weights


def _noisy(problem: RolloutProblem, windows: Windows, rng: np.random.Generator) -> Windows:
    """Driven by torques that were measured with noise, or by a controller that sees noisy positions and velocities."""
    shape, law = windows.sent_nm.shape, windows.feedback
    felt = windows.sent_nm + problem.torque_noise_nm * rng.standard_normal(shape)
    if law is not None:
        position = law.stiffness_nm_rad * problem.noise_rad * rng.standard_normal(law.target_rad.shape)
        velocity = law.damping_nm_s_rad * problem.velocity_noise_rad_s * rng.standard_normal(law.target_rad.shape)
        law = replace(law, desired_nm=law.desired_nm - position - velocity)
    return replace(windows, sent_nm=felt, feedback=law)
