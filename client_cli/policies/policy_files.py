"""A policy as files on the user's machine, checked before anything is sent."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from api_schemas.policy import LAYOUTS, MAX_WEIGHTS_BYTES, PolicyManifest, WeightsFormat, policy_digest
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.wrong_values import sentence

LAYOUT_NAMES = ", ".join(LAYOUTS)


@dataclass(frozen=True)
class LocalPolicy:
    """Weights on disk, the manifest that goes with them, and the digest of both."""

    weights: Path
    manifest: PolicyManifest
    digest: str


def read_policy(weights: Path, manifest_file: Path | None, layout: str | None) -> LocalPolicy:
    """Check and digest a policy; raises UsageProblem with the limit and the valid choices."""
    _check_weights(weights)
    manifest = find_manifest(weights, manifest_file, layout)
    with weights.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return LocalPolicy(weights=weights, manifest=manifest, digest=policy_digest(sha256, manifest))


def check_is_file(weights: Path) -> None:
    """Raise UsageProblem where there is no such file."""
    if weights.is_dir():
        raise UsageProblem(f"{weights} is a folder; name one file in it")
    if not weights.is_file():
        raise UsageProblem(f"there is no file {weights}")


def _check_weights(weights: Path) -> None:
    check_is_file(weights)
    suffixes = [f".{form}" for form in WeightsFormat]
    if weights.suffix not in suffixes:
        raise UsageProblem(
            f"{weights.name} ends in {weights.suffix or 'no suffix'!r}, but a policy's weights are one file that cannot "
            f"carry code: {', '.join(suffixes)}; 'trifarm pack FILE' makes one of other formats"
        )
    size = weights.stat().st_size
    if not 0 < size <= MAX_WEIGHTS_BYTES:
        raise UsageProblem(f"{weights.name} has {size} bytes; allowed are 1 to {MAX_WEIGHTS_BYTES}")


def find_manifest(weights: Path, manifest_file: Path | None, layout: str | None) -> PolicyManifest:
    """The manifest by its file, by a layout's name, or beside the weights; raises UsageProblem with the choices."""
    if manifest_file and layout:
        raise UsageProblem("give --manifest or --layout, not both")
    if layout:
        if layout not in LAYOUTS:
            raise UsageProblem(f"there is no layout {layout!r}; choose from {LAYOUT_NAMES}")
        return LAYOUTS[layout]
    beside = weights.with_suffix(".json")
    if manifest_file is None and not beside.is_file():
        raise UsageProblem(
            f"what does {weights.name} expect? There is no {beside.name} beside it: give --manifest FILE, or --layout with "
            f"one of {LAYOUT_NAMES}"
        )
    return read_manifest(manifest_file or beside)


def read_manifest(path: Path) -> PolicyManifest:
    """A manifest file; a broken one is refused with the first thing that is wrong in it."""
    try:
        return PolicyManifest.model_validate(json.loads(path.read_text()))
    except OSError as error:
        raise UsageProblem(f"cannot read the manifest {path}: {error.strerror}") from error
    except ValidationError as error:
        raise UsageProblem(f"the manifest {path} is not valid: {sentence(error, 'it')}") from error
    except ValueError as error:
        raise UsageProblem(f"the manifest {path} is not JSON: {error}") from error
