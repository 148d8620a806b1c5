"""Which rungs of a ladder are given up before all of their goals were tried: from how their trials ended, goal by goal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

from api_schemas.anytime import is_decided
from api_schemas.ladder import LadderEnds
from api_schemas.letters import pair_chance


@dataclass(frozen=True)
class Race:
    """How a race stands after ``goals``: after how many each rung was given up, None if it was not, and which go on.

    ``is_over`` says that no further goal is needed of any.
    """

    goals: int
    given_up: tuple[int | None, ...]
    going: tuple[int, ...]
    is_over: bool


def race(ended: Sequence[Sequence[bool]], stopped: Sequence[bool], most: int, ends: LadderEnds) -> Race:
    """How it stands, looked at after each goal that all rungs which go on have tried, whenever that is asked.

    Args:
        ended: of each rung, in the order of steps, how its first trials ended.
        stopped: whether a rung's job has ended otherwise, so that it has no more than these.
        most: goals of each rung.
        ends: by which rule rungs are given up.
    """
    given_up: list[int | None] = [None] * len(ended)
    reached = [0] * len(ended)
    going, goals = list(range(len(ended))), 0
    while goals < most and not _is_known(given_up, ends):
        racing = [rung for rung in going if len(ended[rung]) > goals or not stopped[rung]]
        if not racing or any(len(ended[rung]) <= goals for rung in racing):
            break
        for rung in racing:
            reached[rung] |= ended[rung][goals] << goals
        going, goals = racing, goals + 1
        for rung in _beaten(reached, going, goals, most, ends):
            given_up[rung] = goals
        going = [rung for rung in going if given_up[rung] is None]
    left = tuple(rung for rung in going if len(ended[rung]) > goals or not stopped[rung])
    return Race(goals, tuple(given_up), left, goals >= most or not left or _is_known(given_up, ends))


def _is_known(given_up: Sequence[int | None], ends: LadderEnds) -> bool:
    """Whether one is better than all others; where some were cancelled, nobody knows that."""
    return ends is LadderEnds.KNOWN and 0 < len(given_up) - 1 == sum(each is not None for each in given_up)


def _beaten(reached: Sequence[int], going: Sequence[int], goals: int, most: int, ends: LadderEnds) -> Sequence[int]:
    """Who of those that are going is given up now; ``reached`` has for each rung a bit for each goal that it reached."""
    counts = {rung: reached[rung].bit_count() for rung in going}
    if ends is LadderEnds.HALVING:
        if goals not in stages(len(reached), most):
            return ()
        best_first = sorted(going, key=lambda rung: (-counts[rung], -rung))  # of equals the later step stays
        return best_first[math.ceil(len(going) / 2) :]
    chance = pair_chance(len(reached))
    lead, best = _least_lead(chance), max(counts.values())

    def is_beaten(rung: int) -> bool:
        ahead = (other for other in going if counts[other] - counts[rung] >= lead)
        return any(_is_better(reached[other], reached[rung], chance) for other in ahead)

    return [rung for rung in going if best - counts[rung] >= lead and is_beaten(rung)]


@lru_cache
def _least_lead(chance: float) -> int:
    """By how many goals a rung that is better is ahead at least: with goals lost, too, the same lead is less evidence.

    Few pairs of many rungs are so far apart, and to weigh each of all pairs after each goal takes seconds.
    """
    return next(lead for lead in count(1) if is_decided(lead, 0, chance))


def _is_better(one: int, other: int, chance: float) -> bool:
    return is_decided((one & ~other).bit_count(), (other & ~one).bit_count(), chance)


def stages(rungs: int, most: int) -> tuple[int, ...]:
    """After how many goals half of the rungs are given up, so that each stage takes about as many trials as the next.

    Successive halving (Karnin, Koren and Somekh, ICML 2013; Jamieson and Talwalkar, AISTATS 2016): the last one has all goals.
    """
    halvings = math.ceil(math.log2(rungs)) if rungs > 1 else 0
    return tuple(dict.fromkeys(max(1, round(most / 2**left)) for left in range(halvings, 0, -1)))
