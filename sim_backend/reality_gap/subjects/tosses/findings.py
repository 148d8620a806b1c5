"""What a selection means: causes with intervals, what lost and why, what these data cannot tell, and what to record next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.tosses.evidence import FLIGHT, MOTION, REST, TossEvidence
from sim_backend.reality_gap.subjects.tosses.likelihood import Point, by_episode, densities, total, weights
from sim_backend.reality_gap.subjects.tosses.models import MASS
from sim_backend.reality_gap.subjects.tosses.search import TossHypothesis, TossSearch, bounds_of, refitted
from sim_backend.reality_gap.subjects.tosses.selection import Selection, Stage, TossCandidate
from sim_backend.reality_gap.verdict import Cause, Rival

_PROFILE_STEPS = np.array([-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0])
_DRAWS = 400
_WIDEST = 5.0  # factor of an interval: a parabola through few points shows no higher correlation
_CLEAR_NATS = 2.0  # and two standard errors: what a kind of evidence must say to speak for a rival
_REJECTED_NATS = 0.5 * float(chi2.isf(0.01 / 8.0, 1))  # and three standard errors: as a cause among eight hypotheses is named
_BODY_STEPS = np.array([-0.07, -0.035, 0.035, 0.07])  # of the value: what a ruler or scale at hand would tell apart
_WIDE = 0.02  # of the value: a range of values that tells no more than this is worth no warning


@dataclass(frozen=True)
class Profile:
    """Log density over one parameter, all others at their best: values, nats below the best, and the interval at 90 %."""

    key: str
    value: np.ndarray
    log_likelihood: np.ndarray
    interval_90: tuple[float, float]


@dataclass(frozen=True)
class Lost:
    """A hypothesis that explains part of what a cause explains.

    Attributes:
        rival: its name, how far it lies behind, what separates it.
        cause: effect that won.
        behind_std: standard error of the distance, nats.
        value: at which it explains most.
        by_kind: nats by which it lies behind in each kind of evidence.
        std_by_kind: standard error of each of them, between episodes.
        hypothesis: what it says.
        point: the best values with it in the place of the cause.
    """

    rival: Rival
    cause: str
    behind_std: float
    value: float
    by_kind: Mapping[str, float]
    std_by_kind: Mapping[str, float]
    hypothesis: TossHypothesis
    point: Point

    @property
    def confusable(self) -> bool:
        """Whether no kind of evidence rejects it by the gate that names a cause, or one clearly speaks for it.

        Kinds are independent measurements, so each is asked by itself: motion, in which rival and cause differ by chance only,
        would else drown what free flight says.
        """
        of = [(nats, self.std_by_kind[name]) for name, nats in self.by_kind.items()]
        rejected = any(nats > max(_REJECTED_NATS, 3.0 * std) for nats, std in of)
        return not rejected or any(-nats > max(_CLEAR_NATS, 2.0 * std) for nats, std in of)


def profile(study: TossSearch, key: str, final: Point, rng: np.random.Generator) -> Profile:
    """Profile and interval of one named parameter.

    The interval is the wider one of two: where the log density (weighted for errors that tosses share) is within the 90 %
    point of chi-square / 2 of its best, and where the best value moves when episodes are drawn with replacement.
    """
    values, points = _spread(study, key, final)
    kinds, weight = study.evidence.kinds, weights(study.evidence.kinds, final.residuals)
    score = np.array([total(kinds, weight, point.residuals) for point in points])
    everything = np.ones(len(study.rows), bool)
    per_toss = np.array([sum(densities(kinds, weight, point.residuals, everything).values()) for point in points])
    table = np.array([by_episode(row, study.evidence.episodes[study.rows]) for row in per_toss])
    n = table.shape[1]
    peaks = [_peak(values, table @ rng.multinomial(n, np.full(n, 1.0 / n))) for _ in range(_DRAWS)]
    low, high = np.quantile(peaks, [0.05, 0.95])
    fine = np.linspace(values[0], values[-1], 2001)
    inside = fine[np.interp(fine, values, score) > score.max() - 0.5 * chi2.isf(0.10, 1)]
    best = final.values[key]
    interval = min(low, inside.min(), best), max(high, inside.max(), best)
    return Profile(key, values, score - score.max(), (float(interval[0]), float(interval[1])))


def profiles_of(study: TossSearch, hypothesis: TossHypothesis, final: Point, rng: np.random.Generator) -> list[Profile]:
    """Profiles of one hypothesis; intervals of two parameters that can stand in for each other are widened accordingly."""
    found = [profile(study, key, final, rng) for key in hypothesis.keys]
    if len(found) < 2:
        return found
    factor = _ridge(study, found, final)
    return [replace(one, interval_90=_widened(one.key, final.values[one.key], one.interval_90, factor)) for one in found]


def _ridge(study: TossSearch, found: Sequence[Profile], final: Point) -> float:
    """1 / sqrt(1 - r^2) with the correlation r of two parameters, from the log density at four corners around the best."""
    reach = [max(0.5 * (one.interval_90[1] - one.interval_90[0]), 1e-9) for one in found]
    keys, best = [one.key for one in found], study.score(final)

    def drop(*signs: float) -> float:
        values = {key: final.values[key] + sign * size for key, sign, size in zip(keys, signs, reach, strict=True)}
        clipped = {key: float(np.clip(value, *bounds_of(key))) for key, value in values.items()}
        return study.score(study.point({**final.values, **clipped})) - best

    cross = (drop(1, 1) - drop(1, -1) - drop(-1, 1) + drop(-1, -1)) / 4.0
    own = [drop(1, 0) + drop(-1, 0), drop(0, 1) + drop(0, -1)]
    if max(own) >= 0.0:
        return _WIDEST
    return float(1.0 / np.sqrt(max(1.0 - cross**2 / (own[0] * own[1]), 1.0 / _WIDEST**2)))


def _widened(key: str, value: float, interval: tuple[float, float], factor: float) -> tuple[float, float]:
    lower, upper = bounds_of(key)
    return max(value - factor * (value - interval[0]), lower), min(value + factor * (interval[1] - value), upper)


def _spread(study: TossSearch, key: str, final: Point) -> tuple[np.ndarray, list[Point]]:
    """Values on both sides of the best, as far as the log density falls by a few nats, and their points."""
    lower, upper = bounds_of(key)
    reach = 0.3 * abs(final.values[key]) if lower > 0.0 else 0.3 * upper
    best = study.score(final)
    for _ in range(5):
        ends = [study.point({**final.values, key: float(np.clip(final.values[key] + s * reach, lower, upper))}) for s in (-1, 1)]
        if min(best - study.score(end) for end in ends) < 30.0:
            break
        reach *= 0.5
    values = np.unique(np.clip(final.values[key] + reach * _PROFILE_STEPS, lower, upper))
    return values, [study.point({**final.values, key: float(value)}) for value in values]


def _peak(values: np.ndarray, score: np.ndarray) -> float:
    """Vertex of the parabola through the best value and its neighbours."""
    best = int(np.clip(np.argmax(score), 1, len(values) - 2))
    a, b, _ = np.polyfit(values[best - 1 : best + 2] - values[best], score[best - 1 : best + 2], 2)
    if a >= 0.0 or np.argmax(score) in (0, len(values) - 1):
        return float(values[np.argmax(score)])
    return float(np.clip(values[best] - 0.5 * b / a, values[best - 1], values[best + 1]))


def causes_of(hypotheses: Sequence[TossHypothesis], point: Point, profiles: Sequence[Profile]) -> tuple[Cause, ...]:
    """One for each parameter of each hypothesis."""
    of, out = {one.key: one for one in profiles}, []
    for hypothesis in hypotheses:
        for key in hypothesis.keys:
            parameter, value = key.partition(".")[2], float(point.values[key])
            out.append(Cause(hypothesis.effect, parameter, hypothesis.where, value, PARAMETERS[key].unit, of[key].interval_90))
    return tuple(out)


def members_of(study: TossSearch, lost: Sequence[Lost], rng: np.random.Generator) -> tuple[Cause, ...]:
    """The hypotheses that cannot be told from a cause, each with the values it would have in the cause's place."""
    out: list[Cause] = []
    for one in lost:
        if one.confusable:
            out += causes_of([one.hypothesis], one.point, profiles_of(study, one.hypothesis, one.point, rng))
    return tuple(out)


