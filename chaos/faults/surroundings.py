"""What surrounds the farm fails: the disk is full, the bus is cut or loses packets, speaks nonsense, or the clock jumps."""

import os
import time
from contextlib import suppress
from pathlib import Path

import zenoh

from api_schemas import bus
from chaos.farm import HOST
from chaos.faults.fault import Fault, Scene, needs_isolation, now_s
from chaos.history import Line
from chaos.processes import DidNotHappen

FAKETIME = "faketime/libfaketimeMT.so.1"
HOUR_S = 3600
TAKEN_WITHIN_S = 90
BALLAST_BYTES = 1 << 20


def full_disk(scene: Scene) -> str:
    """The disk of database, files, robots and everybody's words has no byte left for a while."""
    farm, since_s = scene.farm, now_s()
    ballast = farm.disk / "ballast"
    named: list[str] = []
    fill(ballast)
    try:
        ends_s = now_s() + scene.lasting(30, 8)
        while now_s() < ends_s:
            fill(ballast)
            time.sleep(0.5)
            named += [said for said in (farm.ask("GET", "/v1/status") or {"problems": []})["problems"] if "disk" in said]
    finally:
        ballast.unlink()
    freed_s = now_s()
    refused = [line for line in scene.lines_since(since_s) if line.did == "refused" and line.more["status"] in {500, 503, 507}]
    ended = farm.start_the_ended()
    scene.whole_again()
    scene.wait_for_line(freed_s, lambda line: line.did == "took", 60, "an outcome to be taken again")
    resumed = [line.more["because"] or "" for line in scene.lines_since(since_s) if line.did == "resumed"]
    blamed = [because for because in resumed if "disk" not in because]
    _check_full(refused, [name for name in ended if name in (*farm.services, *farm.robots, "router")], blamed, named)
    problems = sorted({f"{line.more['status']} {line.more['problem']}" for line in refused})
    again = f" once {', '.join(ended)} had been started again" if ended else " by itself"
    return f"{len(refused)} requests answered {', '.join(problems)}; status: {named[0]}; freed, work went on{again}"


def _check_full(refused: list[Line], ended: list[str], blamed: list[str], named: list[str]) -> None:
    if not refused:
        raise DidNotHappen("a request that was refused for the full disk")
    if ended:
        raise DidNotHappen(f"{', '.join(ended)} to outlive a full disk")
    if blamed:
        raise DidNotHappen(f"that no robot is blamed for a full disk ({blamed[0]})")
    if not named:
        raise DidNotHappen("a status that names the full disk")


def fill(ballast: Path) -> None:
    """Takes every byte that is left on the disk of the file."""
    with ballast.open("ab", buffering=0) as file, suppress(OSError):
        for size in (BALLAST_BYTES, 4096, 1):
            with suppress(OSError):
                while True:
                    file.write(bytes(size))


def cut_bus(scene: Scene) -> str:
    """The wire between bus and robots is cut for a while; HTTP has another one."""
    return _lose(scene, 1.0, scene.lasting(60, 6))


def lossy_bus(scene: Scene) -> str:
    """The wire between bus and robots loses 30 % of its packets."""
    return _lose(scene, 0.3, scene.lasting(60, 8))


def _lose(scene: Scene, share: float, for_s: float) -> str:
    assert scene.farm.wire is not None
    since_s, done = now_s(), scene.clients.acknowledged
    scene.farm.wire.lose(share)
    try:
        time.sleep(for_s)
        lost = scene.farm.settings.robots - scene.farm.in_service()
        took = sum(line.did == "took" for line in scene.lines_since(since_s))
    finally:
        scene.farm.wire.lose(0.0)
    back_s = scene.farm.ready_robots()
    if share == 1.0 and for_s > 5 and lost == 0:
        raise DidNotHappen("a robot to be seen as lost while the bus was cut")
    more = f"outcomes taken {took}, jobs taken {scene.clients.acknowledged - done}"
    return f"{share:.0%} lost for {for_s:g} s: {lost} robots out of sight, {more}; all back after {back_s:.1f} s"


