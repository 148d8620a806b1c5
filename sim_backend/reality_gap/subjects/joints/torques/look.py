"""Looks at the joints of a study with any model: what each hypothesis would gain, and what the model leaves."""

import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, NUMBERS, Channel
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, Catalogue, Hypothesis, joint_catalogue
from sim_backend.reality_gap.subjects.joints.laws.moves import may_be
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, SENSED, JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations, Equation
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import (
    FOLDS,
    NormalEquations,
    Reduced,
    Whitened,
    folds_of,
    is_short,
    normal_equations,
    of_one_noise,
    reduced,
    whitened,
    whitened_together,
)

_ROWS_OF_A_SESSION = 30000.0
_LONG_S, _LONG_IN_ALL_S = 20.0, 200.0
"""A foreign joint's rows in one recording and in all, as thresholds were made with: beyond, priors grow stronger as data do.

Otherwise an hour of anything, noise included, is explained by all torques and masses that are off by the same share.
"""
_SAME_NATS = 5.0
BENT_TIE = 2.0 / 3.0
"""Share of a gain: as far behind, another cause is as good as an effect whose image is no straight line."""
_TRUSTED = 0.3
"""Where something is wrong, tolerances of a healthy robot must not take the place of causes."""
_NOISE_NATS = 0.33
"""What the noise of a healthy session leaves of each row of its mechanics, at most, nats (0.28 to 0.32 in four sessions)."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with what it would gain (nats), its coefficients with their standard errors, and whether they may be.

    ``by_fold`` has shape (f,): what the hypothesis gains on each fold when it is fitted to the others.
    """

    hypothesis: Hypothesis
    gain: float
    held_out: float
    values: np.ndarray
    errors: np.ndarray
    allowed: bool
    by_fold: np.ndarray


@dataclass(frozen=True)
class Accepted:
    """An effect at a place that the model has now: its terms, what it gained when it was taken, and at which look that was."""

    effect: str
    where: str
    terms: tuple[Term, ...]
    gain: float
    look: int = 0