def lost_of(study: TossSearch, selection: Selection, nominal: Mapping[str, float]) -> tuple[Lost, ...]:
    """For each cause what else would explain part of the same, closest first.

    Such a hypothesis gained something beside the cause, for the same kinds of evidence, and is not accepted after it; whether it
    passed the gates does not matter, for one that barely failed may still be the truth. It is put in the place of the cause in
    the final model and fitted again there.
    """
    out = []
    for number, stage in enumerate(selection.stages):
        if stage.chosen is None or stage.chosen.hypothesis not in selection.causes:
            continue
        later = selection.stages[number + 1 :]
        for one in stage.candidates:
            needless = one.hypothesis not in selection.causes and one.gain > _CLEAR_NATS and _needless(one, later)
            if needless and _overlap(one, stage.chosen) > 0.5:
                out.append(_swapped(study, selection.final, stage.chosen.hypothesis, one, nominal))
    return tuple(sorted(out, key=lambda lost: lost.rival.behind))


def _overlap(one: TossCandidate, chosen: TossCandidate) -> float:
    """Share of a candidate's gain that lies in kinds of evidence in which the chosen one gains as well."""
    own = {name: max(float(gain.sum()), 0.0) for name, gain in one.gains.items()}
    both = {name: min(own[name], max(float(gain.sum()), 0.0)) for name, gain in chosen.gains.items()}
    return sum(both.values()) / max(sum(own.values()), 1e-12)


