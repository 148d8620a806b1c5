"""``trifarm pack``: what a training library wrote becomes a policy that can be submitted; on this machine, with no server."""

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api_schemas.policy import LAYOUTS, PolicyManifest
from client_cli.policies.policy_files import LAYOUT_NAMES, read_manifest
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.options import JsonOption, LayoutOption
from client_cli.terminal.output import note, print_document, print_line

if TYPE_CHECKING:
    from client_cli.packing.packed_files import Packed

FORMATS = "auto, sb3, rl-games, rsl-rl, skrl, state-dict, torchscript, torch-export"


def pack(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Checkpoint; for stable-baselines3 also its VecNormalize pickle (.pkl)."),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="NAME", help="Weights to write: NAME.safetensors, or NAME.onnx for TorchScript and torch.export."
        ),
    ],
    *,
    manifest: Annotated[
        Path | None,
        typer.Option(
            "--manifest", metavar="FILE", help="Manifest with the observation and the actions of the network; or --layout."
        ),
    ] = None,
    layout: LayoutOption = None,
    form: Annotated[str, typer.Option("--format", metavar="NAME", help=f"Format of the checkpoint: {FORMATS}.")] = "auto",
    architecture: Annotated[
        str | None,
        typer.Option(
            "--architecture", metavar="NAMES", help="Modules of the actor in order, such as lstm,actor.0,actor.2,actor.4."
        ),
    ] = None,
    activation: Annotated[
        str | None, typer.Option("--activation", metavar="NAME", help="Activation if the file states none: elu, relu or tanh.")
    ] = None,
    scale: Annotated[float | None, typer.Option("--scale", help="Size of a training action of 1, in N m or rad.")] = None,
    state: Annotated[
        list[str] | None,
        typer.Option("--state", metavar="SHAPE", help="Shape of a state of a TorchScript program, such as 1,1,256; repeatable."),
    ] = None,
    normaliser: Annotated[
        str | None,
        typer.Option(
            "--normaliser", metavar="NAMES", help="Names in a plain state dict: MEAN,VARIANCE[,EPSILON[,CLIP]], or none."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Pack a checkpoint into weights and a manifest, and compare both with the original on 1,000 observations.

    Reading a checkpoint runs the code in it: pack only files that you trust.
    """
    _need_torch()
    from client_cli.packing.comparison import LIMIT, OBSERVATIONS
    from client_cli.packing.packed_files import pack_to
    from client_cli.packing.reading import Statement

    states = tuple(_shape(each) for each in state or ())
    stated = Statement(_manifest(files[0], manifest, layout), form, architecture, activation, scale, states, normaliser)
    packed = pack_to(out, files, stated)
    for text in packed.notes:
        note(f"note: {text}")
    if as_json:
        print_document(document(packed))
        return
    print_line(f"packed {files[0].name} ({packed.source}) as {packed.weights} and {packed.manifest.name}")
    print_line(
        f"largest difference from the original on {OBSERVATIONS} observations: "
        f"{packed.largest_difference:.2g} {packed.unit} (allowed {LIMIT:g})"
    )


def document(packed: "Packed") -> dict[str, object]:
    """What ``--json`` prints."""
    return {
        "weights": str(packed.weights),
        "manifest": str(packed.manifest),
        "source": packed.source,
        "largest_difference": packed.largest_difference,
        "unit": packed.unit,
    }


def _need_torch() -> None:
    if importlib.util.find_spec("torch") is None:
        raise ClientError(
            "pack reads checkpoints with torch, which is not installed here: pip install -e '.[learning]' in the clone, "
            "or the wheel with '[learning]' after its name"
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
