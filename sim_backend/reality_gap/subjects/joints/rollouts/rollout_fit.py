"""Models fitted to where a robot went: windows of recordings, simulated from free initial states.

Equations along a motion compare torques in each moment, so that noise of a torque that a controller makes of positions counts as
much as the torque itself. A simulated window integrates it away, and its error is what a user of the model will have.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import POSITION_GAIN
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.knowledge.unnamed_laws import BEARING
from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.laws.body_law import KEYS as BODY_KEYS
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Catalogue
from sim_backend.reality_gap.subjects.joints.laws.motor_law import FRICTION
from sim_backend.reality_gap.subjects.joints.laws.motor_law import KEYS as MOTOR_KEYS
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import TOLERATED, apart, moved_by, room_of, step_within
from sim_backend.reality_gap.subjects.joints.rollouts.forward import LONGEST_IN_LOOP_S, LONGEST_STEP_S, Forward
from sim_backend.reality_gap.subjects.joints.rollouts.linearisation import PROBES, SAMPLES_OF_WINDOW, Linearised, linearised
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import moves, torque_noise_nm, windows_of
from sim_backend.reality_gap.subjects.joints.rollouts.tolerated import tolerated
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

LENGTHS_S = (1.0, 0.5, 0.25)
"""Of windows, the longest first: the first is taken in which a disturbed start does not grow."""
FOLDS = 3
"""Parts into which recordings of one regime are divided, each foretold by the others."""
_GROWS = 2.0
_FINEST_S = 0.002
"""Faster recordings are compared this far apart."""
FAR_SHARE = 0.9
"""Of windows."""
_TAILS = 4.0
"""Squares of a window's error, over the usual, beyond which it counts less and less."""
_ITERATIONS, _QUICK_ITERATIONS, _STARTS_ALONE = 6, 5, 3
_ENOUGH, _DAMPING = 1e-3, 1e-3
_SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a step, until errors fall."""
_SETTLES = 0.25
"""After a step by which squares of windows fell by less, in the mean of their logarithms, a model bends no more: what tolerances
and begins of windows change there is as it was.
"""
_WIDE = 10.0
"""Standard deviations of what a cause's numbers may be, in their scales: what no window shows stays where it is."""
_FLOOR = 2.0
"""Times an encoder's noise: errors below it are as good as none."""
FAR_WINDOWS = 3.0
"""Times what a usual window may be off, that nine windows of ten must stay below: a limit or a play acts in some motions only."""
FAR_OFF = 5.0
"""Times an encoder's noise: windows also begin and end where smoothing puts them."""
_SIMULATED = frozenset({*MOTOR_KEYS, *BODY_KEYS, POSITION_GAIN})
"""Numbers that rollouts have."""


@dataclass(frozen=True)
class RolloutFit:
    """A model that was fitted in rollouts.

    Attributes:
        state: the model.
        terms: of the causes that were fitted, and after them those that were held back by what a healthy robot may differ by.
        causes: number of the first ones.
        scales: standard deviations of what each term may be, about the nominal model.
        errors: standard errors of ``terms``.
        squares: mean square error of each window and joint, shape (n, k), rad^2.
    """

    state: JointState
    terms: tuple[Term, ...]
    causes: int
    scales: np.ndarray
    errors: np.ndarray
    squares: np.ndarray
    begin: tuple[np.ndarray, np.ndarray]

    @property
    def usual_rad(self) -> np.ndarray:
        """Error of each joint in a usual window, the median, shape (k,)."""
        return np.sqrt(np.median(self.squares, axis=0))

    @property
    def far_rad(self) -> np.ndarray:
        """Error of each joint that nine windows of ten stay below, shape (k,): what acts in some motions only shows there."""
        return np.sqrt(np.quantile(self.squares, FAR_SHARE, axis=0))

    @property
    def by_joint_rad(self) -> np.ndarray:
        """Root mean square error of each joint, shape (k,)."""
        return np.sqrt(self.squares.mean(axis=0))