@dataclass(frozen=True)
class Look:
    """Everything that one linearisation tells: normal equations, hypotheses by gain, and noise.

    ``left`` holds the equations with what the model and its tolerances leave as residual, without images, which would be nearly
    all of a study's memory; ``mechanics_left`` is half the sum of squares of it, whitened, of the mechanics, nats, and
    ``mechanics_rows`` their number of rows. ``mean`` holds the posterior means of all terms, 0 for hypotheses that are not in
    the model; ``noise_ratio`` has shape (k,): noise of the mechanics relative to that of the sensors; ``tolerated_nm`` alike what
    tolerances make of each joint's torques, root mean squares. ``is_known`` says that it is of a TriFinger.
    """

    sums: NormalEquations
    catalogue: Catalogue
    left: tuple[Equation, ...]
    mechanics_left: float
    mechanics_rows: int
    candidates: tuple[Candidate, ...]
    mean: np.ndarray
    accepted_values: np.ndarray
    accepted_errors: np.ndarray
    sensed_share: np.ndarray
    sensed_error: np.ndarray
    noise_ratio: np.ndarray
    state: JointState
    accepted: tuple[Accepted, ...]
    tolerance: np.ndarray
    rest: Reduced
    tolerated_nm: np.ndarray
    is_known: bool

    @property
    def beyond_noise(self) -> float:
        """What the laws of the model leave of the mechanics beside noise, nats."""
        return max(0.0, self.mechanics_left - _NOISE_NATS * self.mechanics_rows)

    def left_of(self, channel: Channel, joints: int) -> np.ndarray:
        """What model and tolerances leave of an equation of each joint, root mean squares over rows that count, shape (k,)."""
        squares, rows = np.zeros(joints), np.zeros(joints)
        for equation in self.left:
            if equation.channel is channel:
                counted = equation.residual[equation.valid & np.isfinite(equation.residual)]
                squares[equation.joint] += counted @ counted
                rows[equation.joint] += len(counted)
        return np.sqrt(squares / np.maximum(rows, 1.0))

    def trusting(self) -> "Look":
        """The same, its values fitted with narrower tolerances for everything that is not in the model.

        Torques and masses of a whole finger, 0.6 % off in a healthy robot, would otherwise go 15 % along with a friction.
        """
        shared = len(self.catalogue.terms)
        is_healthy = np.array([term.key not in (CLOCK, SENSED) for term in self.catalogue.terms])
        tolerance = self.tolerance.copy()
        tolerance[:shared][is_healthy] *= _TRUSTED
        mean, error = _posterior(self.sums, np.flatnonzero(tolerance > 0.0), tolerance)
        return replace(self, mean=mean, tolerance=tolerance, accepted_values=mean[shared:], accepted_errors=error[shared:])

    @property
    def best(self) -> Candidate | None:
        """What gains most and may be; a single joint rather than all of them if that gains hardly less."""
        return self.best_without(())

    def best_without(
        self, refused: Collection[tuple[str, str]], least: Callable[[str], float] = lambda _: -np.inf
    ) -> Candidate | None:
        """As :attr:`best`, some names left out, and effects that gain less than what healthy sessions show of them."""
        allowed = [
            c for c in self.candidates if c.allowed and c.hypothesis.name not in refused and c.gain >= least(c.hypothesis.effect)
        ]
        if not allowed:
            return None
        if self.is_known and (straight := _straight_instead(allowed)) is not None:
            allowed = [straight, *(c for c in allowed if c is not straight and c.gain <= straight.gain)]
        contained = FITTED[allowed[0].hypothesis.effect].contains
        simpler = next((c for c in allowed if c.hypothesis.effect == contained), None)
        if simpler is not None and allowed[0].gain - simpler.gain < _SAME_NATS:
            return simpler
        enough = allowed[0].gain - max(10.0, 0.05 * allowed[0].gain)
        single = [c for c in allowed if c.gain >= enough and len(c.hypothesis.terms) <= 2]
        return single[0] if allowed[0].hypothesis.where == ALL_JOINTS and single else allowed[0]


