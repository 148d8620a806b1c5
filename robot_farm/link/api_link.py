"""The only file of the robots that speaks HTTP: renews leases, fetches policies, uploads logs and outcomes."""

import hashlib
import ssl
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from api_schemas.robot import Lease, OutcomeReply, OutcomeReport, Renewal, RenewalReply, StoredFile
from api_schemas.token import NewToken
from api_schemas.trial import Outcome

RETRY_FOR_S = 120.0
"""An outcome is offered again for so long when the API is away; by then the lease has long run out."""
WAIT_FOR_S = 3600.0
"""A file is offered again for so long while its lease is renewed: then the API is there, and what keeps files is away."""
PART_BYTES = 1 << 16
"""Of a file that is sent: even a slow link takes the next part within seconds."""
GRAPHS_KEPT = 20
"""So many policies' graphs stay with a robot; the one that was wanted last the longest ago goes first."""
NOT_EXPECTED = "robot-not-expected"
"""In the type of the problem by which the API refuses such a robot."""
_RETRY_STATUS = frozenset({429, 500, 502, 503, 504})
NOT_THE_API = "the answer is none of the farm's API; --api names the farm itself, with https:// where it has a certificate"
Answer = TypeVar("Answer", bound=BaseModel)
Patience = Callable[["ApiUnreachableError | None"], bool]
"""Told of each try that failed and, with None, of each part of a file that goes through; says whether to wait for long."""


def impatient(_error: "ApiUnreachableError | None") -> bool:
    """Waits no longer than ``RETRY_FOR_S``."""
    return False


class LeaseRefusedError(Exception):
    """The API says that the lease is no longer ours."""


class ApiUnreachableError(Exception):
    """The API could not be reached in time, or says that a part of the farm is away."""


class ApiFailedError(ApiUnreachableError):
    """The API answered that it failed: it may do so whenever it is asked for this, and for nothing else."""


class NotAdmittedError(Exception):
    """The farm does not take the robot: its token was revoked or is none of a robot's, or it is not expected."""


class NotExpectedError(NotAdmittedError):
    """The farm expects fewer robots than this one's number; it may be told of more at any time."""


class TokenEndedError(NotAdmittedError):
    """The API does not know the token, or no longer: it was revoked."""


def own_token(api: str, token: str, robot: str, *, ca: Path | None = None, timeout_s: float = 5.0) -> str:
    """The robot's own token, with which it can act for itself alone; for the farm's token or its own.

    Raises:
        ApiUnreachableError: no answer, or none of the farm's API.
        NotAdmittedError: the token is none of a robot's, or was revoked.
    """
    path = f"/v1/robots/{robot}/token"
    with ApiLink(api, token, ca=ca, timeout_s=timeout_s) as link:
        return understood(NewToken, link.once("POST", path), f"POST {path}").secret


def understood(kind: type[Answer], response: httpx.Response, asked: str) -> Answer:
    """What the API answered when it was ``asked``.

    Raises:
        ApiUnreachableError: somebody else answered, such as a proxy that shows a page of its own.
    """
    try:
        return kind.model_validate_json(response.content)
    except ValidationError as error:
        raise ApiUnreachableError(f"{asked}: status {response.status_code}, but {NOT_THE_API}") from error


