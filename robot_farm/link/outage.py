"""An API that is out of the robot's reach: which attempt that cut off, and when the robot takes offers again.

The bus may live meanwhile, and the dispatcher would give the robot one trial after the other, none of which could come home.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from robot_farm.link.api_link import ApiFailedError, ApiUnreachableError, Patience
from robot_farm.link.lease_keeper import LeaseKeeper

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 300.0
"""After an attempt that was cut off the API is asked again after the first of these, which each further one in a row doubles: a
robot that it answers only sometimes costs the farm little."""
ASK_AGAIN_S = 2.0


@dataclass(frozen=True)
class Standing:
    """How a robot stands with the API, as each heartbeat tells it.

    Attributes:
        reason: what it waits for, None if for nothing.
        takes_offers: false while it could bring nothing home.
        api_away: whether that is because the API does not answer.
        disk_full: whether that is because its disk has no room for a trial.
        cut_off: trial and fence of the attempt that the API does not answer, or did not when it ended.
    """

    reason: str | None = None
    takes_offers: bool = True
    api_away: bool = False
    disk_full: bool = False
    cut_off: tuple[str, int] | None = None


class Outage:
    """Owner of what the robot knows of the API's absence; told by the robot, asked by the threads of the bus."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._keeper: LeaseKeeper | None = None
        self._away: str | None = None
        self._cut_off: tuple[str, int] | None = None
        self._pause_s, self._ask_at_s = FIRST_PAUSE_S, 0.0
        self.waits: str | None = None
        """Why the last try to send or to fetch something failed, while it is tried again."""

    def begin(self, keeper: LeaseKeeper) -> None:
        """An attempt begins."""
        self._cut_off, self.waits, self._keeper = None, None, keeper

    def patience(self, keeper: LeaseKeeper, stop: threading.Event) -> Patience:
        """Waits as long as the lease is renewed and nobody wants the robot or the trial to end."""

        def waits(error: ApiUnreachableError | None) -> bool:
            if error is not None:
                self.waits = str(error)
            return keeper.holds() and not stop.is_set()

        return waits

    def came_home(self) -> None:
        """The API took the attempt's outcome."""
        self._keeper, self._pause_s, self.waits = None, FIRST_PAUSE_S, None

    def ended(self, error: ApiUnreachableError | None = None) -> None:
        """The attempt is over; nothing happens if it came home.

        Args:
            error: by which its outcome did not.
        """
        if (keeper := self._keeper) is None:
            return
        why = keeper.unanswered if error is None or isinstance(error, ApiFailedError) else str(error)
        if why is not None and keeper.hangs is None:
            self._away, self._cut_off = f"the API does not answer: {why}", keeper.claim
            self._ask_at_s = time.monotonic() + self._pause_s
            self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)
            self._say(f"takes no offers for now: {self._away}")
        self._keeper = self.waits = None

    def look(self, ask: Callable[[], None]) -> None:
        """Asks the API, now and then, if it was away; the robot takes offers again when it answers.

        Raises:
            NotAdmittedError: the farm does not take the robot any more.
        """
        if self._away is None or time.monotonic() < self._ask_at_s:
            return
        try:
            ask()
        except ApiUnreachableError as error:
            self._away, self._ask_at_s = f"the API does not answer: {error}", time.monotonic() + ASK_AGAIN_S
        else:
            self._away = None
            self._say("the API answers again")

    def standing(self) -> Standing:
        """How it is now."""
        keeper = self._keeper
        if keeper is None:
            is_away = self._away is not None
            return Standing(self._away, takes_offers=not is_away, api_away=is_away, cut_off=self._cut_off)
        if keeper.hangs is not None:
            return Standing(keeper.hangs, takes_offers=False)
        if (unanswered := keeper.unanswered) is None:
            return Standing(self.waits)
        is_over = keeper.ran_out
        reason = f"the API does not answer: {unanswered}"
        return Standing(reason, takes_offers=not is_over, api_away=is_over, cut_off=keeper.claim)
