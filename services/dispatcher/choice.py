"""Which robot a queued trial goes to: a pure function of its drawn order and of who is in service."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Choice:
    """The trial's order, its first choice within it, and why that is not the order's first robot."""

    order: tuple[str, ...]
    first_choice: str | None
    departure: str | None


def choose(order: Sequence[str], healthy: Collection[str], faulted: Collection[str], why: Callable[[str], str]) -> Choice:
    """The first robot of the order that is in service and did not fail this trial before.

    When all in service have failed it, the first in service; robots that joined after the draw come after the drawn ones.

    Args:
        order: the trial's drawn order.
        healthy: the robots in service, idle or busy.
        faulted: the robots on which an attempt of this trial failed by the platform's fault.
        why: says of a robot that is not in service what is wrong, as the end of a sentence that begins with its name.
    """
    first = next((place for place, robot in enumerate(order) if robot in healthy and robot not in faulted), None)
    if first is not None:  # as nearly always: a thousand others need not be put into an order
        return Choice(tuple(order), order[first], _departure(order[:first], healthy, why))
    extended = (*order, *sorted(set(healthy) - set(order)))
    fit = [robot for robot in extended if robot in healthy]
    if not fit:
        return Choice(tuple(order), None, None)
    chosen = next((robot for robot in fit if robot not in faulted), fit[0])
    place = extended.index(chosen)
    kept = extended[: max(len(order), place + 1)]
    return Choice(kept, chosen, _departure(extended[:place], healthy, why))


def _departure(skipped: Sequence[str], healthy: Collection[str], why: Callable[[str], str]) -> str | None:
    reasons = [f"{robot} {'refused or failed an earlier attempt' if robot in healthy else why(robot)}" for robot in skipped]
    return "; ".join(reasons) or None