class ApiLink:
    """A robot's connection to the API; a context manager. Safe to use from several threads.

    ``ca`` is a PEM file with the certificates that vouch for the API's, instead of those that this machine trusts.
    """

    def __init__(self, api: str, token: str, *, ca: Path | None = None, timeout_s: float = 30.0) -> None:
        self._client = httpx.Client(
            base_url=api,
            headers={"Authorization": f"Bearer {token}"},
            timeout=httpx.Timeout(timeout_s, connect=min(timeout_s, 5.0)),
            verify=True if ca is None else ssl.create_default_context(cafile=ca),
            trust_env=False,  # robots speak to the address they were given, never through a proxy of the environment
        )

    def __enter__(self) -> "ApiLink":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._client.close()

    def renew(self, trial_id: str, robot: str, fence: int) -> RenewalReply:
        """Ask for more time; a single try.

        Raises:
            LeaseRefusedError: the lease has run out or was given to another.
            ApiUnreachableError: no answer, or none of the farm's API.
        """
        body = Renewal(robot=robot, fence=fence).model_dump(mode="json")
        path = f"/v1/leases/{trial_id}/renew"
        return understood(RenewalReply, self.once("POST", path, json=body), f"POST {path}")

    def try_out(self, robot: str) -> None:
        """Ask for something cheap, a single try: whatever is answered, the API is there.

        Raises:
            ApiUnreachableError: no answer.
            NotAdmittedError: the farm does not take the robot any more.
        """
        with suppress(LeaseRefusedError, RuntimeError):
            self.once("POST", f"/v1/robots/{robot}/token")

    def fetch_graph(self, digest: str, sha256: str, folder: Path, patience: Patience = impatient) -> Path:
        """The policy's ONNX graph, kept under its SHA-256 in the robot's own folder until ``GRAPHS_KEPT`` others were wanted.

        Raises:
            ApiUnreachableError: no answer in time.
            ValueError: what came has another digest.
        """
        path = folder / f"{sha256}.onnx"
        # A power cut can leave less than was written, and the policy would be blamed for what it cannot load.
        if path.exists() and hashlib.sha256(path.read_bytes()).hexdigest() == sha256:
            path.touch()
            return path
        for old in sorted(folder.glob("*.onnx"), key=lambda each: each.stat().st_mtime)[: 1 - GRAPHS_KEPT]:
            old.unlink()
        response = self._patiently("GET", f"/v1/policies/{digest}/graph", patience=patience)
        if hashlib.sha256(response.content).hexdigest() != sha256:
            raise ValueError(f"the graph of policy {digest} does not have the SHA-256 {sha256} that the lease names")
        partial = path.with_suffix(".partial")
        partial.write_bytes(response.content)
        return partial.rename(path)

    def upload_log(self, lease: Lease, log: Path, patience: Patience = impatient) -> str:
        """Upload a log under the lease's fence; returns its SHA-256."""
        return self._upload(lease, "log", log, patience)

    def upload_truth(self, lease: Lease, truth: Path, patience: Patience = impatient) -> str:
        """Upload what only operators may see under the lease's fence; returns its SHA-256."""
        return self._upload(lease, "truth", truth, patience)

    def report_outcome(
        self,
        lease: Lease,
        outcome: Outcome,
        log_sha256: str | None,
        truth_sha256: str | None = None,
        patience: Patience = impatient,
    ) -> None:
        """Report how the attempt ended; the last word on a lease."""
        report = OutcomeReport(
            robot=lease.robot, fence=lease.fence, outcome=outcome, log_sha256=log_sha256, truth_sha256=truth_sha256
        )
        path = f"/v1/leases/{lease.trial_id}/outcome"
        self._patiently("POST", path, OutcomeReply, json=report.model_dump(mode="json"), patience=patience)

    def _upload(self, lease: Lease, kind: str, file: Path, patience: Patience) -> str:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        headers = {"X-Content-SHA256": digest, "Content-Length": str(file.stat().st_size)}
        path = f"/v1/leases/{lease.trial_id}/{lease.fence}/{kind}"
        self._patiently("PUT", path, StoredFile, headers=headers, upload=file, patience=patience)
        return digest

    def _patiently(
        self,
        method: str,
        url: str,
        kind: type[BaseModel] | None = None,
        *,
        upload: Path | None = None,
        patience: Patience = impatient,
        **request,
    ) -> httpx.Response:
        """Send until it is answered, at most ``RETRY_FOR_S``, or ``WAIT_FOR_S`` where the caller has the patience.

        With ``kind`` only such an answer counts: what a proxy says in the API's place accepts nothing.
        """
        began_s, pause_s = time.monotonic(), 0.1
        while True:
            patience(None)
            try:
                response = self._sent(method, url, upload, patience, **request)
                if kind is not None:
                    understood(kind, response, f"{method} {url}")
                return response
            except ApiUnreachableError as error:
                waits = patience(error) and not isinstance(error, ApiFailedError)
                if time.monotonic() - began_s > (WAIT_FOR_S if waits else RETRY_FOR_S):
                    raise
            time.sleep(pause_s)
            pause_s = min(2 * pause_s, 3.0)

    def _sent(self, method: str, url: str, upload: Path | None, patience: Patience, **request) -> httpx.Response:
        if upload is None:
            return self.once(method, url, patience=patience, **request)
        with upload.open("rb") as stream:
            parts = iter(lambda: stream.read(PART_BYTES), b"")
            return self.once(method, url, content=_noticed(parts, patience), **request)

    def once(self, method: str, url: str, *, patience: Patience = impatient, **request) -> httpx.Response:
        """Send once and sort out what can come back; the response has a status and a body, nothing else."""
        try:
            with self._client.stream(method, url, **request) as answer:
                content = b"".join(_noticed(answer.iter_bytes(), patience))
        except httpx.RequestError as error:
            said = str(error) or type(error).__name__
            hint = "; --ca or TRIFARM_CA names the certificates to trust" if "certificate" in said.lower() else ""
            raise ApiUnreachableError(f"{method} {url}: {said}{hint}") from error
        response = httpx.Response(answer.status_code, content=content)
        if response.status_code in _RETRY_STATUS:
            kind = ApiFailedError if response.status_code == 500 else ApiUnreachableError
            raise kind(f"{method} {url}: status {response.status_code}")
        if response.is_redirect:
            raise ApiUnreachableError(f"{method} {url}: status {response.status_code} leads elsewhere; {NOT_THE_API}")
        if response.status_code in {404, 409}:
            raise LeaseRefusedError(f"{method} {url}: {response.text[:300]}")
        if response.status_code in {401, 403}:
            raise _refusal(response)(f"{method} {url}: status {response.status_code}: {response.text[:300]}")
        if response.is_error:
            raise RuntimeError(f"{method} {url}: status {response.status_code}: {response.text[:300]}")
        return response


def _noticed(parts: Iterator[bytes], patience: Patience) -> Iterator[bytes]:
    """The same parts; each is noticed as it comes."""
    for part in parts:
        patience(None)
        yield part


def _refusal(response: httpx.Response) -> type[NotAdmittedError]:
    if response.status_code == 401:
        return TokenEndedError
    return NotExpectedError if NOT_EXPECTED in response.text else NotAdmittedError
