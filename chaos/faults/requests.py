"""Clients and uploads that break off, send what is not whole, vanish, or come with a token that has expired."""

import hashlib
import os
import socket
import struct
import time
from pathlib import Path
from typing import Any

import httpx

from chaos.farm import HOST, small_policy
from chaos.faults.fault import Fault, Scene, now_s
from chaos.processes import DidNotHappen, until
from chaos.robot import problem_of

CUTS = 6
STREAMS = 40
LEFT_OPEN_WITHIN_S = 30.0
TOKEN_LIVES_S = (1.5, 6.0, 24.0)
DAY_S = 86_400
RESET = struct.pack("ii", 1, 0)
"""SO_LINGER that makes close() a reset: the peer is gone without a word."""


def cut_answers(scene: Scene) -> str:
    """The API has answered and the connection is cut before the answer arrives; the clients try again."""
    since_s = now_s()
    scene.clients.cut(CUTS)

    def were_cut() -> bool:
        return scene.clients.relay is not None and scene.clients.relay.cuts >= CUTS

    until(were_cut, 60, f"{CUTS} submissions to be cut off")
    cut = [line for line in scene.lines_since(since_s) if line.did == "unanswered"]
    again = {line.more["key"] for line in cut} - {None}
    return f"{len(cut)} submissions without an answer, {len(again)} of them sent again under their key"


def cut_without_key(scene: Scene) -> str:
    """A submission without a key whose sender hangs up and sends it again: both may count, and each is whole."""
    farm, body = scene.farm, {"policy": scene.farm.policy, "task": "push", "trials": 1, "seed": 4711 + scene.rng.randrange(10**6)}
    request = httpx.Request("POST", f"{farm.url}/v1/jobs", json=body, headers=_bearer(farm.admin))
    with _sent(farm.port, request):
        time.sleep(0.3)  # the API has it; nobody will read the answer
    acknowledged = _submit(scene, body, None)
    jobs = farm.ask("GET", "/v1/jobs?limit=200")
    same = [each["job_id"] for each in (jobs or {"jobs": []})["jobs"] if each["seed"] == body["seed"]]
    if acknowledged not in same:
        raise DidNotHappen("the job that was acknowledged to be there")
    return f"sent twice without a key: jobs made {len(same)}, acknowledged 1"


def same_key_other_body(scene: Scene) -> str:
    """One key under two different submissions."""
    key, body = f"chaos-{scene.rng.randrange(10**12)}", {"policy": scene.farm.policy, "task": "push", "trials": 1, "seed": 1}
    _submit(scene, body, key)
    answer = scene.farm.http.post("/v1/jobs", json=body | {"seed": 2}, headers={"Idempotency-Key": key})
    return _must_refuse(answer, 409)


