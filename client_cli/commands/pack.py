"""``trifarm pack``: what a training library wrote becomes a policy that can be submitted; on this machine, with no server."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json
from client_cli.policies.policy_files import LAYOUT_NAMES, read_manifest
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption
from client_cli.terminal.output import note, print_document, print_line

FORMATS = "auto, sb3, rl-games, rsl-rl, skrl, state-dict, torchscript, torch-export"


def pack(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="A checkpoint; for stable-baselines3 its VecNormalize pickle (.pkl) as well."),
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="NAME", help="NAME.safetensors, or NAME.onnx for TorchScript and torch.export.")
    ],
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    form: Annotated[str, typer.Option("--format", metavar="NAME", help=f"One of {FORMATS}.")] = "auto",
    architecture: Annotated[
        str | None,
        typer.Option("--architecture", metavar="NAMES", help="The actor's modules in order: lstm,actor.0,actor.2,actor.4."),
    ] = None,
    activation: Annotated[
        str | None, typer.Option("--activation", metavar="NAME", help="elu, relu or tanh, where the file does not say.")
    ] = None,
    scale: Annotated[float | None, typer.Option("--scale", help="What an action of 1 of the training is, in N m or rad.")] = None,
    state: Annotated[
        list[str] | None,
        typer.Option("--state", metavar="SHAPE", help="Shape of a state of a TorchScript program, such as 1,1,256; repeat it."),
    ] = None,
    normaliser: Annotated[
        str | None,
        typer.Option(
            "--normaliser", metavar="NAMES", help="Of a plain state dict: MEAN,VARIANCE[,EPSILON[,CLIP]] by name, or none."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Pack a checkpoint into weights and manifest, compared with the original on 1,000 observations.

    Reading a checkpoint runs the code in it: pack only files that you trust.
    """
    _need_torch()
    from client_cli.packing import comparison, reading
    from client_cli.packing.recipe import unit_of

    if form not in reading.FORMATS:
        raise UsageProblem(f"--format {form} is not known; choose from {', '.join(reading.FORMATS)}")
    if activation not in (None, "elu", "relu", "tanh"):
        raise UsageProblem(f"--activation {activation} is not known to the farm; choose from elu, relu, tanh")
    states = tuple(_shape(each) for each in state or ())
    stated = reading.Statement(_manifest(files[0], manifest, layout), form, architecture, activation, scale, states, normaliser)
    packed = reading.pack_files(files, stated)
    if out.suffix != packed.suffix:
        raise UsageProblem(f"{packed.source} is packed as {packed.suffix}; give --out {out.with_suffix(packed.suffix)}")
    graph = comparison.converted(packed.weights, packed.suffix, packed.manifest)
    unit = unit_of(packed.manifest)
    compared = comparison.compare(packed.original, graph, comparison.observations(packed.manifest, packed.normaliser))
    comparison.check(compared, unit)
    for text in packed.notes:
        note(f"note: {text}")
    _write(out, packed.weights, packed.manifest)
    if as_json:
        print_document(document(out, packed.source, compared.largest_difference, unit))
        return
    print_line(f"packed {files[0].name} ({packed.source}) as {out} and {out.with_suffix('.json').name}")
    print_line(
        f"largest difference from the original on {comparison.OBSERVATIONS} observations: "
        f"{compared.largest_difference:.2g} {unit} (allowed {comparison.LIMIT:g})"
    )


def document(out: Path, source: str, largest_difference: float, unit: str) -> dict[str, object]:
    """What ``--json`` prints."""
    return {
        "weights": str(out),
        "manifest": str(out.with_suffix(".json")),
        "source": source,
        "largest_difference": largest_difference,
        "unit": unit,
    }


def _need_torch() -> None:
    if importlib.util.find_spec("torch") is None:
        raise ClientError(
            "pack reads checkpoints with torch, which is not installed here: pip install -e '.[learning]' in the clone"
        )


def _manifest(weights: Path, manifest: Path | None, layout: str | None) -> PolicyManifest:
    if (manifest is None) == (layout is None):
        raise UsageProblem(
            f"what does {weights.name} expect? Give --layout with one of {LAYOUT_NAMES}, or --manifest FILE with the "
            "observation that it was trained on; not both"
        )
    if manifest is not None:
        return read_manifest(manifest)
    if layout not in LAYOUTS:
        raise UsageProblem(f"there is no layout {layout!r}; choose from {LAYOUT_NAMES}")
    return LAYOUTS[layout]


def _shape(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(each) for each in text.split(","))
    except ValueError:
        raise UsageProblem(f"--state {text!r} is not a shape; write its numbers with commas, such as 1,1,256") from None


def _write(out: Path, weights: bytes, manifest: PolicyManifest) -> None:
    try:
        out.write_bytes(weights)
        out.with_suffix(".json").write_text(canonical_json(manifest) + "\n")
    except OSError as error:
        raise UsageProblem(f"cannot write {error.filename}: {error.strerror}") from error
