"""What a question can find out with so many goals, told before the start: exact, by the law of the test itself."""

from functools import lru_cache

import numpy as np

from api_schemas.anytime import CHANCE, is_decided
from api_schemas.question import QuestionRequest, Verdict, side_of

ENOUGH = 0.80
"""A difference counts as findable if it is found with this probability."""
AGAINST_THE_TREND = 0.05
"""Share of goals that only the worse policy reaches; nobody knows it before, and with more of them it takes longer."""
MOST_GOALS = 1000
MOST_POINTS = 90
"""With so many points of difference all other goals are reached by the better policy alone."""


def needed_gains() -> np.ndarray:
    """``needed_gains_at`` the chance of a single question."""
    return needed_gains_at(CHANCE)


@lru_cache(maxsize=8)
def needed_gains_at(chance: float) -> np.ndarray:
    """For each number of goals on which two policies differ, of how many the one must be the better, shape (MOST_GOALS + 1,).

    Where even all are too few, one more than there are.
    """
    needed, gains = np.empty(MOST_GOALS + 1, dtype=np.int64), 1
    for differing in range(MOST_GOALS + 1):
        gains = max(gains, (differing + 1) // 2)
        while gains <= differing and not is_decided(gains, differing - gains, chance):
            gains += 1
        needed[differing] = gains
    return needed


def decided_within(goals: int, lost: float, gained: float) -> tuple[float, float]:
    """Probability that a pair is decided within so many goals, and the mean number of goals until then or until their end.

    Args:
        goals: at most ``MOST_GOALS``.
        lost: share of goals that only the one policy reaches.
        gained: share of goals that only the other reaches.
    """
    needed, differing = needed_gains(), lost + gained
    if differing == 0:
        return 0.0, float(goals)
    share = gained / differing
    still = np.zeros(goals + 2)  # by the number of gains
    still[0] = 1.0
    open_after = np.ones(goals + 1)  # by the number of goals on which they differed
    for number in range(1, goals + 1):
        moved = still * (1 - share)
        moved[1:] += share * still[:-1]
        gains = np.arange(goals + 2)
        moved[(gains >= needed[number]) | (number - gains >= needed[number])] = 0.0
        open_after[number], still = moved.sum(), moved
    law, mean, stays = _counts(goals, differing), 0.0, 1.0
    for taken in range(goals):
        mean += stays
        stays = float(law[taken + 1, : goals + 1] @ open_after)
    return 1 - stays, mean


def _counts(goals: int, share: float) -> np.ndarray:
    """Laws of the number of goals on which two policies differ after 0 to ``goals``, shape (goals + 1, goals + 1)."""
    law = np.zeros((goals + 1, goals + 1))
    law[0, 0] = 1.0
    for taken in range(goals):
        law[taken + 1] = law[taken] * (1 - share)
        law[taken + 1, 1:] += share * law[taken, :-1]
    return law


@lru_cache(maxsize=256)
def findable_difference(goals: int) -> float | None:
    """The smallest difference of two rates that is found within so many goals, to a point; None if there is none."""
    low, high = 1, MOST_POINTS + 1
    while low < high:
        middle = (low + high) // 2
        found, _ = decided_within(goals, AGAINST_THE_TREND, AGAINST_THE_TREND + middle / 100)
        low, high = (low, middle) if found >= ENOUGH else (middle + 1, high)
    return low / 100 if low <= MOST_POINTS else None


@lru_cache(maxsize=256)
def goals_needed(difference: float) -> int | None:
    """Within how many goals such a difference is found; None if not within ``MOST_GOALS``."""
    low, high = 1, MOST_GOALS + 1
    gained = min(AGAINST_THE_TREND + difference, 1 - AGAINST_THE_TREND)
    while low < high:
        middle = (low + high) // 2
        found, _ = decided_within(min(middle, MOST_GOALS), AGAINST_THE_TREND, gained)
        low, high = (low, middle) if found >= ENOUGH else (middle + 1, high)
    return low if low <= MOST_GOALS else None


def rate_decided_within(trials: int, bar: float, rate: float) -> float:
    """Probability that a policy of this rate is found to lie on its side of the bar within so many trials."""
    still, found = np.zeros(trials + 2), 0.0
    still[0] = 1.0
    below, above = _bounds(trials, bar)
    for number in range(1, trials + 1):
        moved = still * (1 - rate)
        moved[1:] += rate * still[:-1]
        right = slice(above[number], None) if rate > bar else slice(0, below[number] + 1)
        found += moved[right].sum()
        moved[above[number] :] = 0.0
        moved[: below[number] + 1] = 0.0
        still = moved
    return float(found)


@lru_cache(maxsize=64)
def _bounds(trials: int, bar: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """For each number of trials the most successes that say below, -1 if none do, and the fewest that say above."""
    below, above = [-1], [1]
    for number in range(1, trials + 1):
        most, fewest = below[-1], above[-1]
        while most + 1 <= number and side_of(most + 1, number, bar) is Verdict.BELOW:
            most += 1
        while fewest <= number and side_of(fewest, number, bar) is not Verdict.ABOVE:
            fewest += 1
        below.append(most)
        above.append(fewest)
    return tuple(below), tuple(above)


def findable(request: QuestionRequest, goals: int) -> str:
    """What can be found out, as a sentence."""
    if request.bar is not None:
        return _findable_beside(request.bar, goals)
    smallest = findable_difference(goals)
    if smallest is None:
        return f"cannot decide within {goals} goals: even a policy that is always better would hardly be found to be"
    often, against = f"{100 * ENOUGH:.0f} %", f"{100 * AGAINST_THE_TREND:.0f} %"
    told = f"a difference of {100 * smallest:.0f} points is found within {goals} goals {often} of the time"
    told += f", if {against} of goals go the other way"
    if request.at_least is None or request.at_least >= smallest:
        return told
    needed = goals_needed(request.at_least)
    enough = f"{needed} goals would do" if needed is not None else f"more than {MOST_GOALS} goals would be needed"
    return f"cannot be counted on to decide {100 * request.at_least:g} points within {goals} goals ({enough}): {told}"


def _findable_beside(bar: float, trials: int) -> str:
    sides, often = [], f"{100 * ENOUGH:.0f} %"
    for word, step, end in (("above", 1, 100), ("below", -1, 0)):
        first = round(100 * bar) + step
        rates = [point / 100 for point in range(first, end + step, step)]
        found = next((rate for rate in rates if rate_decided_within(trials, bar, rate) >= ENOUGH), None)
        if found is not None:
            sides.append(f"{word} it from {100 * found:.0f} % {'on' if step > 0 else 'down'}")
    if not sides:
        return f"cannot decide within {trials} trials on which side of {100 * bar:g} % a policy lies"
    return f"within {trials} trials a policy is found to lie {' and '.join(sides)}, {often} of the time"
