"""From a checkpoint to the two files that are submitted: read, pack, compare with the original, write."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from api_schemas.policy import PolicyManifest, canonical_json
from client_cli.packing import comparison, reading
from client_cli.packing.recipe import unit_of
from client_cli.terminal.errors import UsageProblem

ACTIVATIONS = ("elu", "relu", "tanh")


@dataclass(frozen=True)
class Packed:
    """What was written, of what it was made, and how far it may differ from the original.

    Args:
        weights: the file to submit.
        manifest: the file beside it.
        source: library and kind of the checkpoint.
        largest_difference: of an action, on ``comparison.OBSERVATIONS`` observations, in ``unit``.
        unit: N m or rad.
        notes: what was left out or assumed.
        unused: names of the file's tensors that the policy does without.
        allowed: the largest difference that would have passed.
    """

    weights: Path
    manifest: Path
    source: str
    largest_difference: float
    unit: str
    notes: tuple[str, ...]
    unused: tuple[str, ...] = ()
    allowed: float = comparison.LIMIT


def pack_to(out: Path | None, files: Sequence[Path], stated: reading.Statement, *, tolerance: float | None = None) -> Packed:
    """Pack a checkpoint.

    Args:
        out: the weights to write; beside the checkpoint under its name if None.
        files: the checkpoint, and what belongs to it.
        stated: what the files do not say.
        tolerance: the largest difference of an action that passes; by the original's own rounding if None.

    Raises:
        UsageProblem: a file, a name or the ending of ``out`` does not fit.
        ClientError: the packed policy acts otherwise than the original.
    """
    if stated.form not in reading.FORMATS:
        raise UsageProblem(f"--format {stated.form} is not known; choose from {', '.join(reading.FORMATS)}")
    if stated.activation not in (None, *ACTIVATIONS):
        raise UsageProblem(f"--activation {stated.activation} is not known to the farm; choose from {', '.join(ACTIVATIONS)}")
    packed = reading.pack_files(list(files), stated)
    if out is not None and out.resolve() in [path.resolve() for path in files]:
        raise UsageProblem(f"--out {out} is the checkpoint itself, which would be written over; give another name")
    out = beside(files[0], packed.suffix) if out is None else out
    if out.suffix != packed.suffix:
        raise UsageProblem(f"{packed.source} is packed as {packed.suffix}; give --out {out.with_suffix(packed.suffix)}")
    graph = comparison.converted(packed.weights, packed.suffix, packed.manifest)
    unit, given = unit_of(packed.manifest), comparison.observations(packed.manifest, packed.normaliser)
    compared = comparison.compare(packed.original, graph, given, tolerance)
    comparison.check(compared, unit, packed.original, given)
    _write(out, packed.weights, packed.manifest)
    return Packed(
        *(out, out.with_suffix(".json"), packed.source, compared.largest_difference, unit, tuple(packed.notes)),
        unused=packed.unused,
        allowed=compared.allowed,
    )


def beside(checkpoint: Path, suffix: str) -> Path:
    """Where a policy is written of which nobody said it: beside its checkpoint, in place of one that was packed before.

    Raises:
        UsageProblem: a file of that name is there that is no packed policy.
    """
    out = checkpoint.with_suffix(suffix) if checkpoint.is_file() else checkpoint / f"{checkpoint.resolve().name}{suffix}"
    if out == checkpoint:
        out = checkpoint.with_name(f"{checkpoint.stem}-packed{suffix}")
    if out.exists() and not _is_packed(out):
        raise UsageProblem(f"{out} is there already; give --out NAME{suffix}")
    return out


def _is_packed(weights: Path) -> bool:
    try:
        return str(json.loads(weights.with_suffix(".json").read_text()).get("format", "")).startswith("trifarm-policy/")
    except (OSError, ValueError, AttributeError):
        return False


def _write(out: Path, weights: bytes, manifest: PolicyManifest) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(weights)
        out.with_suffix(".json").write_text(canonical_json(manifest) + "\n")
    except OSError as error:
        raise UsageProblem(f"cannot write {error.filename}: {error.strerror}") from error
