"""``python -m chaos run``: starts a farm, lets clients work, does harm, waits until all is over, and lets the checker judge."""

import argparse
import asyncio
import json
import logging
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import structlog

from chaos import campaigns, isolation
from chaos.clients import Clients, clients
from chaos.farm import HOST, Farm
from chaos.faults.fault import Injection, Scene
from chaos.gathering import gather
from chaos.homes import EMBEDDED, SCALE, HomeMissing
from chaos.isolation import Isolation
from chaos.processes import DidNotHappen, process_group, until
from chaos.promises import Verdict, check
from chaos.robot import expected_success
from chaos.wire import wire

log = structlog.get_logger()
DISK_BYTES = {EMBEDDED: 256 << 20, SCALE: 768 << 20}
QUICK_DISK_BYTES = {EMBEDDED: 60 << 20, SCALE: 384 << 20}
"""Of a run with few jobs: database, files, robots and logs on a disk that is full soon. PostgreSQL and the logs that it keeps
for a crash take 130 MB of the second before anything is in it."""
REST_WITHIN_S = 300.0
SENTENCES = 20
"""Of each broken promise, as many are shown."""


@dataclass(frozen=True)
class About:
    """What a run was; ``rested`` says that all jobs were over before it was judged, ``load_1min`` is the machine's."""

    home: str
    campaign: str
    seed: int
    quick: bool
    isolated: bool
    rested: bool
    cores: int | None
    load_1min: float
    took_s: float


class CannotBreak(RuntimeError):
    """The farm would keep its promises for want of what was to be broken."""


def main(arguments: list[str]) -> int:
    """Writes one JSON document; code 1 when a promise was broken, 2 when the run could not be made."""
    parser = argparse.ArgumentParser(prog="python -m chaos run")
    parser.add_argument("--home", choices=(EMBEDDED, SCALE), default=EMBEDDED)
    parser.add_argument("--campaign", choices=("matrix", "kills", "pauses", "outages"), default="matrix")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="a folder in which the histories are kept")
    parser.add_argument("--out", type=Path, required=True, help="file for the document of the run")
    given = parser.parse_args(arguments)
    isolated = isolation.enter(arguments)
    _log_to_stderr()
    try:
        said = run(given.campaign, given.home, given.seed, isolated, quick=given.quick, keep=given.keep)
    except (CannotBreak, DidNotHappen, HomeMissing) as error:
        given.out.write_text(json.dumps({"error": str(error)}))
        return 2
    given.out.write_text(json.dumps(said))
    return 0 if said["held"] else 1


def run(name: str, home: str, seed: int, isolated: Isolation, *, quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """One campaign against one farm; gives the document of the run.

    Raises:
        CannotBreak: such a home has nothing that the campaign breaks.
    """
    began_s, planned = time.monotonic(), campaigns.campaign(name, seed, quick=quick)
    if planned.only_home not in (None, home):
        raise CannotBreak(f"the campaign {name} needs a home that 'embedded' has not: add --home {planned.only_home}")
    with ExitStack() as stack:
        processes = stack.enter_context(process_group())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="trifarm-chaos-", ignore_cleanup_errors=True)))
        disk, evidence = folder / "disk", keep or folder / "evidence"
        for each in (disk, evidence):
            each.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o755)  # the database's user has to come through
        between = None
        if isolated.there:
            isolation.mount_small_disk(disk, (QUICK_DISK_BYTES if quick else DISK_BYTES)[home])
            between = stack.enter_context(wire(folder, processes, seed))
        farm = Farm(replace(planned.farm, home=home), disk, evidence, processes, between)
        stack.callback(farm.close)
        farm.start()
        log.info("farm ready", home=home, isolated=isolated.there, why_not=isolated.why_not)
        with clients(planned.load, farm.tokens, farm.policy, evidence, HOST, farm.port) as at_work:
            scene = Scene(farm, at_work, campaigns.drawn(seed), isolated, quick)
            injections = list(planned.harm(scene))
            until(lambda: at_work.taken() >= planned.at_least, REST_WITHIN_S, f"the taking of {planned.at_least} jobs")
            at_work.submit_no_more()
            rested = _rest(at_work)
        verdict = check(asyncio.run(gather(farm, folder)), expected_success)
    took_s, load = round(time.monotonic() - began_s, 1), round(os.getloadavg()[0], 1)
    return document(verdict, injections, About(home, name, seed, quick, isolated.there, rested, os.cpu_count(), load, took_s))


def _rest(at_work: Clients) -> bool:
    """Waits until all jobs are over, as long as any ends; the checker says what is wrong with those that do not."""
    try:
        while not at_work.all_over():
            left = at_work.unfinished
            until(lambda: at_work.all_over() or at_work.unfinished < left, REST_WITHIN_S, "the end of a job", every_s=0.2)  # noqa: B023
    except DidNotHappen as error:
        log.warning("not at rest", reason=str(error), unfinished=at_work.unfinished)
        return False
    return True


def document(verdict: Verdict, injections: list[Injection], about: About) -> dict[str, Any]:
    """What a run prints."""
    counts = {name: len(found) for name, found in verdict.broken.items()}
    return {
        **counts,
        "acknowledged": verdict.acknowledged,
        "trials_done": verdict.trials_done,
        "faults_injected": sum(each.injected for each in injections),
        "held": verdict.held,
        "failed_jobs": verdict.failed_jobs,
        "stale_refused": verdict.stale_refused,
        "stale_accepted": verdict.stale_accepted,
        "faults": [asdict(each) for each in injections],
        "broken": {name: list(found[:SENTENCES]) for name, found in verdict.broken.items() if found},
        **asdict(about),
    }


def _log_to_stderr() -> None:
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
    structlog.configure(
        processors=[structlog.processors.TimeStamper(fmt="%H:%M:%S", utc=True), structlog.dev.ConsoleRenderer(colors=False)],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )
