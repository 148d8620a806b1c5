"""What is done to a farm at work: every kind of fault once, or one kind many times."""

import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import httpx
import structlog

from chaos.clients import Load
from chaos.farm import FarmSettings
from chaos.faults.fault import Fault, Injection, Scene, now_s
from chaos.faults.kills import KILLS, SERVERS, Ready, kill
from chaos.faults.leases import LEASES, pause
from chaos.faults.requests import REQUESTS
from chaos.faults.surroundings import SURROUNDINGS
from chaos.homes import SCALE
from chaos.processes import DidNotHappen

log = structlog.get_logger()
MATRIX: tuple[Fault, ...] = (*KILLS, *SERVERS, *LEASES, *REQUESTS, *SURROUNDINGS)
PAUSE_AT_ONCE = 20
NO_END = 10**6


@dataclass(frozen=True)
class Campaign:
    """One way to break a farm: what it and its clients are, what is done to it, and how many jobs it takes at least."""

    farm: FarmSettings
    load: Load
    harm: Callable[[Scene], Iterator[Injection]]
    at_least: int = 0
    only_home: str | None = None
    """Where alone it can be done: elsewhere there is nothing of the kind that it breaks."""


def campaign(name: str, seed: int, *, quick: bool) -> Campaign:
    """The campaign of this name."""
    farm = FarmSettings()
    match name:
        case "matrix":
            load = Load(clients=10, jobs=NO_END, pace_s=3.0, seed=seed)
            return Campaign(farm, load, every_fault, at_least=220 if quick else 600)
        case "kills":
            load = Load(clients=50, jobs=200 if quick else 2000, pace_s=3.0, seed=seed, without_key=0.0, only_single=True)
            return Campaign(farm, load, kill_at_random)
        case "pauses":
            farm = replace(farm, robots=PAUSE_AT_ONCE + 4, lease_s=1.0, trial_s=0.1)
            load = Load(clients=20, jobs=NO_END, pace_s=1.5, seed=seed, without_key=0.0)
            return Campaign(farm, load, lambda scene: pause_many(scene, 40 if quick else 1000))
        case "outages":
            return Campaign(
                farm,
                Load(clients=10, jobs=NO_END, pace_s=1.0, seed=seed),
                lambda scene: restart_database_often(scene, 60 if quick else 600),
                only_home=SCALE,
            )
        case _:
            raise ValueError(f"there is no campaign {name!r}; choose from matrix, kills, pauses, outages")


def every_fault(scene: Scene) -> Iterator[Injection]:
    """Every kind of fault once, in an order drawn from the seed."""
    for fault in scene.rng.sample(MATRIX, len(MATRIX)):
        if (why := fault.missing(scene)) is not None:
            yield Injection(fault.name, 0, verified=False, skipped_because=why)
            continue
        yield inject(fault, scene)
        if scene.farm.in_service() < scene.farm.settings.robots:
            log.error("the farm is not whole again; no more faults")
            return


def inject(fault: Fault, scene: Scene) -> Injection:
    """One fault, and the farm whole again after it."""
    scene.farm.history("fault", fault=fault.name)
    began_s = now_s()
    try:
        seen, verified = fault.inject(scene), True
    except (DidNotHappen, httpx.TransportError) as error:
        seen, verified = str(error) or type(error).__name__, False
    if ended := scene.farm.start_the_ended():
        seen += f"; ended by themselves and were started again: {', '.join(ended)}"
    try:
        scene.whole_again()
    except DidNotHappen as error:
        seen, verified = f"{seen}; the farm was not whole again: {error}", False
    log.info("fault", fault=fault.name, verified=verified, seen=seen, took_s=round(now_s() - began_s, 1))
    return Injection(fault.name, 1, verified, seen)


def kill_at_random(scene: Scene) -> Iterator[Injection]:
    """Kills a process of any kind every few seconds until all jobs are submitted.

    A farm that took long to be ready, on a machine with much else to do, is let work for longer before the next.
    """
    farm = scene.farm
    kinds = {
        "kill-api": farm.services[:1],
        "kill-dispatcher": farm.services[1:],
        "kill-router": ["router"],
        "kill-robot": farm.robots,
    }
    kinds = {kind: names for kind, names in kinds.items() if names}
    ready: dict[str, list[Ready]] = {kind: [] for kind in kinds}
    away_s = 0.0
    while not scene.clients.all_submitted():
        time.sleep(scene.rng.uniform(0.5, 3.0) + away_s)
        kind = scene.rng.choice(list(kinds))
        ready[kind].append(kill(scene, scene.rng.choice(kinds[kind])))
        away_s = ready[kind][-1].after_s if kind == "kill-api" else 0.0
        log.info("killed", kind=kind, ready_s=round(ready[kind][-1].after_s, 1), acknowledged=scene.clients.acknowledged)
    for kind, times in ready.items():
        seen = f"{_spread([each.after_s for each in times])}; of its own CPU time {_spread([each.cpu_s for each in times])}"
        yield Injection(kind, len(times), verified=bool(times), seen=seen)


def pause_many(scene: Scene, pauses: int) -> Iterator[Injection]:
    """Pauses robots past their leases, twenty at a time, until so many pauses were made."""
    made, since_s = 0, now_s()
    while made < pauses:
        names = scene.rng.sample(scene.farm.robots, PAUSE_AT_ONCE)
        time.sleep(scene.rng.uniform(0.3, 1.0))
        pause(scene, names, 1.7 * scene.farm.settings.lease_s)
        made += len(names)
        log.info("paused", made=made, in_service=scene.farm.in_service())
    lines = scene.lines_since(since_s)
    ended = sum(line.did == "ended" for line in lines)
    refused = sum(line.did == "refused" and line.more["problem"] == "stale-fence" for line in lines)
    yield Injection("pause-robots", made, verified=ended > 0, seen=f"leases ended {ended}, stale requests refused {refused}")


def restart_database_often(scene: Scene, for_s: float) -> Iterator[Injection]:
    """Restarts PostgreSQL as by a crash every 5 to 40 s, and lets it be away for a while at the end."""
    if scene.farm.home is None:
        yield Injection(
            "database-restarts", 0, verified=False, skipped_because="this home has no database server; --home scale has"
        )
        return
    up_s: list[float] = []
    ends_s = now_s() + for_s
    while now_s() < ends_s:
        time.sleep(scene.rng.uniform(5, 40) if for_s > 100 else scene.rng.uniform(2, 8))
        scene.farm.home.stop_database()
        scene.farm.home.start_database()
        up_s.append(scene.farm.ready_api())
        log.info("database restarted", times=len(up_s), api_ready_s=round(up_s[-1], 2))
    yield Injection("database-restarts", len(up_s), verified=True, seen=f"API ready after the database: {_spread(up_s)}")
    yield inject(next(fault for fault in SERVERS if fault.name == "database-gone"), scene)


def _spread(seconds: list[float]) -> str:
    if not seconds:
        return "none"
    middle = sorted(seconds)[len(seconds) // 2]
    return f"{middle:.1f} s in the middle, {max(seconds):.1f} s at most"


def drawn(seed: int) -> random.Random:
    """What chooses whom a fault hits."""
    return random.Random(f"faults-{seed}")