def half_an_upload(scene: Scene) -> str:
    """The sender of a policy vanishes in the middle of it."""
    farm, weights = scene.farm, os.urandom(400_000)
    digest = hashlib.sha256(weights).hexdigest()
    files = {"weights": ("weights.safetensors", weights)}
    request = httpx.Request(
        "PUT", f"{farm.url}/v1/policies/{digest}", files=files, data={"manifest": "{}"}, headers=_bearer(farm.admin)
    )
    with _sent(farm.port, request, share=0.5):
        time.sleep(0.5)
    incoming = farm.disk / farm.services[0] / "files" / "incoming"
    kept = farm.ask("GET", f"/v1/policies/{digest}")
    if kept is not None:
        raise DidNotHappen("the half policy to be unknown")
    until(lambda: not any(path.stat().st_size == len(weights) // 2 for path in incoming.iterdir()), 40, "the half file to go")
    return "nothing is kept of it"


def wrong_content(scene: Scene) -> str:
    """A policy whose content is not what its name says."""
    weights, manifest = small_policy(seed=scene.rng.randrange(10**6))
    files, data = {"weights": ("weights.safetensors", weights)}, {"manifest": manifest.model_dump_json()}
    return _must_refuse(scene.farm.http.put(f"/v1/policies/{'0' * 64}", files=files, data=data, timeout=60), 422)


def vanishing_streams(scene: Scene) -> str:
    """Readers of event streams vanish; the API's descriptors come back, and a large job is cancelled meanwhile."""
    farm = scene.farm
    job_id = _submit(scene, {"policy": farm.policy, "task": "push", "trials": 500, "seed": scene.rng.randrange(10**6)}, None)
    assert farm.api.running is not None
    descriptors = Path(f"/proc/{farm.api.running.pid}/fd")
    before = len(list(descriptors.iterdir()))
    request = httpx.Request("GET", f"{farm.url}/v1/jobs/{job_id}/events", headers=_bearer(farm.admin))
    open_streams = [_connected(farm.port, request) for _ in range(STREAMS)]
    until(lambda: len(list(descriptors.iterdir())) >= before + STREAMS // 2, 20, "the streams to be open")
    most = len(list(descriptors.iterdir()))
    for stream in open_streams:
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        stream.close()
    took_s = until(
        lambda: len(list(descriptors.iterdir())) <= before + STREAMS // 4, LEFT_OPEN_WITHIN_S, "the descriptors to be closed"
    )
    farm.ask("POST", f"/v1/jobs/{job_id}/cancel")
    until(lambda: (farm.ask("GET", f"/v1/jobs/{job_id}") or {}).get("state") == "cancelled", 60, "the job to be cancelled")
    return f"descriptors {before}, with streams {most}, closed {took_s:.1f} s after the readers vanished; job cancelled"


def expired_token(scene: Scene) -> str:
    """A token whose time is over."""
    for lives_s in TOKEN_LIVES_S:  # on a slow machine a short one ends before it is used
        secret = scene.farm.make_token("short", "submit", days=lives_s / DAY_S)
        if scene.farm.http.get("/v1/jobs", headers=_bearer(secret)).is_success:
            time.sleep(1.5 * lives_s)
            return _must_refuse(scene.farm.http.get("/v1/jobs", headers=_bearer(secret)), 401)
    raise DidNotHappen(f"a token that lives {TOKEN_LIVES_S[-1]:g} s to be good at first")


def _submit(scene: Scene, body: dict[str, Any], key: str | None) -> str:
    """A submission of the run's own; the checker looks after it as after the clients'."""
    headers = {} if key is None else {"Idempotency-Key": key}
    answer = scene.farm.http.post("/v1/jobs", json=body, headers=headers)
    if not answer.is_success:
        raise DidNotHappen(f"a job to be taken: {answer.text[:300]}")
    job_id = answer.json()["job_id"]
    scene.farm.history("acknowledged", job=job_id, owner=answer.json()["owner"], key=key, trials=body["trials"], status=201)
    return job_id


def _must_refuse(answer: httpx.Response, status: int) -> str:
    problem = problem_of(answer)
    if answer.status_code != status or problem is None:
        raise DidNotHappen(f"a refusal with {status}; the answer was {answer.status_code}: {answer.text[:300]}")
    return f"refused with {status}: {problem}"


def _bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def _connected(port: int, request: httpx.Request, share: float = 1.0) -> socket.socket:
    """A connection over which this share of a request was sent."""
    body = request.read()
    head = [f"{request.method} {request.url.raw_path.decode()} HTTP/1.1"]
    head += [f"{name}: {value}" for name, value in request.headers.items()]
    whole = ("\r\n".join(head) + "\r\n\r\n").encode() + body
    connection = socket.create_connection((HOST, port), timeout=10)
    connection.sendall(whole[: int(len(whole) * share)])
    return connection


class _sent:
    """A request whose sender is gone, with a reset, when the block ends."""

    def __init__(self, port: int, request: httpx.Request, share: float = 1.0) -> None:
        self._connection = _connected(port, request, share)

    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self._connection.close()


REQUESTS = (
    Fault("cut-answers", "the connection is cut between the API's answer and the client", cut_answers),
    Fault("cut-without-key", "a sender without Idempotency-Key hangs up and sends again", cut_without_key),
    Fault("same-key", "one Idempotency-Key with two different bodies", same_key_other_body),
    Fault("half-an-upload", "the sender of a file vanishes in the middle", half_an_upload),
    Fault("wrong-content", "a file is not what its name says", wrong_content),
    Fault("vanishing-streams", "readers of event streams vanish without a word", vanishing_streams),
    Fault("expired-token", "a token is used after its time", expired_token),
)