class RolloutProblem:
    """Windows of all episodes of a study, to fit models to.

    Args:
        episodes: of the study.
        start: the nominal model.
        catalogue: what may be wrong.
        tolerance: by how much a robot that nothing is wrong with may differ from its model.
    """

    def __init__(
        self, episodes: Sequence[EpisodeEquations], start: JointState, catalogue: Catalogue, tolerance: Tolerance
    ) -> None:
        step_s = max(_FINEST_S, float(np.median([e.path.step_s for e in episodes])))
        self.start, self.catalogue = start, catalogue
        is_in_loop = any(e.path.joints.feedback is not None for e in episodes)
        longest_s = LONGEST_IN_LOOP_S if is_in_loop else LONGEST_STEP_S
        self.forward = Forward(episodes[0].plant, step_s, longest_step_s=longest_s)
        self.gravity_m_s2 = episodes[0].plant.gravity_m_s2
        self.noise_rad = np.sqrt(np.mean([_noise_rad(e) ** 2 for e in episodes], axis=0))
        regimes = [e.path.recording.regime for e in episodes]
        self._fold_of = np.unique(regimes, return_inverse=True)[1] if len(set(regimes)) > 1 else np.arange(len(episodes)) % FOLDS
        for length_s in LENGTHS_S:
            self.windows, self.length_s = windows_of(episodes, length_s, step_s, self.noise_rad), length_s
            if len(self.windows) and self._growth() < _GROWS:
                break
        self.torque_noise_nm = torque_noise_nm(episodes, step_s)
        reported = [v for e in episodes if (v := e.path.joints.velocity_rad_s) is not None]
        self.velocity_noise_rad_s = np.sqrt(np.mean([white_noise(v) ** 2 for v in reported], axis=0)) if reported else 0.0
        row_s = float(np.median([e.path.step_s for e in episodes]))
        loose = tolerated(episodes, start, catalogue, tolerance)
        # bearings first: what they change bends with the causes, and is probed anew with them
        self._loose = [each for each in loose if each[0].key in BEARING and self.forward.has_bearings]
        self._loose += [each for each in loose if each[0].key not in BEARING]
        self._other: Forward | None = None
        law = self.windows.feedback  # of a servo its motor's own voltage is a part, which never rests
        is_loop_elsewhere = law is not None and bool((law.is_known & ~law.is_on_board).any())
        if is_loop_elsewhere and len(self.windows):
            self._other = Forward(episodes[0].plant, step_s, held_s=row_s, longest_step_s=longest_s)
            otherwise = self.otherwise()
            assert otherwise is not None
            if is_nearer(otherwise.begun(self.start), self.begun(self.start)):
                self.forward, self._other = self._other, self.forward

    def otherwise(self) -> "RolloutProblem | None":
        """The same with a controller that holds its torque for a row instead of computing all the time, or the other way round.

        Which of both it does is not recorded: what goes nearer with the nominal model is what a problem begins with. None where
        no controller is known, or where it is a servo.
        """
        if self._other is None:
            return None
        found = copy.copy(self)
        found.forward, found._other = self._other, self.forward
        return found

    def part(self, rows: np.ndarray) -> "RolloutProblem":
        """The same with some of its windows, by index."""
        found = copy.copy(self)
        found.windows = self.windows.some(rows)
        return found

    @property
    def folds(self) -> np.ndarray:
        """Which part of the recordings each window is of, shape (n,): a regime, or of one regime a third of them."""
        return self._fold_of[self.windows.owner]

    def _growth(self) -> float:
        """How much further a disturbed start leads than it would without any force, in the median.

        A robot that its friction holds upright would fall in any model without it: windows in which nothing moves are not asked.
        """
        moving = np.flatnonzero(moves(self.windows.position_rad, self.noise_rad))
        of = moving if len(moving) else np.arange(len(self.windows))
        w = self.windows.some(of[np.linspace(0, len(of) - 1, min(20, len(of))).astype(int)])
        nominal, none = [self.start], np.zeros(len(w), int)
        one = self.forward.positions(w, w.begin_rad, w.begin_rad_s, nominal, none)
        other = self.forward.positions(w, w.begin_rad, w.begin_rad_s + PROBES[1], nominal, none)
        return float(np.nanmedian(np.abs(other - one)[:, -1].max(axis=1)) / (PROBES[1] * self.length_s))

    def loose_terms(self, without: Sequence[Term]) -> list[tuple[Term, float]]:
        """What a healthy robot may be off by, with standard deviations, beside terms that are fitted."""
        taken = {(t.key, t.index) for t in without}
        return [(term, scale) for term, scale in self._loose if scale > 0.0 and (term.key, term.index) not in taken]

    def beside(self, state: JointState, terms: Sequence[Term]) -> list[tuple[Term, float]]:
        """As :meth:`loose_terms`, without bearings of joints that have no dry friction in a model, nor among its terms."""
        rubs = {term.index for term in terms if term.key in FRICTION}
        rubs |= {joint for key in FRICTION for joint in np.flatnonzero(state.value(key)).tolist()}
        return [each for each in self.loose_terms(terms) if each[0].key not in BEARING or each[0].index in rubs]

    def squares_of(self, state: JointState, begin: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Mean square error of each window and joint, infinite where a simulation diverges; shape (n, k)."""
        return self._squares_of(state, [begin])[0]

    def _squares_of(self, state: JointState, begins: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """The same from several begins of all windows, shape (b, n, k): all are simulated together."""
        w, b = self.windows, len(begins)
        begin_rad, begin_rad_s = (np.concatenate(each) for each in zip(*begins, strict=True))
        over = np.tile(np.arange(len(w)), b)
        went = self.forward.positions(w, begin_rad, begin_rad_s, [state], np.zeros(len(over), int), over)
        squares = ((w.position_rad - went.reshape(b, *w.position_rad.shape)) ** 2).mean(axis=2)
        return np.where(np.isfinite(squares), squares, np.inf)

    def begin(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the smoothed motion begins each window."""
        return self.windows.begin_rad, self.windows.begin_rad_s

    def fitted(
        self,
        state: JointState,
        terms: Sequence[Term],
        begin: tuple[np.ndarray, np.ndarray] | None = None,
        *,
        quickly: bool = False,
    ) -> RolloutFit:
        """Fit some terms, and beside them within its tolerances all that a healthy robot may be off by.

        Args:
            state: to begin with.
            terms: to be moved, each probed by its own ``probe``.
            begin: where windows begin; the smoothed motion if None.
            quickly: leave all that is not in ``terms`` as it is, and stop early.
        """
        loose = [] if quickly else self.beside(state, terms)
        begin = self.begun(state).begin if begin is None else begin
        return self._descended(state, terms, loose, begin, _QUICK_ITERATIONS if quickly else _ITERATIONS)

    def begun(self, state: JointState) -> RolloutFit:
        """A model as it is, with windows that begin where they fit best, and torques that act when they do."""
        when = [(term, scale) for term, scale in self._loose if term.key == CLOCK]
        return self._descended(state, (), when, self.begin(), _STARTS_ALONE)

    def _descended(
        self,
        state: JointState,
        terms: Sequence[Term],
        loose: Sequence[tuple[Term, float]],
        begin: tuple[np.ndarray, np.ndarray],
        iterations: int,
    ) -> RolloutFit:
        """Steps of Gauss and Newton, each as far as errors fall; once they are small only causes and bearings are probed anew.

        Where no part of a step makes errors fall it is tried without what it makes of bearings: whether one slips is no straight
        line.
        """
        every = (*terms, *(t for t, _ in loose))
        bears = np.array([t.key in BEARING for t in every], bool)
        anew = len(terms) + int(bears[len(terms) :].sum())
        scales = np.array([*(_WIDE * self.catalogue.scales.get(t.key, 1.0) for t in terms), *(s for _, s in loose)])
        at, errors, known = _Place(state, begin, self.squares_of(state, begin)), np.zeros(len(every)), None
        for _ in range(iterations):
            noise, weights = self.noise_of(at.squares)
            linear = linearised(self.forward, self.windows, at.state, every, at.begin, noise, weights, known)
            prior = 1.0 / scales**2
            precision = linear.precision + np.diag(prior)
            errors = np.sqrt(np.diag(np.linalg.inv(precision)))
            pull = linear.pull - prior * apart(at.state, self.start, every)
            damped = precision + _DAMPING * np.diag(np.diag(precision))
            room = room_of(at.state, self.start, every, scales, len(terms))
            found = self._nearer(at, every, loose, linear, step_within(damped, pull, *room), noise)
            if found is None and bears.any():
                found = self._nearer(at, every, loose, linear, step_within(damped, pull, *room, bears), noise)
            if found is None:
                break
            before, after = (self._loss(place.squares, noise) for place in (at, found))
            at = found
            if before - after < _ENOUGH * abs(before):
                break
            known = linear.moves[anew:] if before - after < _SETTLES * at.squares.size else None
        return RolloutFit(at.state, every, len(terms), scales, errors, at.squares, at.begin)

    def _nearer(
        self,
        at: "_Place",
        every: Sequence[Term],
        loose: Sequence[tuple[Term, float]],
        linear: Linearised,
        change: np.ndarray,
        noise: np.ndarray,
    ) -> "_Place | None":
        """Where errors fall, as far along a step as they do; None if they do nowhere."""
        for share in _SHARES:
            candidate = self._within_tolerance(moved_by(at.state, every, share * change), loose)
            moved = self._begins(at.begin, linear, apart(candidate, at.state, every), share)
            # where a model bends, begins that follow its linearisation lead astray
            begins = (moved, at.begin)
            squares = self._squares_of(candidate, begins)
            tried = [_Place(candidate, *each) for each in zip(begins, squares, strict=True)]
            nearest = min(tried, key=lambda place: self._loss(place.squares, noise))
            if self._loss(nearest.squares, noise) < self._loss(at.squares, noise):
                return nearest
        return None

    def without_loose(self, state: JointState, kept: Sequence[Term]) -> JointState:
        """A model with everything that a healthy robot may be off by as the nominal one has it, but for terms that are kept."""
        for term, _ in self.loose_terms(kept):
            by = self.start.value(term.key)[term.index] - state.value(term.key)[term.index]
            state = state.moved(term, float(by), with_shape=False)
        return state

    def _within_tolerance(self, state: JointState, loose: Sequence[tuple[Term, float]]) -> JointState:
        for term, scale in loose:
            here, first = (float(each.value(term.key)[term.index]) for each in (state, self.start))
            nearest = float(np.clip(here, first - TOLERATED * scale, first + TOLERATED * scale))
            state = state.moved(term, nearest - here, with_shape=False)
        return state

    def noise_of(self, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a usual window leaves at each joint, shape (k,), rad, and how much each window counts, shape (n, k)."""
        usual = np.median(squares, axis=0)
        noise = np.sqrt(np.maximum(usual, self.noise_rad**2))
        return noise, 1.0 / (1.0 + squares / (_TAILS * noise**2))

    def _loss(self, squares: np.ndarray, noise: np.ndarray) -> float:
        return float(np.log1p(squares / (_TAILS * noise**2)).sum())

    def _begins(
        self, begin: tuple[np.ndarray, np.ndarray], linear: Linearised, change: np.ndarray, share: float
    ) -> tuple[np.ndarray, np.ndarray]:
        free, by_terms = linear.starts
        starts = share * free - np.einsum("nbm,m->nb", by_terms, change)
        joints = begin[0].shape[1]
        return begin[0] + starts[:, :joints], begin[1] + starts[:, joints:]

    @property
    def motion_rad(self) -> np.ndarray:
        """How far joints are from their mean place in a usual window, root mean square, shape (k,)."""
        return np.maximum(np.median(self.windows.position_rad.std(axis=1), axis=0), self.noise_rad)

    @property
    def far_motion_rad(self) -> np.ndarray:
        """The same that nine windows of ten stay below, shape (k,)."""
        return np.maximum(np.quantile(self.windows.position_rad.std(axis=1), FAR_SHARE, axis=0), self.noise_rad)

    def is_near_noise(self, fit: RolloutFit) -> bool:
        """Whether windows of no joint are off by more than a few times what its encoder is, neither usual nor far ones."""
        near_rad = FAR_OFF * self.noise_rad
        return bool((fit.usual_rad < near_rad).all() and (fit.far_rad < FAR_WINDOWS * near_rad).all())

    def gained(self, before: np.ndarray, after: np.ndarray) -> float:
        """What one model gains over another by the errors of their windows, shapes (n, k), nats."""
        return float(self.gained_by_window(before, after).sum())

    def gained_by_window(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """As :meth:`gained`, of each window, shape (n,)."""
        floor = (_FLOOR * self.noise_rad) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log((before + floor) / (after + floor))
        return 0.5 * SAMPLES_OF_WINDOW * np.nan_to_num(ratio, posinf=5.0, neginf=-5.0).sum(axis=1)


class _Place(NamedTuple):
    """Where a fit has come to: model, begins of windows and mean square errors."""

    state: JointState
    begin: tuple[np.ndarray, np.ndarray]
    squares: np.ndarray


def _noise_rad(episode: EpisodeEquations) -> np.ndarray:
    """Of encoders, shape (k,): rounding to coarse steps is noise, too, though positions then rest for most of the time."""
    return np.maximum(episode.path.position_noise_rad, episode.path.encoder_step_rad / np.sqrt(12.0))


def is_nearer(fit: RolloutFit, other: RolloutFit) -> bool:
    """Whether usual windows of all joints together end up less far off."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (np.log(np.median(each.squares, axis=0)).sum() for each in (fit, other))
    return bool(one < two)


def is_simulated(key: str) -> bool:
    """Whether rollouts have a law of a number, "effect.parameter"."""
    return key in _SIMULATED
