"""Which rungs of a ladder are given up before all of their goals were tried: from how their trials ended, goal by goal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
    going, goals = list(range(len(ended))), 0
    while goals < most and not _is_known(given_up, ends):
        racing = [rung for rung in going if len(ended[rung]) > goals or not stopped[rung]]
        if not racing or any(len(ended[rung]) <= goals for rung in racing):
            break
        going, goals = racing, goals + 1
        for rung in _beaten(ended, going, goals, most, ends):
            given_up[rung] = goals
        going = [rung for rung in going if given_up[rung] is None]
    left = tuple(rung for rung in going if len(ended[rung]) > goals or not stopped[rung])
    return Race(goals, tuple(given_up), left, goals >= most or not left or _is_known(given_up, ends))


def _is_known(given_up: Sequence[int | None], ends: LadderEnds) -> bool:
    """Whether one is better than all others; where some were cancelled, nobody knows that."""
    return ends is LadderEnds.KNOWN and 0 < len(given_up) - 1 == sum(each is not None for each in given_up)


def _beaten(ended: Sequence[Sequence[bool]], going: Sequence[int], goals: int, most: int, ends: LadderEnds) -> Sequence[int]:
    if ends is LadderEnds.HALVING:
        if goals not in stages(len(ended), most):
            return ()
        best_first = sorted(going, key=lambda rung: (-sum(ended[rung][:goals]), -rung))  # of equals the later step stays
        return best_first[math.ceil(len(going) / 2) :]
    chance = pair_chance(len(ended))
    return [rung for rung in going if any(_is_better(ended[other], ended[rung], goals, chance) for other in going)]


def _is_better(one: Sequence[bool], other: Sequence[bool], goals: int, chance: float) -> bool:
    pairs = list(zip(one[:goals], other[:goals], strict=True))
    gained, lost = pairs.count((True, False)), pairs.count((False, True))
    return gained > lost and is_decided(gained, lost, chance)


def stages(rungs: int, most: int) -> tuple[int, ...]:
    """After how many goals half of the rungs are given up, so that each stage takes about as many trials as the next.

    Successive halving (Karnin, Koren and Somekh, ICML 2013; Jamieson and Talwalkar, AISTATS 2016): the last one has all goals.
    """
    halvings = math.ceil(math.log2(rungs)) if rungs > 1 else 0
    return tuple(dict.fromkeys(max(1, round(most / 2**left)) for left in range(halvings, 0, -1)))
