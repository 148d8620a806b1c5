"""Statistics that hold at every look, so that whoever watches may stop when they like: sequences of intervals, evidence of pairs.

All of it rests on one fact. Wealth that is won by betting against a hypothesis that is true is a nonnegative martingale, and by
Ville's inequality it ever reaches 1 / chance at most with this chance, however often one looks. Mixing the wealth of many bets
needs no guess of the best one (Robbins, Ann. Math. Stat. 41 (1970) 1397; for bounded means: Waudby-Smith and Ramdas, J. R. Stat.
Soc. B 86 (2024) 1). Written out here, since the client shows sequences, too, and neither numpy nor scipy is needed for it.
"""

import math
from collections.abc import Callable
from functools import lru_cache

CHANCE = 0.05
"""How often a question is decided wrongly at most, if it is looked at after each goal for ever."""
BISECTIONS = 44
BETS = 48
"""Nodes of the mixture on each side. Half as many change no boundary by a pair."""
PRIOR = 0.5
"""Both parameters of the beta law that rates are mixed by: that of Krichevsky and Trofimov."""


def rate_sequence(successes: int, trials: int, level: float) -> tuple[float, float]:
    """The confidence sequence of a success rate after so many trials, as fractions.

    With probability ``level`` the true rate lies within all of them, from the first trial on. It is where the wealth of a
    bettor whose stakes are mixed by a beta law stays below 1 / (1 - level) (Robbins' mixture for a Bernoulli rate).
    """
    if trials == 0:
        return (0.0, 1.0)

    def refuted(rate: float) -> bool:
        return is_refuted(successes, trials, rate, 1 - level)

    rate = successes / trials
    low = 0.0 if successes == 0 else _edge(0.0, rate, refuted)
    high = 1.0 if successes == trials else _edge(1.0, rate, refuted)
    return (low, high)


def is_refuted(successes: int, trials: int, rate: float, chance: float) -> bool:
    """Whether a rate lies outside of the confidence sequence of level 1 - chance."""
    mixed = _log_beta(PRIOR + successes, PRIOR + trials - successes) - _log_beta(PRIOR, PRIOR)
    return mixed - _log_likelihood(successes, trials, rate) >= -math.log(chance)


def log_evidence(gained: int, lost: int) -> float:
    """The logarithm of the evidence (an e-value) that two policies differ, from the goals that only one of them reached.

    If both have the same rate, each such goal is as likely gained as lost, and the evidence ever exceeds 1 / ``CHANCE`` with that
    chance at most. It is the wealth of a bettor that has mixed stakes on both sides (a sequential McNemar test).
    """
    return log_wealth(gained, lost, 0, 0.0)


def difference_sequence(gained: int, lost: int, goals: int, level: float) -> tuple[float, float]:
    """The confidence sequence of the difference of two success rates on the same goals, as a fraction.

    It excludes 0 exactly when ``log_evidence`` exceeds the logarithm of 1 / (1 - level). Wealth is convex in the difference that
    is bet against, so that what is not refuted is one interval.
    """
    if goals == 0:
        return (-1.0, 1.0)
    most, seen = -math.log(1 - level), (gained - lost) / goals

    def refuted(difference: float) -> bool:
        return log_wealth(gained, lost, goals - gained - lost, difference) >= most

    low = -1.0 if lost == goals else _edge(-1.0, seen, refuted)
    high = 1.0 if gained == goals else _edge(1.0, seen, refuted)
    return (low, high)


def is_decided(gained: int, lost: int, chance: float = CHANCE) -> bool:
    """Whether the evidence of the pairs is enough to say which policy is better."""
    return log_evidence(gained, lost) >= -math.log(chance)


def _edge(outside: float, inside: float, refuted: Callable[[float], bool]) -> float:
    """Where an interval ends, on the safe side; ``outside`` if it does not end before."""
    if not refuted(outside + math.copysign(1e-12, inside - outside)):
        return outside
    for _ in range(BISECTIONS):
        middle = (outside + inside) / 2
        if refuted(middle):
            outside = middle
        else:
            inside = middle
    return outside


def _log_beta(one: float, other: float) -> float:
    return math.lgamma(one) + math.lgamma(other) - math.lgamma(one + other)


def _log_likelihood(successes: int, trials: int, rate: float) -> float:
    failures = trials - successes
    won = 0.0 if successes == 0 else successes * math.log(rate) if rate > 0 else -math.inf
    missed = 0.0 if failures == 0 else failures * math.log1p(-rate) if rate < 1 else -math.inf
    return won + missed


@lru_cache(maxsize=1)
def bets() -> tuple[tuple[float, float], ...]:
    """Stakes as fractions of the largest one, and the logarithms of their weights: a beta law of 2 and 2 on one side.

    It was chosen by exact calculation among others, since no other was better at small and at large differences.
    """
    stakes = [(index + 0.5) / BETS for index in range(BETS)]
    weights = [stake * (1 - stake) for stake in stakes]
    whole = 2 * sum(weights)
    return tuple((stake, math.log(weight / whole)) for stake, weight in zip(stakes, weights, strict=True))


@lru_cache(maxsize=50_000)
def log_wealth(gained: int, lost: int, alike: int, difference: float) -> float:
    """Logarithm of the mixed wealth against a difference, in terms of goals that were gained (+1), lost (-1) and alike (0)."""
    terms = []
    for stake, weight in bets():
        for side in (1.0, -1.0):
            bet = side * stake / (1 + side * difference)
            terms.append(
                weight
                + gained * math.log1p(bet * (1 - difference))
                + lost * math.log1p(-bet * (1 + difference))
                + alike * math.log1p(-bet * difference)
            )
    largest = max(terms)
    return largest + math.log(sum(math.exp(term - largest) for term in terms))
