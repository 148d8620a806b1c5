"""Forward selection of causes by what they gain on held-out tosses, with joint refits, and pruning in the end."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from sim_backend.reality_gap.subjects.tosses.likelihood import Point, bootstrap_sums, by_episode, held_out_gains, weights
from sim_backend.reality_gap.subjects.tosses.search import TossHypothesis, TossSearch, explored, first_look, refitted

_LEVEL = 0.01  # of a false name, shared by all hypotheses that are tried
_STANDARD_ERRORS = 3.0
_LEAST_SHARE = 0.02  # of the held-out error of one kind of evidence, as in the facts about the reality gap
_MOST_CAUSES = 4
_WORTH_NATS = 2.0  # gain that a first look must promise for all tosses; less than half of what the gates ask
_WORTH_SHARE = 0.2  # of the best promise: what promises less is fitted in a later stage, if it still promises something then


@dataclass(frozen=True)
class TossCandidate:
    """A hypothesis at one stage.

    Attributes:
        hypothesis: what it says.
        best: values and residuals at its best, with the causes named so far.
        points: all that were tried.
        gains: of each toss by kind on held-out folds, nats.
        sums: of each episode, all kinds together, nats.
        interval_90: of the total gain, by a bootstrap over episodes.
        shares: of the error of each kind that it removes.
        accepted: whether it passes the gates.
    """

    hypothesis: TossHypothesis
    best: Point
    points: tuple[Point, ...]
    gains: Mapping[str, np.ndarray]
    sums: np.ndarray
    interval_90: tuple[float, float]
    shares: Mapping[str, float]
    accepted: bool

    @property
    def gain(self) -> float:
        """Held-out gain of all tosses, nats."""
        return float(self.sums.sum())


@dataclass(frozen=True)
class Stage:
    """One step of the selection: its start, all candidates, which was taken (None if none), and the gain it needed, nats."""

    base: Point
    candidates: tuple[TossCandidate, ...]
    chosen: TossCandidate | None
    gate: float


@dataclass(frozen=True)
class Selection:
    """Named hypotheses with the jointly fitted point, and the stages that led there."""

    causes: tuple[TossHypothesis, ...]
    final: Point
    stages: tuple[Stage, ...]


def selected(
    study: TossSearch,
    hypotheses: Sequence[TossHypothesis],
    nominal: Mapping[str, float],
    folds: np.ndarray,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> Selection:
    """Causes that explain the data, none if nothing passes the gates.

    Args:
        study: tosses and evidence.
        hypotheses: to choose from.
        nominal: values to start from.
        folds: of each toss under study, shape (n,).
        rng: for bootstraps.
        progress: told the stage and the share that is done.
    """
    base, causes, stages = study.point(nominal), [], []
    while len(causes) < _MOST_CAUSES:
        rest = [hypothesis for hypothesis in hypotheses if hypothesis not in causes]
        looks = []
        for number, hypothesis in enumerate(rest):
            progress(f"stage {len(stages) + 1}: {hypothesis.effect}", (len(stages) + number / len(rest)) / _MOST_CAUSES)
            looks.append(first_look(study, hypothesis, base.values))
        worth = max(_WORTH_NATS, _WORTH_SHARE * max(look.promise for look in looks))
        candidates = [
            candidate(
                study, look.hypothesis, base, explored(study, look, base, look.promise >= worth), folds, len(hypotheses), rng
            )
            for look in looks
        ]
        passing = [one for one in candidates if one.accepted]
        chosen = max(passing, key=lambda one: one.gain) if passing else None
        stages.append(Stage(base, tuple(candidates), chosen, _chance(1, len(hypotheses))))
        if chosen is None:
            break
        causes.append(chosen.hypothesis)
        base, _ = refitted(study, _keys(causes), chosen.best)
    kept, final = _pruned(study, causes, base, nominal, folds, len(hypotheses), rng)
    return Selection(tuple(kept), final, tuple(stages))


def candidate(
    study: TossSearch,
    hypothesis: TossHypothesis,
    base: Point,
    points: Sequence[Point],
    folds: np.ndarray,
    hypotheses: int,
    rng: np.random.Generator,
) -> TossCandidate:
    """A hypothesis with its held-out gain and whether that passes.

    It must gain more than chance would give one of so many hypotheses (chi-square, level 1 %), more than three standard errors
    between episodes, and remove at least 2 % of the error of one kind of evidence.
    """
    kinds = study.evidence.kinds
    best = max((base, *points), key=study.score)
    gains = held_out_gains(kinds, weights(kinds, best.residuals), base, points, folds)
    sums = by_episode(np.sum(list(gains.values()), axis=0), study.evidence.episodes[study.rows])
    draws = bootstrap_sums(sums, rng)
    low, high = np.quantile(draws, [0.05, 0.95])
    shares = {kind.name: removed_share(base.residuals[kind.name], best.residuals[kind.name]) for kind in kinds}
    accepted = (
        sums.sum() > max(_chance(len(hypothesis.keys), hypotheses), _STANDARD_ERRORS * draws.std())
        and max(shares.values()) > _LEAST_SHARE
    )
    return TossCandidate(hypothesis, best, tuple(points), gains, sums, (float(low), float(high)), shares, bool(accepted))


def removed_share(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the mean size of residuals that is gone."""
    start = np.nanmean(np.abs(before))
    return float(1.0 - np.nanmean(np.abs(after)) / start) if start > 0.0 else 0.0


def _chance(parameters: int, hypotheses: int) -> float:
    return 0.5 * float(chi2.isf(_LEVEL / hypotheses, parameters))


def _keys(causes: Sequence[TossHypothesis]) -> tuple[str, ...]:
    return tuple(key for cause in causes for key in cause.keys)


def _pruned(
    study: TossSearch,
    causes: list[TossHypothesis],
    final: Point,
    nominal: Mapping[str, float],
    folds: np.ndarray,
    hypotheses: int,
    rng: np.random.Generator,
) -> tuple[list[TossHypothesis], Point]:
    """Causes without those that later ones have made needless, and the point that belongs to them."""
    for cause in causes[:-1]:
        others = [one for one in causes if one is not cause]
        values = {**final.values, **{key: nominal[key] for key in cause.keys}}
        without, _ = refitted(study, _keys(others), study.point(values))
        if not candidate(study, cause, without, [final], folds, hypotheses, rng).accepted:
            return _pruned(study, others, without, nominal, folds, hypotheses, rng)
    return causes, final
