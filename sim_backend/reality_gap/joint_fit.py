"""Forward selection of causes among joints' effects: what gains most is taken, everything is fitted anew, until nothing gains."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.equations import Channel, EpisodeEquations
from sim_backend.reality_gap.evidence import (
    FOLDS,
    NormalEquations,
    Reduced,
    Whitened,
    folds_of,
    normal_equations,
    reduced,
    whitened,
)
from sim_backend.reality_gap.hypotheses import ALL_JOINTS, SCALES, Catalogue, Hypothesis, joint_catalogue
from sim_backend.reality_gap.joint_state import SENSED, JointState, Term

Progress = Callable[[str, float], None]
MAX_CAUSES = 24
MANY_CAUSES = 2.5
"""Noise that all hypotheses together leave, relative to that of the sensors, from which on more than one thing is wrong."""
_ROWS_OF_A_SESSION = 30000.0
MAX_REFUSED = 5
_NOISE_SCALES = {"link_mass": 0.03, "torque_constant": 0.02}
"""While noise is measured, scales of everything are held close to nominal, so that they do not explain it away."""
_SHAPE_OF = {
    "stribeck_friction": ("stribeck_friction.speed_rad_s",),
    "thermal_derating": ("thermal_derating.time_constant_s",),
}
"""Shapes that are fitted, too, once an effect is in the model."""
_BOUND_SIGMAS = 3.0
_SCALES_OF_EVERYTHING = ("torque_constant", "link_mass")
_PLAUSIBLE_SCALE = {False: 0.35, True: 0.15}
"""A torque or a mass that is off by more only makes everything smaller, errors too; the more so where much is wrong."""
_SAME_NATS = 5.0
_TRUSTED = 0.3
"""Where much is wrong, tolerances of a healthy robot must not take the place of causes."""
_REFINEMENTS = 1
_PROXY_SHARE = 0.004
"""A cause that gains less than this share of the largest one may only mend what that one's law leaves."""


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
    """An effect at a place that the model has now: its terms, and how much it gained when it was taken."""

    effect: str
    where: str
    terms: tuple[Term, ...]
    gain: float


@dataclass(frozen=True)
class Look:
    """Everything that one linearisation tells: normal equations, hypotheses by gain, and noise.

    ``mean`` holds the posterior means of all terms, 0 for hypotheses that are not in the model; ``noise_ratio`` has shape (k,): noise of the mechanics relative to that of the sensors.
    """

    sums: NormalEquations
    catalogue: Catalogue
    equations: tuple[Whitened, ...]
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
        tilt = next((c for c in allowed if c.hypothesis.effect == "table_tilt"), None)
        if allowed[0].hypothesis.effect == "gravity" and tilt is not None and allowed[0].gain - tilt.gain < _SAME_NATS:
            return tilt  # the same with one number less
        enough = allowed[0].gain - max(10.0, 0.05 * allowed[0].gain)
        single = [c for c in allowed if c.gain >= enough and len(c.hypothesis.terms) <= 2]
        return single[0] if allowed[0].hypothesis.where == ALL_JOINTS and single else allowed[0]

    @property
    def mechanics_left(self) -> float:
        """Half the sum of squares of what the model with its tolerances leaves of the mechanics, nats."""
        found = [w for w in self.equations if w.equation.channel is Channel.MECHANICS]
        return 0.5 * sum(float(np.sum((w.residual - w.images @ self.mean[list(w.equation.terms)]) ** 2)) for w in found)


@dataclass(frozen=True)
class JointFit:
    """What forward selection came to."""

    state: JointState
    accepted: tuple[Accepted, ...]
    looks: tuple[Look, ...]
    final: Look
    errors: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)

    @property
    def first(self) -> Look:
        """Of the nominal model."""
        return self.looks[0]

    @property
    def last(self) -> Look:
        """Of the final model."""
        return self.looks[-1]


