"""Several robots on one machine: has a process forked for each, starts those anew that die, ends all of them together."""

import signal
import time
from collections.abc import Callable

from robot_farm.arena.places import held_names
from robot_farm.forks import Forked, Forks, how
from robot_farm.link.api_link import ApiUnreachableError, LeaseRefusedError, NotAdmittedError, own_token
from robot_farm.process import Ending
from robot_farm.settings import NOT_TAKEN, Settings

LOOK_EVERY_S = 0.1
RESTART_PAUSE_S = (0.2, 1.0, 5.0, 15.0)
"""Pauses before a robot that died is started again; back to the first after a minute of good service."""
GOOD_SERVICE_S = 60.0
END_WITHIN_S = 3.5
END_LOOK_EVERY_S = 0.01
JOIN_WITHIN_S = 5.0
JOIN_AGAIN_S = 1.0
REFUSED_AGAIN_S = 60.0
"""After the farm said no: a token of another kind does not become right, and one that is expected later has time."""


class _Place:
    """One robot's place on the machine, with or without a living process in it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.process: Forked | None = None
        self.started_at_s = 0.0
        self.deaths = 0
        self.start_at_s = 0.0


def run_robots(settings: Settings, arguments: list[str], ending: Ending, say: Callable[[str], None]) -> None:
    """Keep ``settings.robots`` robots running until told to end.

    Args:
        settings: how many robots and from which number.
        arguments: the command line that each robot has besides its name.
        ending: begun from outside; robots are given its ``drain_s`` to finish their trials.
        say: takes a line for the log.
    """
    with held_names(settings) as names, Forks(arguments, say) as forks:
        places = [_Place(name) for name in names]
        try:
            while not ending.leaving.is_set():
                forks.look()
                for place in places:
                    _look_after(place, settings, forks.robot, say)
                ending.leaving.wait(LOOK_EVERY_S)
        finally:
            _end([place.process for place in places if place.process is not None], forks, ending)


def _look_after(place: _Place, settings: Settings, start: Callable[[str, str], Forked], say: Callable[[str], None]) -> None:
    now_s = time.monotonic()
    if place.process is not None and place.process.returncode is not None:
        place.deaths = 1 if now_s - place.started_at_s > GOOD_SERVICE_S else place.deaths + 1
        pause_s = RESTART_PAUSE_S[min(place.deaths, len(RESTART_PAUSE_S)) - 1]
        if place.process.returncode == NOT_TAKEN and place.deaths > 1:  # once, its token may be one that the farm has forgotten
            pause_s = REFUSED_AGAIN_S
        say(f"{place.name} {_ended(place.process)}; it is started again in {pause_s:g} s")
        place.start_at_s = now_s + pause_s
        place.process = None
    if place.process is None and now_s >= place.start_at_s:
        # Asked for at each start, though it is always the same one: the farm may have forgotten it and makes it anew then.
        token = _own_token(place, settings, say)
        if token is None:
            return
        place.started_at_s = now_s
        place.process = start(place.name, token)


def _ended(process: Forked) -> str:
    if process.pid is None:
        return "could not be forked"
    return f"(pid {process.pid}) ended with {how(process.returncode or 0)}"


def _own_token(place: _Place, settings: Settings, say: Callable[[str], None]) -> str | None:
    """The robot's token, or None and a later start: soon where nobody answered, rarely where somebody said no."""
    try:
        return own_token(settings.api, settings.token, place.name, ca=settings.ca, timeout_s=JOIN_WITHIN_S)
    except NotAdmittedError as error:
        say(f"{place.name} is not let into the farm, and asks again every {REFUSED_AGAIN_S:g} s: {error}")
        place.start_at_s = time.monotonic() + REFUSED_AGAIN_S
    except (ApiUnreachableError, LeaseRefusedError, RuntimeError) as error:
        say(f"{place.name} cannot join the farm yet: {error}")
        place.start_at_s = time.monotonic() + JOIN_AGAIN_S
    return None


def _end(robots: list[Forked], forks: Forks, ending: Ending) -> None:
    """Ask all to end, ask those again that finish something when that must end, too, then insist."""
    patience_s = ending.drain_s if not ending.stop.is_set() else 0.0
    for wait_s, is_over in ((patience_s, ending.stop.is_set), (END_WITHIN_S, lambda: False)):
        for robot in robots:
            robot.end(signal.SIGTERM)
        give_up_s = time.monotonic() + wait_s
        while _alive(robots, forks) and time.monotonic() < give_up_s and not is_over():
            time.sleep(END_LOOK_EVERY_S)
    for robot in robots:
        robot.end(signal.SIGKILL)
    while _alive(robots, forks):
        time.sleep(END_LOOK_EVERY_S)


def _alive(robots: list[Forked], forks: Forks) -> bool:
    forks.look()
    return any(robot.returncode is None for robot in robots)
