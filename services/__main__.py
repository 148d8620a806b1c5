"""``python -m services serve|dispatch|router|bus-key``: starts the services of a farm, or a part of them, in this process."""

import argparse
import asyncio
import ctypes
import logging
import os
import resource
import signal
import sys
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

import structlog
from pydantic import ValidationError

from api_schemas.environment import unknown_settings
from jail.level import JailLevel
from services.settings import AUDIT, Settings
from trial_logs.disk import lose_words_rather_than_end, words_into
from trial_logs.loading import everything_stays

PRIVATE = 0o077
PR_SET_PDEATHSIG = 1
"""Linux prctl(2): the signal to get when the parent ends."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, THRESHOLD_BYTES = -1, -3, 128 * 1024
"""Of glibc's mallopt(3), and the value that both begin with."""


def parsed(arguments: list[str]) -> tuple[str, Settings]:
    """The command and its settings: flags win over TRIFARM_* variables, which win over defaults."""
    parser = argparse.ArgumentParser(prog="python -m services", description="The services of a trifarm.")
    commands = parser.add_subparsers(dest="command", required=True)
    serve = commands.add_parser("serve", help="API, dispatcher and, without --bus-connect, the bus")
    dispatcher = commands.add_parser("dispatch", help="a dispatcher alone, beside others that share a PostgreSQL database")
    for each in (serve, dispatcher):
        each.add_argument("--data", type=Path, help="folder of database, files and tokens, as far as they have no other home")
        each.add_argument(
            "--bus-connect", help="zenoh endpoint of a router that runs elsewhere, or several by commas; then none runs here"
        )
        each.add_argument("--farm", help="the farm's name on the bus")
    dispatcher.add_argument("--metrics-port", type=int, help="answer /metrics there, on --host; usual: nowhere")
    for each in (serve, dispatcher):
        each.add_argument("--host")
    serve.add_argument("--port", type=int)
    serve.add_argument("--bus", help="zenoh endpoint to listen on, as tcp/127.0.0.1:7447")
    serve.add_argument("--physics", help="what the robots were told; shown in the status")
    levels = [level.value for level in JailLevel]
    serve.add_argument("--jail-level", choices=levels, help="take nothing where the jail of children does not reach this level")
    no_dispatch = "answer requests and give no leases; 'dispatch' does that elsewhere"
    serve.add_argument("--no-dispatch", dest="dispatches", action="store_const", const=False, help=no_dispatch)
    router = commands.add_parser("router", help="the bus alone")
    router.add_argument("--bus", help="zenoh endpoint to listen on, as tcp/0.0.0.0:7447 or, guarded, tls/0.0.0.0:7447")
    router.add_argument("--bus-routers", help="the routers of the same bus, by commas; this one may be among them")
    router.add_argument("--farm", help="the farm's name on the bus, which the rules of a guarded one name")
    bus_key = commands.add_parser("bus-key", help="print what a guarded router needs of the farm's key, its TRIFARM_BUS_KEY")
    bus_key.add_argument("--data", type=Path, help="folder with the farm's key, where TRIFARM_FARM_KEY is not set")
    given = {name: value for name, value in vars(parser.parse_args(arguments)).items() if value is not None}
    command = given.pop("command")
    if command == "bus-key":  # it goes on no bus, whatever this shell says of one
        given |= {"bus_connect": None, "bus_addresses": None}
    try:
        return command, Settings(**given)
    except ValidationError as error:
        parser.error(_wrong(error))


def _wrong(error: ValidationError) -> str:
    """What cannot be used, by the names of the variables; their values may be secret."""
    found = []
    for each in error.errors(include_url=False, include_context=False, include_input=False):
        name = "_".join(str(part) for part in each["loc"])
        said = each["msg"].removeprefix("Value error, ")
        found.append(f"TRIFARM_{name.upper()}: {said[:1].lower()}{said[1:]}" if name else said)
    return "; ".join(found)


def main() -> None:
    """Runs until told to stop."""
    command, settings = parsed(sys.argv[1:])
    lose_words_rather_than_end()
    os.umask(PRIVATE)  # database, policies, logs and the truth are for this user alone
    _end_with_parent()
    return_freed_memory()
    open_as_many_files_as_allowed()
    from services.errors import NotReady

    try:
        _log(settings.audit_file)
        for said in unknown_settings(os.environ).values():
            structlog.get_logger().warning("setting ignored", reason=said)
        if command == "bus-key":
            from services.joining.session import bus_key

            print(bus_key(settings))
        else:
            asyncio.run(_work(command)(settings))
    except NotReady as error:
        sys.exit(f"the services did not start: {error}")


def _work(command: str) -> Callable[[Settings], Coroutine[Any, Any, None]]:
    with everything_stays():
        if command == "router":
            from services.router import route

            return route
        from services.serve import dispatch, serve

        return {"serve": serve, "dispatch": dispatch}[command]


def _end_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def return_freed_memory() -> None:
    """Keep glibc's thresholds where they begin: it raises them with the blocks that it meets, and a process of many months
    then keeps ever more of what it has freed.
    """
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        for threshold in (M_TRIM_THRESHOLD, M_MMAP_THRESHOLD):
            mallopt(threshold, THRESHOLD_BYTES)


def open_as_many_files_as_allowed() -> None:
    """Raise the soft limit of open files to the hard one: every connection is one, and the usual 1024 are for programs of old."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(ValueError, OSError):  # macOS says that there is no limit, and refuses to be asked for that
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def _log(audit_file: Path | None) -> None:
    """Lines go to standard error, those of the audit to a file of their own where one is named."""
    from services.errors import NotReady

    audit = sys.stderr
    if audit_file is not None:
        try:
            audit = words_into(audit_file)
        except OSError as error:
            raise NotReady(f"TRIFARM_AUDIT_FILE names {audit_file}, which cannot be written to: {error}") from error
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr, format="%(levelname)s %(name)s %(message)s")
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=lambda *names: structlog.PrintLogger(audit if AUDIT in names else sys.stderr),
    )


if __name__ == "__main__":
    main()
