"""The farm's word for a report: what each part of it is, by digest, under an Ed25519 signature that anybody can check."""

import hashlib
import json
from typing import Any, Literal

from pydantic import Field

from api_schemas.schema import Schema

DIGEST = r"^[0-9a-f]{64}$"
TRIALS = "per_trial"
"""The part that is signed row by row, so that a changed trial can be named."""


class Signature(Schema):
    """Who signed what; ``parts`` are SHA-256 digests of the canonical JSON of each part of the report."""

    format: Literal["trifarm-signature/1"] = "trifarm-signature/1"
    key: str = Field(pattern=DIGEST, description="the farm's public Ed25519 key")
    job_id: str
    policy: str | None = Field(description="digest of the policy; null for an identification")
    report_sha256: str = Field(pattern=DIGEST)
    parts: dict[str, str]
    signature: str = Field(pattern=r"^[0-9a-f]{128}$", description="over the canonical JSON of all other fields")

    def signed_bytes(self) -> bytes:
        """What the signature is over."""
        return canonical(self.model_dump(exclude={"signature"}))


class PublicKey(Schema):
    """Body of GET /v1/key."""

    key: str = Field(pattern=DIGEST)


def canonical(value: Any) -> bytes:
    """The one way to write a JSON value: names sorted, no spaces, ASCII only."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def parts_of(report: dict[str, Any]) -> dict[str, str]:
    """The digest of each part of a report, by names such as ``success_rate`` and ``per_trial[3]``."""
    parts = {name: value for name, value in report.items() if name != TRIALS}
    parts |= {f"{TRIALS}[{index}]": row for index, row in enumerate(report.get(TRIALS, []))}
    return {name: hashlib.sha256(canonical(value)).hexdigest() for name, value in parts.items()}


def unsigned(key: str, report: dict[str, Any]) -> Signature:
    """What is to be signed of a report; the signature itself is still nought."""
    return Signature(
        key=key,
        job_id=report["job_id"],
        policy=report.get("policy"),
        report_sha256=hashlib.sha256(canonical(report)).hexdigest(),
        parts=parts_of(report),
        signature="0" * 128,
    )


def changed_parts(report: dict[str, Any], signature: Signature) -> list[str]:
    """The parts of the report that are not what was signed, also those that were taken away or added."""
    now = parts_of(report)
    return [name for name in dict.fromkeys((*signature.parts, *now)) if now.get(name) != signature.parts.get(name)]
