"""Leases that end while somebody still works: stopped robots, stopped services, late and repeated outcomes."""

import signal
import time
from collections import Counter

from chaos.faults.fault import Fault, Scene, now_s
from chaos.history import Line
from chaos.processes import DidNotHappen, until

PAST_LEASE = 1.7
TRIES = 6


def pause(scene: Scene, names: list[str], for_s: float) -> float:
    """SIGSTOP and, after a while, SIGCONT; gives the moment of SIGSTOP."""
    since_s = now_s()
    for name in names:
        scene.farm.processes[name].send(signal.SIGSTOP)
        scene.farm.history("paused", process=name)
    try:
        time.sleep(for_s)
    finally:
        for name in names:
            scene.farm.processes[name].send(signal.SIGCONT)
            scene.farm.history("continued", process=name)
    return since_s


def pause_robots(scene: Scene) -> str:
    """Half of the robots, past the end of their leases."""
    farm = scene.farm
    for _ in range(TRIES):
        names = scene.rng.sample(farm.robots, max(1, len(farm.robots) // 2))
        since_s = pause(scene, names, PAST_LEASE * farm.settings.lease_s)
        ended = [line for line in scene.lines_since(since_s) if line.did == "ended" and line.more["robot"] in names]
        if ended:
            return f"{len(names)} paused, {len(ended)} leases ended meanwhile"
    raise DidNotHappen(f"in {TRIES} pauses no lease ended")


def pause_services(scene: Scene) -> str:
    """All processes that answer requests and give leases, longer than a lease lasts."""
    for_s = PAST_LEASE * scene.farm.settings.lease_s
    since_s = pause(scene, scene.farm.services, for_s)
    return f"paused for {now_s() - since_s:.1f} s"


def late_outcome(scene: Scene) -> str:
    """A robot brings its outcome long after its lease ended and another has the trial."""
    name, since_s = scene.rng.choice(scene.farm.robots), now_s()
    scene.farm.orders.give("late", name)
    late = scene.wait_for_line(since_s, lambda line: line.who == name and line.did == "late", 60, f"{name} to be late")
    trial_id, fence = late.more["trial"], late.more["fence"]

    def is_end(line: Line) -> bool:
        about = (line.more.get("of_trial"), line.more.get("trial"))
        return line.who == name and line.did in {"refused", "answered"} and trial_id in about

    end = scene.wait_for_line(late.at_s, is_end, 60, "an answer to the late outcome")
    if end.did == "refused" and end.more["status"] == 409:
        return f"attempt {fence} of trial {trial_id} was refused: {end.more['problem']}"
    raise DidNotHappen(f"a refusal of the late outcome; it was {end.did}: {end.more}")


def repeated_outcome(scene: Scene) -> str:
    """A robot brings the same outcome three times."""
    name, since_s = scene.rng.choice(scene.farm.robots), now_s()
    scene.farm.orders.give("thrice", name)
    until(lambda: not scene.farm.orders.stands("thrice", name), 60, f"an outcome of {name}")

    def seen() -> bool:
        answered = [line.more for line in scene.lines_since(since_s) if line.who == name and line.did == "answered"]
        return 3 in Counter((more["trial"], more["fence"]) for more in answered).values()

    until(seen, 30, f"three answers to one outcome of {name}", every_s=0.3)
    return f"{name} was answered three times that its outcome was taken"


LEASES = (
    Fault("pause-robots", "SIGSTOP of robots past their leases, then SIGCONT", pause_robots),
    Fault("pause-services", "SIGSTOP of all services for longer than a lease, then SIGCONT", pause_services),
    Fault("late-outcome", "an outcome is brought under a fence that is no longer the newest", late_outcome),
    Fault("repeated-outcome", "an outcome is brought three times", repeated_outcome),
)
