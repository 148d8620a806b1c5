"""``trifarm status``: how the farm is, in plain words."""

import os

from api_schemas.status import FarmStatus
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import duration, print_document, print_line


def status(as_json: JsonOption = False) -> None:
    """Show the state of the farm: robots, queue and problems."""
    with ApiClient(load_connection(os.environ)) as client:
        farm = client.status()
        url = client.url
    if as_json:
        print_document(farm)
    else:
        print_line(text(farm, url))


def text(farm: FarmStatus, url: str) -> str:
    """The status for people, one line for each thing to know."""
    oldest = "" if farm.oldest_queued_s is None else f", the oldest for {duration(farm.oldest_queued_s)}"
    lines = [
        farm.summary,
        *(f"problem: {problem}" for problem in farm.problems),
        f"robots: {_counts(farm.robots_by_state)}",
        f"jobs:   {_counts(farm.jobs_by_state)}",
        f"trials: {farm.trials_running} running, {farm.trials_queued} queued{oldest}",
        *_jail(farm),
        f"farm {farm.farm!r} at {url}, physics {farm.physics}, version {farm.version}",
    ]
    return "\n".join(lines)


def _jail(farm: FarmStatus) -> list[str]:
    """What uploads and policies are shut into; nothing if the farm does not tell."""
    if farm.jail is None:
        return []
    return [
        f"jail:   {farm.jail.level} for uploads, robots: {_counts(farm.robots_by_jail)}",
        f"        {', '.join(farm.jail.layers)}",
    ]


def _counts(by_state: dict[str, int]) -> str:
    return ", ".join(f"{count} {state}" for state, count in by_state.items() if count) or "none"
