"""From a checkpoint to the two files that are submitted: read, pack, compare with the original, write."""

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
    """

    weights: Path
    manifest: Path
    source: str
    largest_difference: float
    unit: str
    notes: tuple[str, ...]


def pack_to(out: Path, files: Sequence[Path], stated: reading.Statement) -> Packed:
    """Pack a checkpoint.

    Raises:
        UsageProblem: a file, a name or the ending of ``out`` does not fit.
        ClientError: the packed policy acts otherwise than the original.
    """
    if stated.form not in reading.FORMATS:
        raise UsageProblem(f"--format {stated.form} is not known; choose from {', '.join(reading.FORMATS)}")
    if stated.activation not in (None, *ACTIVATIONS):
        raise UsageProblem(f"--activation {stated.activation} is not known to the farm; choose from {', '.join(ACTIVATIONS)}")
    packed = reading.pack_files(list(files), stated)
    if out.suffix != packed.suffix:
        raise UsageProblem(f"{packed.source} is packed as {packed.suffix}; give --out {out.with_suffix(packed.suffix)}")
    graph = comparison.converted(packed.weights, packed.suffix, packed.manifest)
    unit = unit_of(packed.manifest)
    compared = comparison.compare(packed.original, graph, comparison.observations(packed.manifest, packed.normaliser))
    comparison.check(compared, unit)
    _write(out, packed.weights, packed.manifest)
    return Packed(out, out.with_suffix(".json"), packed.source, compared.largest_difference, unit, tuple(packed.notes))


def _write(out: Path, weights: bytes, manifest: PolicyManifest) -> None:
    try:
        out.write_bytes(weights)
        out.with_suffix(".json").write_text(canonical_json(manifest) + "\n")
    except OSError as error:
        raise UsageProblem(f"cannot write {error.filename}: {error.strerror}") from error
