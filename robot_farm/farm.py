"""Several robots on one machine: starts a process for each, starts those anew that die, ends all of them together."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable

from robot_farm.arena.places import held_names
from robot_farm.link.api_link import ApiUnreachableError, LeaseRefusedError, NotAdmittedError, own_token
from robot_farm.settings import NOT_TAKEN, TOKEN_VARIABLE, Settings
from sim_backend.driver.compilation import is_kept

LOOK_EVERY_S = 0.1
RESTART_PAUSE_S = (0.2, 1.0, 5.0, 15.0)
"""Pauses before a robot that died is started again; back to the first after a minute of good service."""
GOOD_SERVICE_S = 60.0
END_WITHIN_S = 3.5
WARM_UP_WITHIN_S = 60.0
JOIN_WITHIN_S = 5.0
JOIN_AGAIN_S = 1.0
REFUSED_AGAIN_S = 60.0
"""After the farm said no: a token of another kind does not become right, and one that is expected later has time."""


class _Place:
    """One robot's place on the machine, with or without a living process in it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.process: subprocess.Popen | None = None
        self.started_at_s = 0.0
        self.deaths = 0
        self.start_at_s = 0.0


def run_robots(settings: Settings, arguments: list[str], stop: threading.Event, say: Callable[[str], None]) -> None:
    """Keep ``settings.robots`` robots running until told to stop.

    Args:
        settings: how many robots and from which number.
        arguments: the command line each robot gets besides its name.
        stop: set from outside to end.
        say: takes a line for the log.
    """
    if settings.robots > 1 and not is_kept():
        _warm_up(stop, say)
    with held_names(settings) as names:
        places = [_Place(name) for name in names]
        try:
            while not stop.is_set():
                for place in places:
                    _look_after(place, settings, arguments, say)
                stop.wait(LOOK_EVERY_S)
        finally:
            _end([place.process for place in places if place.process is not None])


def _warm_up(stop: threading.Event, say: Callable[[str], None]) -> None:
    """Compile once before the robots start, which would otherwise all do so at the same time; that it fails is no obstacle."""
    say("compiling for the first time, about ten seconds")
    process = subprocess.Popen([sys.executable, "-P", "-m", "sim_backend.warm_up"], stderr=subprocess.DEVNULL)
    give_up_s = time.monotonic() + WARM_UP_WITHIN_S
    while process.poll() is None and not stop.wait(LOOK_EVERY_S) and time.monotonic() < give_up_s:
        pass
    _end([process])


def _look_after(place: _Place, settings: Settings, arguments: list[str], say: Callable[[str], None]) -> None:
    now_s = time.monotonic()
    if place.process is not None and place.process.poll() is not None:
        place.deaths = 1 if now_s - place.started_at_s > GOOD_SERVICE_S else place.deaths + 1
        pause_s = RESTART_PAUSE_S[min(place.deaths, len(RESTART_PAUSE_S)) - 1]
        if place.process.returncode == NOT_TAKEN and place.deaths > 1:  # once, its token may be one that the farm has forgotten
            pause_s = REFUSED_AGAIN_S
        again = f"it is started again in {pause_s:g} s"
        say(f"{place.name} (pid {place.process.pid}) ended with {_how(place.process.returncode)}; {again}")
        place.start_at_s = now_s + pause_s
        place.process = None
    if place.process is None and now_s >= place.start_at_s:
        # Asked for at each start, though it is always the same one: the farm may have forgotten it and makes it anew then.
        token = _own_token(place, settings, say)
        if token is None:
            return
        place.started_at_s = now_s
        # The farm's token, which can speak for every robot, stays here.
        environment = os.environ | {TOKEN_VARIABLE: token}
        command = [sys.executable, "-P", "-m", "robot_farm", "--robot", place.name, *arguments]
        place.process = subprocess.Popen(command, env=environment)


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


def _how(returncode: int) -> str:
    return f"signal {-returncode}" if returncode < 0 else f"exit code {returncode}"


def _end(processes: list[subprocess.Popen]) -> None:
    """Ask all to end, then insist."""
    for process in processes:
        process.terminate()
    give_up_s = time.monotonic() + END_WITHIN_S
    for process in processes:
        try:
            process.wait(timeout=max(0.0, give_up_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