@dataclass(frozen=True)
class JointProblem:
    """The episodes of a study; looks at them with any model.

    Attributes:
        episodes: all of the same joints.
        names: of the joints.
        robot: what is known of it.
        excluded: effects that are not in the catalogue for this study.
        start: the nominal model, which causes are added to.
        expects_many: whether noise is what the present model leaves, not what all hypotheses together would leave.
    """

    episodes: tuple[EpisodeEquations, ...]
    names: tuple[str, ...]
    robot: Robot
    excluded: tuple[str, ...]
    start: JointState
    expects_many: bool = False

    @property
    def is_of_many(self) -> bool:
        """Whether so much is wrong with a TriFinger that each cause takes over what the laws of the others leave."""
        return self.expects_many and isinstance(self.robot, KnownTriFinger)

    @functools.cached_property
    def _load_nm(self) -> np.ndarray:
        """Torques that were sent over all episodes, shape (s, k), N m."""
        return np.concatenate([e.driving_nm.T for e in self.episodes])

    @functools.cached_property
    def torque_rms_nm(self) -> np.ndarray:
        """Root mean square of each joint's torque, shape (k,), N m."""
        return np.sqrt(np.mean(self._load_nm**2, axis=0))

    @functools.cached_property
    def speed_rms_rad_s(self) -> np.ndarray:
        """Root mean square of each joint's speed, shape (k,), rad/s."""
        return np.sqrt(np.mean(np.concatenate([e.path.velocity for e in self.episodes]) ** 2, axis=0))

    def look(self, state: JointState, accepted: Sequence[Accepted], *, plain: bool = False) -> Look:
        """Linearise at a state and ask every hypothesis what it would gain; ``plain`` as for :func:`whitened`."""
        step_s = self.episodes[0].path.step_s
        catalogue = joint_catalogue(
            self.names,
            state,
            self._load_nm,
            step_s,
            robot=self.robot,
            start=self.start,
            centre_distance_m=self.episodes[0].plant.centre_distance_m,
            expects_many=self.expects_many,
        )
        catalogue = catalogue.without(self.excluded)
        own = [term for a in accepted for term in a.terms]
        terms = (*catalogue.terms, *own)
        tolerance = np.concatenate([catalogue.tolerance, [catalogue.scales[term.key] for term in own]])
        for i, term in enumerate(catalogue.terms):  # what is in the model already needs no tolerance beside it
            if any(term.key == t.key and term.index == t.index for t in own):
                tolerance[i] = 0.0
        if plain:  # the causes alone, as whoever uses the model will have them
            tolerance[: len(catalogue.terms)] = 0.0
        whitening = np.array([_held(t.key, catalogue.scales.get(t.key, s)) for t, s in zip(terms, tolerance, strict=True)])
        whitening[len(catalogue.terms) :] = tolerance[len(catalogue.terms) :]
        whitening[[t.effect in self.excluded for t in terms]] = 0.0
        if self.expects_many:
            rows = sum(float(e.valid_mechanics.sum()) for e in self.episodes)
            tolerance[: len(catalogue.terms)] *= min(1.0, np.sqrt(_ROWS_OF_A_SESSION / rows)) * _TRUSTED
            whitening = tolerance.copy()
        else:
            counted_s = sum(float(e.valid_mechanics.sum(axis=0).max()) * e.path.every * step_s for e in self.episodes)
            tolerance[: len(catalogue.terms)] *= self.robot.prior_share(counted_s, _LONG_IN_ALL_S)
        found, short = [], {}
        for episode in self.episodes:
            for equation in episode.equations(state, terms):
                if is_short(equation):
                    short.setdefault((equation.channel, equation.joint), []).append(equation)
                    continue
                scales = whitening[list(equation.terms)] * self.robot.prior_share(equation.counted_s, _LONG_S)
                white = whitened(equation, scales, folds_of(equation, len(self.episodes)), plain=plain)
                if white is not None:
                    found.append(white)
        for together in short.values():
            scales = whitening * self.robot.prior_share(sum(equation.counted_s for equation in together), _LONG_S)
            found += whitened_together(together, scales, [folds_of(e, len(self.episodes)) for e in together], plain=plain)
        found = of_one_noise(found) if plain else found
        sums = normal_equations(found, len(terms), FOLDS)
        return self._answers(sums, catalogue, tuple(found), tolerance, accepted, state)

    def _answers(
        self,
        sums: NormalEquations,
        catalogue: Catalogue,
        found: tuple[Whitened, ...],
        tolerance: np.ndarray,
        accepted: Sequence[Accepted],
        state: JointState,
    ) -> Look:
        base = np.flatnonzero(tolerance > 0.0)
        weights = np.ones(FOLDS)
        whole = reduced(sums.weighted(weights), base, tolerance[base])
        parts = [reduced(sums.weighted(weights - np.eye(FOLDS)[f]), base, tolerance[base]) for f in range(FOLDS) if sums.rows[f]]
        taken, modelled = {(a.effect, a.where) for a in accepted}, {(t.key, t.index) for a in accepted for t in a.terms}
        candidates = []
        for h in catalogue.hypotheses:
            if h.name in taken:
                continue
            own, is_group = [catalogue.terms[t] for t in h.terms], h.where == ALL_JOINTS
            # of joints that have the effect already it is asked closely, and not again as far off as where there is none
            is_open = np.array([not is_group or (t.key, t.index) not in modelled for t in own])
            open_terms, open_scales = tuple(compress(h.terms, is_open)), tuple(compress(h.scales, is_open))
            if not open_terms:
                continue
            values, errors = np.zeros(len(own)), np.zeros(len(own))
            values[is_open], covariance = whole.estimate(open_terms, open_scales)
            errors[is_open] = np.sqrt(np.diag(covariance))
            asked = list(compress(own, is_open))
            allowed = may_be(asked, values[is_open], errors[is_open], state, is_group=is_group, expects_many=self.expects_many)
            gain = whole.gain(open_terms, open_scales)
            by_fold = np.array([gain - part.gain(open_terms, open_scales) for part in parts])
            candidates.append(Candidate(h, gain, float(by_fold.sum()), values, errors, allowed, by_fold))
        candidates.sort(key=lambda c: -c.gain)
        first_own = len(catalogue.terms)
        mean, error = _posterior(sums, base, tolerance)
        sensed = [i for i, t in enumerate(catalogue.terms) if t.key == SENSED]
        return Look(
            sums,
            catalogue,
            tuple(_left(w.equation, mean) for w in found),
            _mechanics_left(found, mean),
            sum(len(w.residual) for w in found if w.equation.channel is Channel.MECHANICS),
            tuple(candidates),
            mean,
            mean[first_own:],
            error[first_own:],
            mean[sensed],
            error[sensed],
            _noise_ratio(found, len(self.names)),
            state,
            tuple(accepted),
            tolerance,
            whole,
            _tolerated_nm(found, tolerance, sensed, len(self.names)),
            isinstance(self.robot, KnownTriFinger),
        )