class JointProblem:
    """The episodes of a study with the names of their joints; looks at them with any model.

    Args:
        episodes: all of the same joints.
        names: of the joints.
        has_pipeline: whether the driver's own safety pipeline made the torques.
        excluded: effects that are not in the catalogue for this study.
        tolerances: what healthy sessions seem to have, by parameter and shape.
    """

    def __init__(
        self,
        episodes: Sequence[EpisodeEquations],
        names: Sequence[str],
        *,
        has_pipeline: bool,
        excluded: Sequence[str] = (),
        tolerances: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        self.episodes, self.names, self.has_pipeline, self.excluded = list(episodes), tuple(names), has_pipeline, tuple(excluded)
        self._tolerances = tolerances or {}
        self.expects_many = False
        """Whether noise is what the present model leaves, not what all hypotheses together would leave."""
        self._load = np.concatenate([e.driving_nm.T for e in episodes])

    def look(self, state: JointState, accepted: Sequence[Accepted], *, plain: bool = False) -> Look:
        """Linearise at a state and ask every hypothesis what it would gain; ``plain`` as for :func:`whitened`."""
        step_s = self.episodes[0].path.step_s
        catalogue = joint_catalogue(
            self.names, state, self._load, step_s, has_pipeline=self.has_pipeline, tolerances=self._tolerances
        )
        catalogue = catalogue.without(self.excluded)
        own = [term for a in accepted for term in a.terms]
        terms = (*catalogue.terms, *own)
        tolerance = np.concatenate([catalogue.tolerance, [SCALES[term.key] for term in own]])
        for i, term in enumerate(catalogue.terms):  # what is in the model already needs no tolerance beside it
            if any(term.key == t.key and term.index == t.index for t in own):
                tolerance[i] = 0.0
        if plain:  # the causes alone, as whoever uses the model will have them
            tolerance[: len(catalogue.terms)] = 0.0
        whitening = np.array([_NOISE_SCALES.get(t.effect, SCALES.get(t.key, s)) for t, s in zip(terms, tolerance, strict=True)])
        whitening[len(catalogue.terms) :] = tolerance[len(catalogue.terms) :]
        whitening[[t.effect in self.excluded for t in terms]] = 0.0
        if self.expects_many:
            rows = sum(float(e.valid_mechanics.sum()) for e in self.episodes)
            tolerance[: len(catalogue.terms)] *= min(1.0, np.sqrt(_ROWS_OF_A_SESSION / rows)) * _TRUSTED
            whitening = tolerance.copy()
        found = []
        for episode in self.episodes:
            for equation in episode.equations(state, terms):
                white = whitened(equation, whitening[list(equation.terms)], folds_of(equation, len(self.episodes)), plain=plain)
                if white is not None:
                    found.append(white)
        sums = normal_equations(found, len(terms), FOLDS)
        return self._answers(sums, catalogue, tuple(found), tolerance, accepted, state)

    def _answers(self, sums, catalogue, found, tolerance, accepted, state) -> Look:
        base = np.flatnonzero(tolerance > 0.0)
        weights = np.ones(FOLDS)
        whole = reduced(sums.weighted(weights), base, tolerance[base])
        parts = [reduced(sums.weighted(weights - np.eye(FOLDS)[f]), base, tolerance[base]) for f in range(FOLDS) if sums.rows[f]]
        taken = {(a.effect, a.where) for a in accepted}
        candidates = []
        for h in catalogue.hypotheses:
            if h.name in taken:
                continue
            values, covariance = whole.estimate(h.terms, h.scales)
            errors = np.sqrt(np.diag(covariance))
            allowed = within_bounds([catalogue.terms[t] for t in h.terms], values, errors, state)
            if self.expects_many and h.where == ALL_JOINTS:  # some may have none: their values are cut off at the bound
                allowed = _mostly_within_bounds([catalogue.terms[t] for t in h.terms], values, errors, state)
            if h.effect in _SCALES_OF_EVERYTHING:
                here = np.array([state.value(catalogue.terms[t].key)[catalogue.terms[t].index] for t in h.terms])
                absent = np.array([PARAMETERS[catalogue.terms[t].key].absent for t in h.terms])
                allowed = allowed and bool(np.all(np.abs(here + values - absent) < _PLAUSIBLE_SCALE[self.expects_many]))
            gain = whole.gain(h.terms, h.scales)
            by_fold = np.array([gain - part.gain(h.terms, h.scales) for part in parts])
            candidates.append(Candidate(h, gain, float(by_fold.sum()), values, errors, allowed, by_fold))
        candidates.sort(key=lambda c: -c.gain)
        first_own = len(catalogue.terms)
        mean, error = _posterior(sums, base, tolerance)
        sensed = [i for i, t in enumerate(catalogue.terms) if t.key == SENSED]
        return Look(
            sums,
            catalogue,
            found,
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
        )


def _posterior(sums: NormalEquations, base: np.ndarray, tolerance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    images, cross, _ = sums.weighted(np.ones(sums.folds))
    scale = tolerance[base]
    precision = np.eye(len(base)) + scale[:, None] * images[np.ix_(base, base)] * scale
    covariance = np.linalg.inv(precision)
    mean, error = np.zeros(len(tolerance)), np.zeros(len(tolerance))
    mean[base] = scale * (covariance @ (scale * cross[base]))
    error[base] = scale * np.sqrt(np.diag(covariance))
    return mean, error


def _noise_ratio(found: Sequence[Whitened], joints: int) -> np.ndarray:
    ratio = np.zeros(joints)
    for w in found:
        if w.equation.channel is Channel.MECHANICS and w.equation.sensor_noise > 0.0:
            ratio[w.equation.joint] = max(ratio[w.equation.joint], w.noise / w.equation.sensor_noise)
    return ratio


def within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    """Whether some values (changes of the terms) may be, within their errors, what the catalogue allows."""
    if terms[0].effect == "cogging":
        return True
    if terms[0].effect == "joint_stiffness":
        return all(
            s + 3.0 * e > 0.0 for s, e in zip(values[::2] + values[1::2], np.hypot(errors[::2], errors[1::2]), strict=True)
        )
    for term, value, error in zip(terms, values, errors, strict=True):
        parameter, here = PARAMETERS[term.key], state.value(term.key)[term.index]
        slack = _BOUND_SIGMAS * error + 1e-12
        if not parameter.lower - slack <= here + value <= parameter.upper + slack:
            return False
    return True


def _mostly_within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    width = 2 if terms[0].effect in ("cogging", "joint_stiffness") else 1
    parts = range(0, len(terms), width)
    inside = [within_bounds(terms[i : i + width], values[i : i + width], errors[i : i + width], state) for i in parts]
    return sum(inside) > len(inside) / 2


def moved(state: JointState, terms: Sequence[Term], values: np.ndarray) -> JointState:
    """The state with changes of some terms put in, cut off at the catalogue's bounds."""
    if terms and terms[0].effect == "cogging":
        return _moved_in_pairs(state, terms, values, _turned)
    if terms and terms[0].effect == "joint_stiffness":
        return _moved_in_pairs(state, terms, values, _sprung)
    for term, value in zip(terms, values, strict=True):
        parameter, here = PARAMETERS[term.key], float(state.value(term.key)[term.index])
        upper = max(parameter.upper, here) if term.key == "torque_saturation.limit_nm" else parameter.upper
        wanted = float(np.clip(here + value, parameter.lower, upper))
        state = state.moved(term, wanted - here)
    return state


def _moved_in_pairs(state, terms, values, change) -> JointState:
    for first, second, a, b in zip(terms[::2], terms[1::2], values[::2], values[1::2], strict=True):
        state = change(state, first, second, float(a), float(b))
    return state


def _turned(state: JointState, first: Term, second: Term, a: float, b: float) -> JointState:
    key, j = "cogging.phase_rad", first.index
    here = state.value("cogging.amplitude_nm")[j] * np.exp(1j * state.value(key)[j])
    there = here + a * np.exp(1j * dict(first.shape)[key]) + b * np.exp(1j * dict(second.shape)[key])
    amplitude, phase = state.value("cogging.amplitude_nm").copy(), state.value(key).copy()
    amplitude[j], phase[j] = abs(there), np.angle(there)
    return JointState(state.joints, {**state.given, "cogging.amplitude_nm": amplitude, key: phase})


def _sprung(state: JointState, first: Term, second: Term, a: float, b: float) -> JointState:
    key, j = "joint_stiffness.reference_rad", first.index
    stiffness, reference = state.value("joint_stiffness.stiffness_nm_rad").copy(), state.value(key).copy()
    torque = stiffness[j] * reference[j] + a * dict(first.shape)[key] + b * dict(second.shape)[key]
    stiffness[j] = max(stiffness[j] + a + b, 1e-6)
    reference[j] = np.clip(torque / stiffness[j], PARAMETERS[key].lower, PARAMETERS[key].upper)
    return JointState(state.joints, {**state.given, "joint_stiffness.stiffness_nm_rad": stiffness, key: reference})


def refining_terms(catalogue: Catalogue, hypothesis: Hypothesis) -> tuple[Term, ...]:
    """The hypothesis' own terms, probed closely: they are fitted around the value that the model has."""
    found = []
    for index in hypothesis.terms:
        term = catalogue.terms[index]
        sign = -1.0 if term.probe < 0.0 else 1.0
        shape = () if term.effect == "stribeck_friction" or term.effect == "thermal_derating" else term.shape
        found.append(Term(term.key, term.index, sign * SCALES[term.key] / 100.0, shape))
        found += [Term(key, term.index, SCALES[key] / 100.0) for key in _SHAPE_OF.get(term.effect, ())]
    return tuple(found)


def select(
    problem: JointProblem,
    state: JointState,
    gate: float,
    progress: Progress,
    *,
    min_share: float = 0.01,
    confirms: Callable[[Look, Look], bool] = lambda *_: True,
    plain_values: bool = False,
    gates: Mapping[str, float] | None = None,
) -> JointFit:
    """Take causes one after the other.

    Args:
        problem: the episodes.
        state: to start from.
        gate: least gain of a cause, nats.
        progress: told what is done, and which share.
        min_share: least share of what is left unexplained that a cause beyond the first must take away.
        gates: least gain of a cause of each effect, where healthy sessions tell.
        plain_values: whether values are fitted by least squares in the end.
        confirms: whether a cause is worth it, told the looks without and with it; if not, the next best is tried.
    """
    looks, accepted, refused = [problem.look(state, ())], [], set()
    if looks[0].noise_ratio.max() > MANY_CAUSES:
        problem.expects_many = True
        looks = [problem.look(state, ())]
    while len(accepted) < MAX_CAUSES and len(refused) < MAX_REFUSED:
        look = looks[-1]
        later = 0.0
        if accepted:
            later = max(min_share * look.mechanics_left, _PROXY_SHARE * max(a.gain for a in accepted))
        best = look.best_without(refused, lambda effect: max((gates or {}).get(effect, gate), later))  # noqa: B023
        if best is None:
            break
        progress(f"{best.hypothesis.effect}, {best.hypothesis.where}", min(0.9, 0.2 + 0.1 * len(accepted)))
        terms = tuple(look.catalogue.terms[i] for i in best.hypothesis.terms)
        before, kept = state, list(accepted)
        state = moved(state, terms, best.values)
        accepted = [a for a in accepted if not _contains(best.hypothesis, a)]
        own = refining_terms(look.catalogue, best.hypothesis)
        accepted.append(Accepted(best.hypothesis.effect, best.hypothesis.where, own, best.gain))
        for _ in range(_REFINEMENTS):
            look = problem.look(state, accepted)
            state = _refined(state, accepted, look.accepted_values)
        new = problem.look(state, accepted)
        if confirms(looks[-1], new):
            looks.append(new)
            state = _refined(state, accepted, new.accepted_values)
            continue
        state, accepted = before, kept
        refused.add(best.hypothesis.name)
    final = looks[-1]
    if plain_values and accepted:
        for _ in range(_REFINEMENTS):
            state = _refined(state, accepted, problem.look(state, accepted, plain=True).accepted_values)
        final = problem.look(state, accepted, plain=True)
    return JointFit(state, tuple(accepted), tuple(looks), final, _errors(accepted, final))


def _contains(hypothesis: Hypothesis, other: Accepted) -> bool:
    """Whether a hypothesis about all joints replaces one about a single joint."""
    return hypothesis.effect == other.effect and hypothesis.where.startswith("all") and not other.where.startswith("all")


def _refined(state: JointState, accepted: Sequence[Accepted], values: np.ndarray) -> JointState:
    at = 0
    for a in accepted:
        state = moved(state, a.terms, values[at : at + len(a.terms)])
        at += len(a.terms)
    return state


def _errors(accepted: Sequence[Accepted], look: Look) -> dict[tuple[str, str], np.ndarray]:
    at, errors = 0, {}
    for a in accepted:
        errors[(a.effect, a.where)] = look.accepted_errors[at : at + len(a.terms)]
        at += len(a.terms)
    return errors
