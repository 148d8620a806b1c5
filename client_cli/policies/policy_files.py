"""A policy as files on the user's machine, checked before anything is sent."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from api_schemas.policy import LAYOUTS, MAX_WEIGHTS_BYTES, PolicyManifest, WeightsFormat, policy_digest
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.wrong_values import meant, sentence

LAYOUT_NAMES = ", ".join(LAYOUTS)
MANIFEST_OF_FOLDER = "manifest.json"
"""Stands for every checkpoint beside it that has none of its own."""


@dataclass(frozen=True)
class LocalPolicy:
    """Weights on disk, the manifest that goes with them, and the digest of both."""

    weights: Path
    manifest: PolicyManifest
    digest: str


def read_policy(weights: Path, manifest_file: Path | None, layout: str | None, name: str | None = None) -> LocalPolicy:
    """Check and digest a policy, under another name if one is given; raises UsageProblem with the limit and the valid choices."""
    _check_weights(weights)
    manifest = find_manifest(weights, manifest_file, layout)
    manifest = manifest if name is None else manifest.model_copy(update={"name": name})
    with weights.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return LocalPolicy(weights=weights, manifest=manifest, digest=policy_digest(sha256, manifest))


def check_exists(path: Path) -> None:
    """Raise UsageProblem where there is neither such a file nor such a folder."""
    if not path.exists():
        raise UsageProblem(f"there is no file {path}")


def check_is_file(weights: Path) -> None:
    """Raise UsageProblem where there is no such file."""
    if weights.is_dir():
        raise UsageProblem(f"{weights} is a folder; name one file in it, or 'trifarm pack {weights}' packs it")
    if not weights.is_file():
        raise UsageProblem(f"there is no file {weights}")


def _check_weights(weights: Path) -> None:
    check_is_file(weights)
    suffixes = [f".{form}" for form in WeightsFormat]
    if weights.suffix not in suffixes:
        raise UsageProblem(
            f"{weights.name} ends in {weights.suffix or 'no suffix'!r}, but a policy's weights are one file that cannot "
            f"carry code: {', '.join(suffixes)}; 'trifarm pack {weights.name}' makes one of other formats"
        )
    size = weights.stat().st_size
    if not 0 < size <= MAX_WEIGHTS_BYTES:
        raise UsageProblem(f"{weights.name} has {size} bytes; allowed are 1 to {MAX_WEIGHTS_BYTES}")


def find_manifest(weights: Path, manifest_file: Path | None, layout: str | None) -> PolicyManifest:
    """The manifest by its file, by a layout's name, or beside the weights; raises UsageProblem with the choices."""
    if manifest_file and layout:
        raise UsageProblem("give --manifest or --layout, not both")
    if layout:
        return layout_named(layout)
    beside = manifest_beside(weights)
    if manifest_file is None and beside is None:
        raise UsageProblem(
            f"what does {weights.name} expect? There is no {weights.with_suffix('.json').name} or {MANIFEST_OF_FOLDER} beside "
            f"it: give --manifest FILE, or --layout with one of {LAYOUT_NAMES}"
        )
    return read_manifest(manifest_file or beside or weights)


def layout_named(name: str) -> PolicyManifest:
    """A ready-made manifest; raises UsageProblem with the choices."""
    if name not in LAYOUTS:
        choices = f"choose from {LAYOUT_NAMES} ('trifarm layouts' shows their fields)"
        raise UsageProblem(f"there is no layout {name!r}; {choices}{meant(name, LAYOUTS)}")
    return LAYOUTS[name]


def manifest_beside(weights: Path) -> Path | None:
    """The manifest of a file by its place: of the same name, or that of the whole folder; None if there is neither."""
    folder = weights if weights.is_dir() else weights.parent
    places = [] if weights.is_dir() else [weights.with_suffix(".json")]
    return next((place for place in (*places, folder / MANIFEST_OF_FOLDER) if place.is_file()), None)


def read_manifest(path: Path) -> PolicyManifest:
    """A manifest file; a broken one is refused with the first thing that is wrong in it."""
    try:
        return PolicyManifest.model_validate(json.loads(path.read_text()))
    except OSError as error:
        layout = f"; {path} is the name of a layout: did you mean --layout {path}?" if str(path) in LAYOUTS else ""
        raise UsageProblem(f"cannot read the manifest {path}: {error.strerror}{layout}") from error
    except ValidationError as error:
        raise UsageProblem(f"the manifest {path} is not valid: {sentence(error, 'it')}") from error
    except ValueError as error:
        raise UsageProblem(f"the manifest {path} is not JSON: {error}") from error