def _straight_instead(allowed: Sequence[Candidate]) -> Candidate | None:
    """What is taken instead of the first of some candidates: another cause of the same joint, where that one's image is bent."""
    first = allowed[0]
    if not FITTED[first.hypothesis.effect].is_bent:
        return None
    near = [c for c in allowed if c.hypothesis.where == first.hypothesis.where and first.gain - c.gain < BENT_TIE * first.gain]
    return next((c for c in near if not FITTED[c.hypothesis.effect].is_bent), None)


def _held(key: str, scale: float) -> float:
    """A term's scale while noise is measured."""
    return NUMBERS[key].held or scale if key in NUMBERS else scale


def _left(equation: Equation, mean: np.ndarray) -> Equation:
    """The equation with what a model leaves of it, and without images."""
    left = equation.residual - equation.images @ mean[list(equation.terms)]
    return replace(equation, residual=left, images=np.zeros((len(left), 0)), terms=())


def _mechanics_left(equations: Sequence[Whitened], mean: np.ndarray) -> float:
    found = [w for w in equations if w.equation.channel is Channel.MECHANICS]
    return 0.5 * sum(float(np.sum((w.residual - w.images @ mean[list(w.equation.terms)]) ** 2)) for w in found)


def _posterior(sums: NormalEquations, base: np.ndarray, tolerance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    images, cross, _ = sums.weighted(np.ones(sums.folds))
    scale = tolerance[base]
    precision = np.eye(len(base)) + scale[:, None] * images[np.ix_(base, base)] * scale
    covariance = np.linalg.inv(precision)
    mean, error = np.zeros(len(tolerance)), np.zeros(len(tolerance))
    mean[base] = scale * (covariance @ (scale * cross[base]))
    error[base] = scale * np.sqrt(np.diag(covariance))
    return mean, error


def _tolerated_nm(found: Sequence[Whitened], tolerance: np.ndarray, sensed: Sequence[int], joints: int) -> np.ndarray:
    squares, rows = np.zeros(joints), np.zeros(joints)
    known = tolerance.copy()
    known[list(sensed)] = 0.0
    for equation in (w.equation for w in found if w.equation.channel is Channel.MECHANICS):
        counted = equation.valid & np.isfinite(equation.residual)
        squares[equation.joint] += float(((equation.images[counted] * known[list(equation.terms)]) ** 2).sum())
        rows[equation.joint] += counted.sum()
    return np.sqrt(squares / np.maximum(rows, 1.0))


def _noise_ratio(found: Sequence[Whitened], joints: int) -> np.ndarray:
    ratio = np.zeros(joints)
    for w in found:
        if w.equation.channel is Channel.MECHANICS and w.equation.sensor_noise > 0.0:
            ratio[w.equation.joint] = max(ratio[w.equation.joint], w.noise / w.equation.sensor_noise)
    return ratio
