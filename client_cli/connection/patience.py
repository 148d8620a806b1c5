"""Asks again, as often as the farm says, where only one's own earlier requests stand in the way."""

import time
from collections.abc import Callable
from typing import TypeVar

from client_cli.terminal.errors import ClientError, Refused

BUSY = frozenset(f"/problems/too-many-{each}" for each in ("uploads", "verifications", "event-readers", "waiting"))
"""Refusals that pass when something of one's own has ended, which takes no more than minutes."""
PATIENCE_S = 300.0

Given = TypeVar("Given")


def pause_s(error: ClientError) -> float | None:
    """After how long to ask again; None where asking again does not help."""
    return error.retry_after_s if isinstance(error, Refused) and error.problem.type in BUSY else None


def patiently(ask: Callable[[], Given]) -> Given:
    """What ``ask`` gives, which is called again for up to ``PATIENCE_S`` while the farm is busy with one's own requests.

    Raises:
        ClientError: as ``ask`` does.
    """
    ends_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return ask()
        except Refused as refusal:
            wait_s = pause_s(refusal)
            if wait_s is None or time.monotonic() + wait_s > ends_s:
                raise
        time.sleep(wait_s)
