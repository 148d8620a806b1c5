"""``trifarm pack``: what a training library wrote becomes a policy that can be submitted; on this machine, with no server."""

import importlib.util
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api_schemas.policy import PolicyManifest
from client_cli.policies.policy_files import LAYOUT_NAMES, layout_named, manifest_beside, read_manifest
from client_cli.policies.trying import task_of, tried
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption, LayoutOption, TriedTaskOption, TryOption
from client_cli.terminal.output import note, print_document, print_line

if TYPE_CHECKING:
    from client_cli.packing.packed_files import Packed
    from client_cli.packing.reading import Statement

FORMATS = "auto, sb3, sb2, rl-games, rsl-rl, skrl, state-dict, torchscript, torch-export, onnx, hugging-face"


def pack(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Checkpoint; for stable-baselines3 also its VecNormalize pickle (.pkl); or a folder of checkpoints.",
        ),
    ],
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="NAME",
            help="Weights to write, or the folder for those of a folder; by default beside the checkpoint under its name.",
        ),
    ] = None,
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
    actions: Annotated[
        str | None,
        typer.Option(
            "--action-normaliser",
            metavar="KIND:NAMES",
            help="Numbers in a plain state dict that make actions of outputs: mean-std:MEAN,STD, min-max:MIN,MAX, "
            "scale-bias:SCALE,BIAS, tanh-scale-bias:SCALE,BIAS, or none.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance", min=0.0, help="Largest difference of an action that passes, N m or rad; by default by rounding."
        ),
    ] = None,
    python: Annotated[
        Path | None,
        typer.Option("--python", metavar="PATH", help="Interpreter of an environment that has LeRobot, for its policies."),
    ] = None,
    task: TriedTaskOption = None,
    tries: TryOption = True,
    as_json: JsonOption = False,
) -> None:
    """Pack a checkpoint into weights and a manifest, and compare both with the original on 1,000 observations.

    Reading a checkpoint runs the code in it: pack only files that you trust.
    """
    _need_torch()
    from client_cli.packing.folder import is_many
    from client_cli.packing.reading import Statement

    stated = Statement(
        manifest=stated_manifest(files[0], manifest, layout),
        form=form,
        architecture=architecture,
        activation=activation,
        scale=scale,
        states=tuple(_shape(each) for each in state or ()),
        normaliser=normaliser,
        action_normaliser=actions,
        python=python,
    )
    if len(files) == 1 and is_many(files[0]):
        _pack_many(files[0], out, stated, tolerance, as_json=as_json)
    else:
        _pack_one(files, out, stated, tolerance, (task or task_of(stated.manifest)) if tries else None, as_json=as_json)


def _pack_one(
    files: list[Path], out: Path | None, stated: "Statement", tolerance: float | None, task: str | None, *, as_json: bool
) -> None:
    """``task`` is tried afterwards; None for no trials."""
    from client_cli.packing.comparison import OBSERVATIONS
    from client_cli.packing.packed_files import pack_to

    packed = pack_to(out, files, stated, tolerance=tolerance)
    for text in packed.notes:
        note(f"note: {text}")
    if not as_json:
        print_line(f"packed {files[0].name} ({packed.source}) as {packed.weights} and {packed.manifest.name}")
        print_line(
            f"largest difference from the original on {OBSERVATIONS} observations: "
            f"{packed.largest_difference:.2g} {packed.unit} (allowed {packed.allowed:.2g})"
        )
    warnings = () if task is None else _tried(packed, task)
    if as_json:
        print_document(document(packed, warnings))
        return
    task = task or task_of(read_manifest(packed.manifest))
    if warnings:
        note("if a warning names what is wrong, pack once more with that mended; if all is as it should be, go on")
    print_line(f"next: trifarm submit {shlex.quote(str(packed.weights))} --task {task or 'TASK'} --wait")


def _tried(packed: "Packed", task: str) -> tuple[str, ...]:
    """Warnings of the short trials, told as they are found; they take a while on a busy machine, so that it is said before."""
    note(f"trying it in 20 short trials of {task}, for warnings only (--no-try leaves that out)")
    warnings = tried(packed.weights, read_manifest(packed.manifest), task)
    for text in warnings:
        note(f"warning: {text}")
    if not warnings:
        note("the short trials showed nothing strange")
    return warnings


def _pack_many(folder: Path, out: Path | None, stated: "Statement", tolerance: float | None, *, as_json: bool) -> None:
    from client_cli.packing.folder import PACKED, Tried, pack_folder

    def tell(each: Tried) -> None:
        if each.packed is None:
            note(f"{each.file.name}: not packed: {(each.why_not or '').splitlines()[0][:300]}")
        elif not as_json:
            found = each.packed
            print_line(f"{each.file.name}: {found.weights.name}, differs by {found.largest_difference:.2g} {found.unit}")

    done = pack_folder(folder, out, stated, tell, tolerance=tolerance)
    failed = [each for each in done if each.packed is None]
    if as_json:
        rows = [
            {"file": each.file.name, "why_not": each.why_not} | ({} if each.packed is None else document(each.packed))
            for each in done
        ]
        print_document({"packed": len(done) - len(failed), "not_packed": len(failed), "policies": rows})
    else:
        where = out or folder / PACKED
        print_line(f"packed {len(done) - len(failed)} of {len(done)}; next: trifarm submit {shlex.quote(str(where))} --task TASK")
    if failed:
        raise typer.Exit(ExitCode.OTHER)


def document(packed: "Packed", warnings: tuple[str, ...] = ()) -> dict[str, object]:
    """What ``--json`` prints."""
    return {
        "weights": str(packed.weights),
        "manifest": str(packed.manifest),
        "source": packed.source,
        "largest_difference": packed.largest_difference,
        "allowed": packed.allowed,
        "unit": packed.unit,
        "notes": list(packed.notes),
        "unused": list(packed.unused),
        "warnings": list(warnings),
    }


def _need_torch() -> None:
    if importlib.util.find_spec("torch") is None:
        raise ClientError(
            "pack reads checkpoints with torch, which is not installed here: pip install -e '.[learning]' in the clone, "
            "or the wheel with '[learning]' after its name"
        )


def stated_manifest(weights: Path, manifest: Path | None, layout: str | None) -> PolicyManifest:
    """What a checkpoint expects, by a file or a layout's name, or by the manifest beside it.

    Raises:
        UsageProblem: nothing says it, or two things do.
    """
    if manifest is None and layout is None and (beside := manifest_beside(weights)) is not None:
        note(f"note: its manifest is {beside.name}, which lies beside it (--layout or --manifest FILE say another)")
        return read_manifest(beside)
    if (manifest is None) == (layout is None):
        raise UsageProblem(
            f"what does {weights.name} expect? Give --layout with one of {LAYOUT_NAMES} ('trifarm layouts' shows them), or "
            "--manifest FILE with the observation that it was trained on; not both"
        )
    if manifest is not None:
        return read_manifest(manifest)
    return layout_named(layout or "")


def _shape(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(each) for each in text.split(","))
    except ValueError:
        raise UsageProblem(f"--state {text!r} is not a shape; write its numbers with commas, such as 1,1,256") from None
