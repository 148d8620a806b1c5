"""kill -9: at random moments, and between two steps that belong together."""

from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from chaos.faults.fault import Fault, Scene, needs_servers, now_s
from chaos.history import Line
from chaos.processes import DidNotHappen, until

TRIES, ENDS_WITHIN_S = 12, 3.0
"""A robot is shown in service before the process that gives leases has ended what its last process held."""


@dataclass(frozen=True)
class Ready:
    """After how long a process was ready again, and how much of a core it took until then.

    The second says what the first would be on a machine that has nothing else to do.
    """

    after_s: float
    cpu_s: float

    def __str__(self) -> str:
        return f"{self.after_s:.1f} s ({self.cpu_s:.1f} s of CPU time)"


def kill(scene: Scene, name: str) -> Ready:
    """Kills a process and starts it again."""
    farm = scene.farm
    farm.processes[name].kill()
    farm.history("killed", process=name)
    ready = Ready(farm.restart(name), farm.processes[name].cpu_s())
    farm.history("ready", process=name, ready_s=ready.after_s, cpu_s=ready.cpu_s)
    return ready


def kill_api(scene: Scene) -> str:
    """The process that answers requests; embedded it gives the leases, too."""
    return f"ready again after {kill(scene, scene.farm.services[0])}"


def kill_dispatcher(scene: Scene) -> str:
    """One of the processes that give leases."""
    name = scene.rng.choice(scene.farm.services[1:])
    return f"{name} ready again after {kill(scene, name)}"


def kill_router(scene: Scene) -> str:
    """The bus."""
    ready = kill(scene, "router")
    scene.whole_again()
    return f"robots in service again after {ready}"


def kill_robot(scene: Scene) -> str:
    """A robot, whatever it does."""
    name = scene.rng.choice(scene.farm.robots)
    return f"{name} in service again after {kill(scene, name)}"


def restart_with_trial(scene: Scene) -> str:
    """A robot in the middle of a trial; another process takes its name at once, before the lease ends."""
    for _ in range(TRIES):
        name, since_s = scene.rng.choice(scene.farm.robots), now_s()
        scene.wait_for_line(since_s, lambda line, name=name: line.who == name and line.did == "acted", 30, f"{name} to act")
        kill(scene, name)
        with suppress(DidNotHappen):  # it was between two trials
            ended = scene.wait_for_line(since_s, partial(_ended_of, name), ENDS_WITHIN_S, "the end of a lease")
            return f"{name} came back while its last process's lease lived; {ended.more['because']}"
    raise DidNotHappen(f"in {TRIES} kills no robot held a lease")


def _ended_of(robot: str, line: Line) -> bool:
    return line.did == "ended" and line.more["robot"] == robot


def die_at(scene: Scene, place: str) -> str:
    """Has the next process that comes to the place die there."""
    farm, since_s = scene.farm, now_s()
    farm.orders.give(f"die-{place}")
    try:
        until(lambda: not farm.orders.stands(f"die-{place}"), 60, f"a process to come to '{place}'")
    finally:
        farm.orders.take(f"die-{place}")
    until(lambda: any(not farm.processes[name].is_alive() for name in farm.services), 60, f"a death at '{place}'")
    dead = [name for name in farm.services if not farm.processes[name].is_alive()]
    farm.history("killed", process=dead[0], place=place)
    ready_s = farm.restart(dead[0])
    return f"{dead[0]} died there, ready again after {ready_s:.1f} s ({now_s() - since_s:.1f} s in all)"


KILLS = (
    Fault("kill-api", "kill -9 of the process that answers requests", kill_api),
    Fault(
        "kill-dispatcher",
        "kill -9 of a process that gives leases",
        kill_dispatcher,
        lambda scene: (
            None if len(scene.farm.services) > 1 else "here the process of the API gives the leases; kill-api kills both"
        ),
    ),
    Fault("kill-router", "kill -9 of the bus", kill_router),
    Fault("kill-robot", "kill -9 of a robot at a random moment", kill_robot),
    Fault("robot-restarts", "kill -9 of a robot in a trial; its name is taken again before the lease ends", restart_with_trial),
    Fault("die-before-offer", "kill -9 between writing a lease and offering it", lambda scene: die_at(scene, "before-offer")),
    Fault("die-before-answer", "kill -9 between writing a job and answering", lambda scene: die_at(scene, "before-answer")),
    Fault("die-before-row", "kill -9 between storing a log and naming it in a row", lambda scene: die_at(scene, "before-row")),
)


def _restart_database(scene: Scene) -> str:
    assert scene.farm.home is not None
    scene.farm.home.stop_database()
    took_s = scene.farm.home.start_database()
    return f"answered again after {took_s:.1f} s"


def _database_gone(scene: Scene) -> str:
    assert scene.farm.home is not None
    since_s, gone_s = now_s(), scene.lasting(60, 6)
    scene.farm.home.stop_database()
    until(lambda: now_s() - since_s > gone_s, gone_s + 5, "the time to pass")
    scene.farm.home.start_database()
    refused = [line for line in scene.lines_since(since_s) if line.did == "refused" and line.more["status"] == 503]
    if not refused:
        raise DidNotHappen("a client that was told with 503 that the database is away")
    return f"gone for {gone_s:g} s; {len(refused)} requests answered 503 ({refused[0].more['problem']})"


def _files_gone(scene: Scene) -> str:
    assert scene.farm.home is not None
    since_s, gone_s = now_s(), scene.lasting(60, 5)
    scene.farm.home.files.kill()
    until(lambda: now_s() - since_s > gone_s, gone_s + 5, "the time to pass")
    scene.farm.home.files.start()
    return f"gone for {gone_s:g} s"


SERVERS = (
    Fault("database-restarts", "PostgreSQL is stopped as by a crash and started again", _restart_database, needs_servers),
    Fault("database-gone", "PostgreSQL is away for a while", _database_gone, needs_servers),
    Fault("files-gone", "the S3 server is away for a while", _files_gone, needs_servers),
)