def nonsense_on_bus(scene: Scene) -> str:
    """Messages that are none, on the keys of heartbeats, offers and commands."""
    farm = scene.farm
    config = bus.session_config_json(mode="client", connect=[f"tcp/{HOST}:{farm.bus_port}"])
    sent = 0
    with zenoh.open(zenoh.Config.from_json5(config)) as session:
        for robot in farm.robots:
            for message in (b"", b"{}", b"\xff\xfe", b'{"robot":"other"}', os.urandom(2000)):
                session.put(bus.heartbeat_key("farm", robot), message)
                for key in (bus.offer_key("farm", robot), bus.command_key("farm", robot)):
                    list(session.get(key, payload=message, timeout=1.0))
                sent += 3
    dead = [name for name in (*farm.services, *farm.robots) if not farm.processes[name].is_alive()]
    if dead:
        raise DidNotHappen(f"{', '.join(dead)} to outlive nonsense")
    return f"{sent} messages, nobody ended by them"


def jumping_clock(scene: Scene) -> str:
    """The clock of the services' processes jumps by an hour forward, by two back, and is right again.

    An S3 server takes nothing that was signed by a clock an hour off, so that on that home work goes on when it is right again.
    """
    farm, library = scene.farm, find_faketime()
    assert library is not None
    offset = farm.evidence / "clock"
    offset.write_text("+0\n")
    fake = {
        "LD_PRELOAD": library,
        "FAKETIME_TIMESTAMP_FILE": str(offset),
        "FAKETIME_CACHE_DURATION": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    _start_anew(scene, fake)
    ended: list[str] = []
    took = 0
    try:
        for seconds in (HOUR_S, -HOUR_S, 0):
            since_s = now_s()
            offset.write_text(f"{seconds:+d}\n")
            time.sleep(scene.lasting(30, 2.0 + farm.settings.lease_s))
            if farm.home is None or seconds == 0:
                what = f"an outcome to be taken under a clock that jumped to {seconds:+d} s"
                scene.wait_for_line(since_s, lambda line: line.did == "took", TAKEN_WITHIN_S, what)
            lines = scene.lines_since(since_s)
            ended += [line.more["because"] for line in lines if line.did == "ended" and "without renewal" in line.more["because"]]
            took += sum(line.did == "took" for line in lines)
    finally:
        _start_anew(scene, {})
    return f"±{HOUR_S} s; outcomes taken meanwhile {took}, leases that ended for it {len(ended)}"


def _start_anew(scene: Scene, more: dict[str, str]) -> None:
    for name in scene.farm.services:
        scene.farm.processes[name].kill()
        scene.farm.restart(name, **more)


def find_faketime() -> str | None:
    """Where libfaketime is; None where it is not installed."""
    given = os.environ.get("TRIFARM_CHAOS_FAKETIME")
    found = [Path(given)] if given else sorted(Path("/usr/lib").glob(f"*/{FAKETIME}")) + sorted(Path("/usr/lib").glob(FAKETIME))
    return str(found[0]) if found else None


def _needs_faketime(_scene: Scene) -> str | None:
    return None if find_faketime() else "libfaketime is not installed (Debian: faketime)"


SURROUNDINGS = (
    Fault("full-disk", "the disk of database, files, robots and logs is full", full_disk, needs_isolation),
    Fault("cut-bus", "the bus between services and robots is cut", cut_bus, needs_isolation),
    Fault("lossy-bus", "the bus between services and robots loses 30 % of its packets", lossy_bus, needs_isolation),
    Fault("nonsense-on-bus", "messages on the bus that are none", nonsense_on_bus),
    Fault("jumping-clock", "the services' clock jumps by an hour, forward and back", jumping_clock, _needs_faketime),
)
