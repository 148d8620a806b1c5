"""How much memory crowds take of the services: large heads, slow bodies, connections without a handshake, event streams.

``python -m tests.benchmarks.crowd_memory --out results/crowd-memory.json``: for each crowd a services process of its own, which
first answers some hundred requests; then the crowd for a minute, which comes back whenever it is sent away, and what the process
has resident meanwhile. None of the crowds but the last has a token.
"""

import argparse
import asyncio
import json
import os
import ssl
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.integration.farm_process import services
from tests.integration.test_tls import self_signed

HEAD_BYTES, BODY_BYTES = 60_000, 15_000
WARM_REQUESTS = 300
LOOK_EVERY_S = 0.2
STREAMS_OF_OWNER = 20
JSON_TYPE = "Content-Type: application/json"
SETTINGS = {"requests_per_s": 0, "anonymous_requests_per_s": 0}
Visit = Callable[[Any, int, Counter[str]], Awaitable[None]]


async def large_heads(farm: Any, number: int, said: Counter[str]) -> None:
    """A request whose head has 60 kB, in one header or, every other time, in thousands."""
    lines = [f"X: {'x' * HEAD_BYTES}"] if number % 2 else [f"a{each}:" for each in range(HEAD_BYTES // 8)]
    await _request(farm, said, "\r\n".join(("GET /healthz HTTP/1.1", "Host: localhost", *lines, "", "")).encode())


async def half_heads(farm: Any, _number: int, said: Counter[str]) -> None:
    """A head of 15 kB that does not end."""
    await _request(farm, said, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * BODY_BYTES)


async def slow_bodies(farm: Any, number: int, said: Counter[str]) -> None:
    """A body of 15 kB whose end does not come, or one of megabytes."""
    size = BODY_BYTES + 1 if number % 4 else 1 << 20
    head = f"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\n{JSON_TYPE}\r\nContent-Length: {size}\r\n\r\n"
    await _request(farm, said, head.encode() + b"x" * (size - 1))


async def no_handshake(farm: Any, _number: int, said: Counter[str]) -> None:
    """A connection on which the farm waits for the beginning of TLS."""
    await _request(farm, said, b"", tls=False)


async def streams(farm: Any, number: int, said: Counter[str]) -> None:
    """An event stream of a job that waits."""
    owner = number // STREAMS_OF_OWNER
    token, job_id = farm.owners[owner % len(farm.owners)]
    head = f"GET /v1/jobs/{job_id}/events HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n"
    await _request(farm, said, head.encode())


CROWDS: dict[str, tuple[Visit, int, bool]] = {
    "large heads": (large_heads, 16, False),
    "half heads": (half_heads, 400, False),
    "large heads over TLS": (large_heads, 16, True),
    "bodies": (slow_bodies, 400, False),
    "connections without a handshake": (no_handshake, 400, True),
    "event streams": (streams, 400, False),
}
"""Who comes, how many at once, and whether over TLS."""


async def _request(farm: Any, said: Counter[str], sent: bytes, *, tls: bool | None = None) -> None:
    trusting = None
    if farm.verify and tls is not False:
        trusting = ssl.create_default_context()
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    answer = b""
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", farm.port, ssl=trusting)
    except OSError as error:
        said[type(error).__name__] += 1
        await asyncio.sleep(0.1)
        return
    try:
        writer.write(sent)
        answer = await reader.read(12)
        while await reader.read(65536):
            pass
    except OSError:
        pass
    finally:
        said[answer[9:12].decode(errors="replace") or "closed"] += 1
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()


async def _come_again(visit: Visit, farm: Any, number: int, said: Counter[str]) -> None:
    while True:
        await visit(farm, number, said)
        number += 1 if visit is not streams else 0


async def crowd(farm: Any, visit: Visit, count: int, lasts_s: float) -> dict[str, Any]:
    """The crowd for so long; what is resident before, at most and a moment after, in MB."""
    before, said, seen = resident_mb(farm), Counter[str](), []
    visitors = [asyncio.create_task(_come_again(visit, farm, number, said)) for number in range(count)]
    ends_s = time.monotonic() + lasts_s
    while time.monotonic() < ends_s:
        await asyncio.sleep(LOOK_EVERY_S)
        seen.append(resident_mb(farm))
    answered_s = await asyncio.to_thread(_answers, farm)
    for each in visitors:
        each.cancel()
    await asyncio.wait(visitors)
    await asyncio.sleep(2.0)
    return {
        "connections": count,
        "before_mb": round(before, 1),
        "most_mb": round(max(seen), 1),
        "middle_mb": round(statistics.median(seen), 1),
        "after_mb": round(resident_mb(farm), 1),
        "times": round(max(seen) / before, 2),
        "answers": dict(said),
        "another_is_answered_after_s": round(answered_s, 2),
    }


def _answers(farm: Any) -> float:
    began_s = time.monotonic()
    assert farm.admin.get("/v1/status").status_code == 200
    return time.monotonic() - began_s


def resident_mb(farm: Any) -> float:
    """Of the services process."""
    return int(Path(f"/proc/{farm.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(name: str, lasts_s: float, folder: Path) -> dict[str, Any]:
    """One crowd at a services process of its own."""
    visit, count, over_tls = CROWDS[name]
    keys = dict(zip(("tls_certificate", "tls_key"), self_signed(folder, "farm"), strict=True)) if over_tls else {}
    with services(folder / "farm", **SETTINGS, **keys) as farm:
        policy = farm.policy()
        job_id = farm.submit(policy, trials=1).json()["job_id"]
        for _ in range(WARM_REQUESTS // 3):
            for path in ("/v1/status", f"/v1/jobs/{job_id}", "/v1/robots"):
                assert farm.admin.get(path).status_code == 200
        crowded: Any = farm
        owners = [f"owner-{number}" for number in range(count // STREAMS_OF_OWNER)] if visit is streams else []
        crowded.owners = [_owner(farm, each) for each in owners]
        return {"crowd": name} | asyncio.run(crowd(farm, visit, count, lasts_s))


def _owner(farm: Any, name: str) -> tuple[str, str]:
    secret = farm.admin.post("/v1/tokens", json={"owner": name, "scopes": ["submit"]}).json()["secret"]
    client = farm.client(secret)
    return secret, farm.submit(farm.policy(client), client=client, trials=1).json()["job_id"]


def main() -> None:
    """Measures each crowd, and keeps what is measured after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--crowd", nargs="*", choices=CROWDS, default=list(CROWDS))
    given = parser.parse_args()
    found = []
    for name in given.crowd:
        with tempfile.TemporaryDirectory() as folder:
            found.append(measure(name, given.seconds, Path(folder)))
        given.out.write_text(json.dumps({"seconds": given.seconds, "crowds": found}, indent=1) + "\n")
        print(json.dumps(found[-1]))


if __name__ == "__main__":
    main()
