"""Which file is what, and from it the packed weights, the manifest and the original to compare with."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from api_schemas.policy import PolicyManifest
from client_cli.packing import checkpoints, stable_baselines, whole
from client_cli.packing.original import Original, TorchOriginal
from client_cli.packing.recipe import Normaliser, Recipe, manifest_of, tensors_of
from client_cli.policies.policy_files import check_is_file
from client_cli.terminal.errors import UsageProblem

FORMATS = ("auto", "sb3", "rl-games", "rsl-rl", "skrl", "state-dict", "torchscript", "torch-export")
PLAIN = "state-dict"
PICKLES = (".pkl", ".pickle")
NO_LAST_ACTIVATION = (
    "a state_dict shows no activation behind the last layer, and none is taken: if your network ends in Tanh, write "
    '"squash": "tanh" into output_scaling. The comparison is with the network rebuilt from these tensors, not with your program'
)


@dataclass(frozen=True)
class Statement:
    """What the user says of a file, because the file does not."""

    manifest: PolicyManifest
    form: str = "auto"
    architecture: str | None = None
    activation: str | None = None
    scale: float | None = None
    states: tuple[tuple[int, ...], ...] = ()
    normaliser: str | None = None


@dataclass(frozen=True)
class Packing:
    """Weights in the form of ``suffix``, the manifest that goes with them, and what they were made of."""

    source: str
    weights: bytes
    suffix: str
    manifest: PolicyManifest
    original: Original
    normaliser: Normaliser | None = None
    notes: tuple[str, ...] = ()


def pack_files(files: list[Path], stated: Statement) -> Packing:
    """Packs a checkpoint, with the VecNormalize pickle beside it if one is given.

    Raises:
        UsageProblem: a file is missing, of no known kind, or does not fit what was said of it.
    """
    for path in files:
        check_is_file(path)
    pickles = [path for path in files if path.suffix in PICKLES]
    others = [path for path in files if path.suffix not in PICKLES]
    if len(others) != 1 or len(pickles) > 1:
        raise UsageProblem("give one checkpoint, and for stable-baselines3 at most one VecNormalize pickle (.pkl) with it")
    form = stated.form if stated.form != "auto" else form_of(others[0])
    if pickles and form != "sb3":
        raise UsageProblem(f"a VecNormalize pickle belongs to a stable-baselines3 archive, and {others[0].name} is {form}")
    if form not in ("checkpoint", PLAIN):
        _check_brings_its_own(others[0], form, stated)
    if form == "sb3":
        return _archive(others[0], pickles[0] if pickles else None, stated)
    if form in ("torchscript", "torch-export"):
        return _program(others[0], form, stated)
    return _checkpoint(others[0], form, stated)


def _check_brings_its_own(path: Path, form: str, stated: Statement) -> None:
    if stated.normaliser is not None:
        raise UsageProblem(
            f"--normaliser is for plain state dicts, and {path.name} is {form}: its own normaliser is packed with it"
        )


def form_of(path: Path) -> str:
    """The kind of a file, by what is in it."""
    if not zipfile.is_zipfile(path):
        return "checkpoint"
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if "policy.pth" in names and "data" in names:
        return "sb3"
    if any(name.endswith("archive_format") or "/models/" in f"/{name}" for name in names):
        return "torch-export"
    return "torchscript" if any(name.endswith("constants.pkl") for name in names) else "checkpoint"


def _checkpoint(path: Path, form: str, stated: Statement) -> Packing:
    content = _loaded(path)
    library = checkpoints.library_of(content) if form == "checkpoint" else form
    if library == PLAIN:
        recipe = checkpoints.plain(content, stated.architecture, stated.manifest, stated.normaliser)
    else:
        _check_brings_its_own(path, library, stated)
        recipe = checkpoints.LIBRARIES[library](content, stated.architecture, stated.manifest.network_inputs)
    manifest, weights = _made(recipe, stated)
    original = TorchOriginal(recipe, stated.manifest, stated.scale, manifest.activation)
    note = (
        f"the file does not name the activation: {manifest.activation} is taken. The comparison is with the network rebuilt in "
        "torch, which cannot show that it was another"
    )
    notes = () if stated.activation else (note,)
    if library == PLAIN and manifest.output_scaling.squash is None:
        notes = (*notes, NO_LAST_ACTIVATION)
    return Packing(recipe.source, weights, ".safetensors", manifest, original, recipe.normaliser, notes)


def _loaded(path: Path) -> Mapping[str, Any]:
    """A file of ``torch.save``; where it holds more than tensors its code runs, as it did in the training."""
    import torch

    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:
        try:
            content = torch.load(path, map_location="cpu", weights_only=False)
        except Exception as error:
            hint = "; a whole module of a class of your own: save its state_dict, or a torch.export program"
            raise UsageProblem(
                f"torch cannot read {path.name}: {str(error)[:300]}{hint if isinstance(error, AttributeError) else ''}"
            ) from error
    if not isinstance(content, Mapping):
        raise UsageProblem(f"{path.name} holds a {type(content).__name__}; save its state_dict, or torch.jit.script of it")
    return content


def _archive(path: Path, pickled: Path | None, stated: Statement) -> Packing:
    archive = stable_baselines.read(path, pickled)
    recipe = stable_baselines.recipe_of(archive, stated.activation)
    manifest, weights = _made(recipe, stated)
    if archive.policy is not None:
        original: Original = stable_baselines.LibraryOriginal(archive, stated.manifest, stated.scale)
        notes = ()
    else:
        original = TorchOriginal(recipe, stated.manifest, stated.scale, manifest.activation)
        notes = (f"compared with the network rebuilt from its weights, not with the library's own ({archive.why_not})",)
    return Packing(recipe.source, weights, ".safetensors", manifest, original, recipe.normaliser, notes)


def _made(recipe: Recipe, stated: Statement) -> tuple[PolicyManifest, bytes]:
    import safetensors.numpy

    manifest = manifest_of(recipe, stated.manifest, stated.scale, stated.activation)
    tensors = {name: values.copy() for name, values in tensors_of(recipe).items()}
    return manifest, safetensors.numpy.save(tensors)


def _program(path: Path, form: str, stated: Statement) -> Packing:
    takes = stated.manifest.network_inputs
    program = whole.torch_script(path, stated.states) if form == "torchscript" else whole.torch_export(path, takes)
    manifest = whole.manifest_of(program, stated.manifest, stated.scale)
    return Packing(form, whole.onnx_of(program, takes), ".onnx", manifest, whole.ProgramOriginal(program, manifest))
