"""Ends a process when the one that started it has gone."""

import os
import threading


def watch_parent(stop: threading.Event, parent_pid: int) -> None:
    """Stop when the process that started this one has gone; for a thread of its own."""
    while not stop.wait(0.5):
        if os.getppid() != parent_pid:
            stop.set()
