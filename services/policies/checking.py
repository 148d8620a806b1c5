"""The server's verdict on a policy without a server: ``python -m services.policies.checking WEIGHTS MANIFEST [--json]``.

The same steps as an upload's, in the same confined child, with the limits that a server has unless it was told others. Ends
with 0 where the policy would be accepted and with 5 where it would be refused.
"""

import argparse
import asyncio
import hashlib
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from api_schemas.error import Problem
from api_schemas.policy import MAX_WEIGHTS_BYTES, PolicyCheck, PolicyManifest, policy_digest
from services.errors import ServiceError
from services.policies import intake
from services.policies.jailed_conversion import Converted, convert

DEADLINE_S = 60.0
ACCEPTED, REFUSED = 0, 5


def verdict(weights: Path, manifest: PolicyManifest) -> PolicyCheck:
    """What the server would say to these weights with this manifest."""
    with weights.open("rb") as file:
        digest = policy_digest(hashlib.file_digest(file, "sha256").hexdigest(), manifest)
    size = weights.stat().st_size
    try:
        kind = intake.weights_format(weights.name)
        intake.check_weights(weights, kind, MAX_WEIGHTS_BYTES)
        converted = _converted(weights, kind, manifest)
    except ServiceError as error:
        problem = Problem(
            type=f"/problems/{error.slug}", title=error.title, status=error.status, detail=error.detail, **error.members
        )
        return PolicyCheck(accepted=False, file=weights.name, digest=digest, weights_bytes=size, problem=problem)
    return PolicyCheck(
        accepted=True, file=weights.name, digest=digest, weights_format=kind, weights_bytes=size, warnings=converted.warnings
    )


def _converted(weights: Path, kind: str, manifest: PolicyManifest) -> Converted:
    with tempfile.TemporaryDirectory(prefix="trifarm-check-") as name:
        folder = Path(name)
        # A copy, since the child goes by the end of the name, and need see nothing but this folder.
        copy = folder / f"weights.{kind}"
        shutil.copyfile(weights, copy)
        return asyncio.run(convert(copy, manifest, folder, DEADLINE_S, filename=weights.name))


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the verdict; gives the exit code."""
    parser = argparse.ArgumentParser(prog="python -m services.policies.checking")
    parser.add_argument("weights", type=Path)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--json", action="store_true", dest="as_json")
    given = parser.parse_args(arguments)
    said = verdict(given.weights, PolicyManifest.model_validate_json(given.manifest.read_text()))
    if given.as_json:
        sys.stdout.write(said.model_dump_json(indent=2) + "\n")
        return ACCEPTED if said.accepted else REFUSED
    for warning in said.warnings:
        sys.stderr.write(f"warning: {warning}\n")
    if said.problem is not None:
        sys.stderr.write(f"error: {said.problem.detail} ({said.problem.title})\n")
        return REFUSED
    sys.stdout.write(f"{said.file} would be accepted as policy {said.digest}\n")
    return ACCEPTED


if __name__ == "__main__":
    sys.exit(main())