def _swapped(study: TossSearch, final: Point, cause: TossHypothesis, one: TossCandidate, nominal: Mapping[str, float]) -> Lost:
    values = {**final.values, **{key: nominal[key] for key in cause.keys}}
    values |= {key: one.best.values[key] for key in one.hypothesis.keys}
    point, _ = refitted(study, one.hypothesis.keys, study.point(values))
    kinds, everything = study.evidence.kinds, np.ones(len(study.rows), bool)
    weight = weights(kinds, final.residuals)
    best, other = (densities(kinds, weight, residuals, everything) for residuals in (final.residuals, point.residuals))
    lead = {name: best[name] - other[name] for name in best}
    episodes = study.evidence.episodes[study.rows]
    sums = by_episode(np.sum(list(lead.values()), axis=0), episodes)
    by_kind = {name: float(values.sum()) for name, values in lead.items()}
    std_by_kind = {name: _std_of_sum(by_episode(values, episodes)) for name, values in lead.items()}
    surest = max(by_kind, key=lambda name: by_kind[name] / (1.0 + std_by_kind[name]))
    about = {kind.name: kind.about for kind in kinds}[surest]
    rival = Rival(one.hypothesis.effect, one.hypothesis.where, float(sums.sum()), about)
    value = float(point.values[one.hypothesis.keys[0]])
    return Lost(rival, cause.effect, _std_of_sum(sums), value, by_kind, std_by_kind, one.hypothesis, point)


def _std_of_sum(sums: np.ndarray) -> float:
    return float(np.sqrt(len(sums)) * sums.std())


def _needless(one: TossCandidate, later: Sequence[Stage]) -> bool:
    return not any(c.hypothesis == one.hypothesis and c.accepted for stage in later for c in stage.candidates)


def undecided(study: TossSearch, selection: Selection, hypotheses: Sequence[TossHypothesis]) -> tuple[str, ...]:
    """Sentences on what the motion cannot tell: mass and size and contacts whose change leaves its error as it is."""
    named, out = {key for cause in selection.causes for key in cause.keys}, []
    if MOTION not in selection.final.residuals:
        return ("nothing moves through contacts in these data: friction, stiffness and mass cannot be told",)
    for hypothesis in hypotheses:
        key = hypothesis.keys[0]
        if hypothesis.known.of_contact and key not in named:
            out += _flat(study, hypothesis, key, selection.final)
    return tuple(out)


def _flat(study: TossSearch, hypothesis: TossHypothesis, key: str, final: Point) -> list[str]:
    """A sentence if values around the best one leave the error of the motion within one standard error between tosses."""
    rows, value = study.rows.tolist(), final.values[key]
    error = final.residuals[MOTION]
    tried = np.unique(np.clip(value * (1.0 + _BODY_STEPS), *bounds_of(key)))
    errors = np.array([np.nanmean(study.evidence.motion({**final.values, key: float(v)}, rows)) for v in tried])
    std = float(np.nanstd(error) / np.sqrt(np.isfinite(error).sum()))
    change = np.abs(errors - np.nanmean(error))
    if change.max() < 1e-6:
        return [
            f"{hypothesis.effect}: not identifiable, no value changes the motion: nothing but gravity and contacts acts on it"
        ]
    inside = [float(v) for v, c in zip(tried, change, strict=True) if c < std]
    low, high = min([*inside, value]), max([*inside, value])
    if high - low < 2.0 * _WIDE * value:
        return []
    return [
        f"{hypothesis.effect}.{key.partition('.')[2]}: not identifiable from the motion alone: {low:.3g} to {high:.3g} change its"
        f" error by less than one standard error ({100.0 * std:.2g} % of the width, {np.isfinite(error).sum()} tosses)"
    ]


def record_next(evidence: TossEvidence, lost: Sequence[Lost], selection: Selection) -> tuple[str, ...]:
    """What would add most: kinds of evidence that are missing, and measurements that separate what is confusable."""
    have, out = {kind.name for kind in evidence.kinds}, []
    if FLIGHT not in have:
        out.append("tosses with at least 0.1 s of free flight: their acceleration separates a length scale from a size")
    if REST not in have:
        out.append("let the object come to rest before a recording ends: its height gives size, scale or table height")
    if MOTION not in have:
        out.append("toss or slide the object: only motion through contacts shows friction and stiffness")
    out += [
        f"what separates {one.cause} from {one.rival.effect}: measure {one.hypothesis.known.measured_by}"
        for one in lost
        if one.confusable
    ]
    if not any(MASS in cause.keys for cause in selection.causes):
        out.append("weigh the object, or push it with a known force: tosses alone never show its mass")
    return tuple(out)
