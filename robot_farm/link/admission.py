"""How a robot comes into the farm and stays: it asks until the API answers, and for a new certificate in good time."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import zenoh

from robot_farm.link.api_link import ApiUnreachableError, NotExpectedError
from robot_farm.link.bus_access import Access, clock_s
from robot_farm.link.bus_link import BusLink

JOIN_AGAIN_S = 1.0
NOT_EXPECTED_AGAIN_S = 60.0
RENEW_AGAIN_S = 10.0
T = TypeVar("T")


def asked_until_answered(ask: Callable[[], T], stop: threading.Event, say: Callable[[str], None]) -> T | None:
    """What the API answers; None when the robot was told to stop before it did.

    A robot that is not expected waits until it is: one that ended would be started again at once, for ever.

    Raises:
        NotAdmittedError: the farm does not take the robot.
    """
    while not stop.is_set():
        try:
            return ask()
        except ApiUnreachableError as error:
            say(f"cannot join the farm yet: {error}")
            stop.wait(JOIN_AGAIN_S)
        except NotExpectedError as error:
            say(f"waits and asks again every {NOT_EXPECTED_AGAIN_S:g} s: {error}")
            stop.wait(NOT_EXPECTED_AGAIN_S)
    return None


def renewed(access: Access, ask: Callable[[], Access], bus: BusLink, say: Callable[[str], None]) -> Access:
    """What the robot is on the bus with from now on: the same, or, when it is time, what ``ask`` gives.

    What cannot be had now is asked for again soon.

    Raises:
        NotAdmittedError: the farm does not take the robot any more.
    """
    now_s = clock_s()
    if not access.is_due(now_s):
        return access
    try:
        new = ask()
        bus.renew(new)
    except (ApiUnreachableError, zenoh.ZError) as error:
        say(f"no new certificate for the bus yet: {error}")
        return replace(access, renew_at_s=now_s + RENEW_AGAIN_S)
    say("has a new certificate for the bus")
    return new
