"""Forward selection of causes among joints' effects: what gains most is taken, everything is fitted anew, until nothing gains."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.equations import Channel, EpisodeEquations
from sim_backend.reality_gap.evidence import FOLDS, NormalEquations, Whitened, folds_of, normal_equations, reduced, whitened
from sim_backend.reality_gap.hypotheses import SCALES, Catalogue, Hypothesis, joint_catalogue
from sim_backend.reality_gap.joint_state import SENSED, JointState, Term

Progress = Callable[[str, float], None]
MAX_CAUSES = 24
_NOISE_SCALES = {"link_mass": 0.03, "torque_constant": 0.02}
"""While noise is measured, scales of everything are held close to nominal, so that they do not explain it away."""
_BOUND_SIGMAS = 3.0
_REFINEMENTS = 2


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with what it would gain (nats) and its coefficients with their standard errors."""

    hypothesis: Hypothesis
    gain: float
    held_out: float
    values: np.ndarray
    errors: np.ndarray


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

    ``noise_ratio`` has shape (k,): noise of the mechanics relative to that of the sensors.
    """

    sums: NormalEquations
    catalogue: Catalogue
    equations: tuple[Whitened, ...]
    candidates: tuple[Candidate, ...]
    accepted_values: np.ndarray
    accepted_errors: np.ndarray
    sensed_share: np.ndarray
    sensed_error: np.ndarray
    noise_ratio: np.ndarray


@dataclass(frozen=True)
class JointFit:
    """What forward selection came to."""

    state: JointState
    accepted: tuple[Accepted, ...]
    looks: tuple[Look, ...]
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
    """

    def __init__(
        self, episodes: Sequence[EpisodeEquations], names: Sequence[str], *, has_pipeline: bool, excluded: Sequence[str] = ()
    ) -> None:
        self.episodes, self.names, self.has_pipeline, self.excluded = list(episodes), tuple(names), has_pipeline, tuple(excluded)
        self._load = np.concatenate([e.driving_nm.T for e in episodes])

    def look(self, state: JointState, accepted: Sequence[Accepted]) -> Look:
        """Linearise at a state and ask every hypothesis what it would gain."""
        step_s = self.episodes[0].path.step_s
        catalogue = joint_catalogue(self.names, state, self._load, step_s, has_pipeline=self.has_pipeline)
        catalogue = catalogue.without(self.excluded)
        own = [term for a in accepted for term in a.terms]
        terms = (*catalogue.terms, *own)
        tolerance = np.concatenate([catalogue.tolerance, [SCALES[term.key] for term in own]])
        for i, term in enumerate(catalogue.terms):  # what is in the model already needs no tolerance beside it
            if any(term.key == t.key and term.index == t.index for t in own):
                tolerance[i] = 0.0
        whitening = np.array([_NOISE_SCALES.get(t.effect, SCALES.get(t.key, s)) for t, s in zip(terms, tolerance, strict=True)])
        whitening[len(catalogue.terms) :] = tolerance[len(catalogue.terms) :]
        whitening[[t.effect in self.excluded for t in terms]] = 0.0
        found = []
        for episode in self.episodes:
            for equation in episode.equations(state, terms):
                white = whitened(equation, whitening[list(equation.terms)], folds_of(equation, len(self.episodes)))
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
            if not within_bounds([catalogue.terms[t] for t in h.terms], values, errors, state):
                continue
            gain = whole.gain(h.terms, h.scales)
            held_out = sum(gain - part.gain(h.terms, h.scales) for part in parts)
            if not any(tolerance[t] > 0.0 for t in h.terms):
                gain = min(gain, held_out)
            candidates.append(Candidate(h, gain, held_out, values, errors))
        candidates.sort(key=lambda c: -c.gain)
        first_own = len(catalogue.terms)
        mean, error = _posterior(sums, base, tolerance)
        sensed = [i for i, t in enumerate(catalogue.terms) if t.key == SENSED]
        return Look(
            sums,
            catalogue,
            found,
            tuple(candidates),
            mean[first_own:],
            error[first_own:],
            mean[sensed],
            error[sensed],
            _noise_ratio(found, len(self.names)),
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
            s + 3.0 * e > 0.0
            for s, e in zip(values[::2] + values[1::2], np.hypot(errors[::2], errors[1::2]), strict=True)
        )
    for term, value, error in zip(terms, values, errors, strict=True):
        parameter, here = PARAMETERS[term.key], state.value(term.key)[term.index]
        slack = _BOUND_SIGMAS * error + 1e-12
        if not parameter.lower - slack <= here + value <= parameter.upper + slack:
            return False
    return True


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
    return tuple(found)


def select(
    problem: JointProblem,
    state: JointState,
    gate: float,
    progress: Progress,
    *,
    min_share: float = 0.01,
    accepts: Callable[[Look], Candidate | None] | None = None,
) -> JointFit:
    """Take causes one after the other.

    Args:
        problem: the episodes.
        state: to start from.
        gate: least gain of a cause, nats.
        progress: told what is done, and which share.
        min_share: least share of what is left unexplained that a cause beyond the first must take away.
        accepts: chooses among a look's candidates instead of the one that gains most.
    """
    looks, accepted = [problem.look(state, ())], []
    while len(accepted) < MAX_CAUSES:
        look = looks[-1]
        best = accepts(look) if accepts is not None else (look.candidates[0] if look.candidates else None)
        left = 0.5 * look.sums.square.sum()
        least = gate if not accepted else max(gate, min_share * left)
        if best is None or best.gain < least:
            break
        progress(f"{best.hypothesis.effect}, {best.hypothesis.where}", min(0.9, 0.2 + 0.1 * len(accepted)))
        terms = tuple(look.catalogue.terms[i] for i in best.hypothesis.terms)
        state = moved(state, terms, best.values)
        accepted = [a for a in accepted if not _contains(best.hypothesis, a)]
        own = refining_terms(look.catalogue, best.hypothesis)
        accepted.append(Accepted(best.hypothesis.effect, best.hypothesis.where, own, best.gain))
        for _ in range(_REFINEMENTS):
            look = problem.look(state, accepted)
            state = _refined(state, accepted, look.accepted_values)
        looks.append(problem.look(state, accepted))
    return JointFit(state, tuple(accepted), tuple(looks), _errors(accepted, looks[-1]))


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

