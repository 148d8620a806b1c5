"""Somebody who asks services for something again and again, while a program measures: how long each answer took."""

import threading
import time
from contextlib import contextmanager
from statistics import median

import httpx


def spread_ms(took_s):
    """Median, 95 % and the longest, in milliseconds."""
    if not took_s:
        return {"times": 0}
    ordered = sorted(1e3 * each for each in took_s)
    found = {"median_ms": median(ordered), "p95_ms": ordered[min(len(ordered) - 1, int(0.95 * len(ordered)))]}
    return {name: round(value, 1) for name, value in (found | {"longest_ms": ordered[-1]}).items()} | {"times": len(ordered)}


@contextmanager
def client_of(services):
    """A client as operator, who is signed in to the pages, too."""
    with httpx.Client(base_url=services.api, headers=services.admin.headers, follow_redirects=True, timeout=120) as client:
        client.post("/sign-in", data={"token": services.tokens["admin"]})
        yield client


class Asking:
    """Asks for some paths in turn, in a thread of its own; ``took_s`` keeps the seconds by path."""

    def __init__(self, services, *paths, every_s):
        self.services, self.every_s, self.closing = services, every_s, threading.Event()
        self.took_s = {path: [] for path in paths}

    def __enter__(self):
        self.thread = threading.Thread(target=self.ask, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.closing.set()
        self.thread.join()

    def ask(self):
        with client_of(self.services) as client:
            while not self.closing.wait(self.every_s):
                for path, took_s in self.took_s.items():
                    began_s = time.monotonic()
                    answer = client.get(path)
                    took_s.append(time.monotonic() - began_s)
                    assert answer.status_code == 200, (path, answer.text[:300])
