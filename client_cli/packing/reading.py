"""From a file and what is said of it to packed weights, a manifest and the original to compare with."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy import PolicyManifest
from client_cli.packing import (
    action_normaliser,
    checkpoints,
    hugging_face,
    kinds,
    onnx_files,
    program_tensors,
    stable_baselines,
    stable_baselines2,
    whole,
)
from client_cli.packing.kinds import FORMATS, PLAIN
from client_cli.packing.original import Original, TorchOriginal
from client_cli.packing.quiet import first_sentence, quiet
from client_cli.packing.recipe import Normaliser, Recipe, manifest_of, tensors_of
from client_cli.policies.policy_files import check_exists
from client_cli.terminal.errors import ClientError, UsageProblem

__all__ = ["FORMATS", "Packing", "Statement", "pack_files"]

PICKLES = (".pkl", ".pickle")
NO_LAST_ACTIVATION = (
    "a state_dict shows no activation behind the last layer, and none is taken: if your network ends in Tanh, write "
    '"squash": "tanh" into output_scaling. The comparison is with the network rebuilt from these tensors, not with your program'
)
NAMED_LEFT_OVERS = 8


@dataclass(frozen=True)
class Statement:
    """What the user says of a file, because the file does not; ``python`` is the interpreter that has LeRobot."""

    manifest: PolicyManifest
    form: str = "auto"
    architecture: str | None = None
    activation: str | None = None
    scale: float | None = None
    states: tuple[tuple[int, ...], ...] = ()
    normaliser: str | None = None
    action_normaliser: str | None = None
    python: Path | None = None


@dataclass(frozen=True)
class Packing:
    """Weights in the form of ``suffix``, the manifest that goes with them, and what they were made of.

    ``unused`` names the tensors of the file that the packed policy does without.
    """

    source: str
    weights: bytes
    suffix: str
    manifest: PolicyManifest
    original: Original
    normaliser: Normaliser | None = None
    notes: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()


def pack_files(files: list[Path], stated: Statement) -> Packing:
    """Packs a checkpoint, with the VecNormalize pickle beside it if one is given.

    Raises:
        UsageProblem: a file is missing, of no known kind, or does not fit what was said of it.
    """
    for path in files:
        check_exists(path)
    pickles = [path for path in files if path.suffix in PICKLES]
    others = [path for path in files if path.suffix not in PICKLES]
    if len(others) != 1 or len(pickles) > 1:
        raise UsageProblem(_wrong_files(files))
    path = others[0]
    form = kinds.kind_of(path) if stated.form == "auto" else stated.form
    kinds.check_is(path, form)
    _compute_in_one_thread()
    if pickles and form != "sb3":
        raise UsageProblem(f"a VecNormalize pickle belongs to a stable-baselines3 archive, and {path.name} is {form}")
    if form not in (kinds.CHECKPOINT, PLAIN, "sb2", "hugging-face"):
        _check_brings_its_own(path, form, stated)
    try:
        return _with_left_overs(_packed(path, pickles[0] if pickles else None, form, stated))
    except (ClientError, MemoryError):
        raise
    except Exception as error:
        raise UsageProblem(
            f"{path.name} cannot be read as {form} ({first_sentence(error)}); if it is another kind of file, export the network "
            "with torch.jit.script(network).save('policy.pt') and pack that"
        ) from error


def _with_left_overs(packing: Packing) -> Packing:
    return replace(packing, notes=(*packing.notes, _left_over_note(packing.unused))) if packing.unused else packing


def _compute_in_one_thread() -> None:
    """Small networks are slower in several threads, and much slower on a machine that has other things to do."""
    import torch

    torch.set_num_threads(1)


def suffix_of(path: Path, stated: Statement) -> str:
    """How the packed weights of a file end, without reading more of it than its kind."""
    form = kinds.kind_of(path) if stated.form == "auto" else stated.form
    return ".onnx" if form in ("torchscript", "torch-export", "onnx") else ".safetensors"


def _packed(path: Path, pickled: Path | None, form: str, stated: Statement) -> Packing:
    if form == "hugging-face":
        path, form, stated = hugging_face.opened(path, stated)
    if form == "sb3":
        return _archive(path, pickled, stated)
    if form == "sb2":
        return _old_archive(path, stated)
    if form == "onnx":
        return _graph(path, stated)
    if form in ("torchscript", "torch-export"):
        made = whole.torch_script(path, stated.states) if form == "torchscript" else whole.torch_export(path, stated.manifest)
        return _program(made, path.name, form, stated)
    return _checkpoint(path, form, stated)


def _wrong_files(files: list[Path]) -> str:
    if all(path.suffix in PICKLES for path in files):
        return (
            f"{files[0].name} is a pickle of no known library: if it is a VecNormalize, give its archive before it "
            f"('trifarm pack model.zip {files[0].name}'); arrays of another library write with "
            "numpy.savez('weights.npz', **arrays) and pack that with --architecture"
        )
    return "give one checkpoint, and for stable-baselines3 at most one VecNormalize pickle (.pkl) with it; or a folder of them"


def _check_brings_its_own(path: Path, form: str, stated: Statement) -> None:
    for given, name in ((stated.normaliser, "--normaliser"), (stated.action_normaliser, "--action-normaliser")):
        if given not in (None, checkpoints.NO_NORMALISER):
            raise UsageProblem(
                f"{name} is for plain state dicts, and {path.name} is {form}: its own normaliser is packed with it"
            )


def _checkpoint(path: Path, form: str, stated: Statement) -> Packing:
    content = _loaded(path)
    if hasattr(content, "state_dict"):
        return _program(whole.whole_module(content, stated.states), path.name, "torch module", stated)
    library = checkpoints.library_of(content) if form == kinds.CHECKPOINT else form
    tensors = checkpoints.all_tensors(content)
    if library == PLAIN:
        if (error := kinds.already_packed(path, list(tensors), stated.manifest)) is not None and stated.architecture is None:
            raise error
        recipe = checkpoints.plain(content, stated.architecture, stated.manifest, stated.normaliser, path.name)
    else:
        _check_brings_its_own(path, library, stated)
        recipe = checkpoints.LIBRARIES[library](content, stated.architecture, stated.manifest, path.name)
    return _rebuilt(recipe, tensors, stated, library)


def _rebuilt(recipe: Recipe, tensors: Mapping[str, Any], stated: Statement, library: str) -> Packing:
    """A recipe with the normaliser of actions that was stated, compared with its network in torch."""
    if stated.action_normaliser is not None:
        recipe = action_normaliser.applied(recipe, tensors, stated.action_normaliser)
    unused = left_over(tensors, recipe)
    if stated.action_normaliser is None:
        action_normaliser.check_has_none(unused, tensors)
    manifest, weights = _made(recipe, stated)
    original = TorchOriginal(recipe, stated.manifest, stated.scale, manifest.activation)
    notes = () if stated.activation else (_taken(recipe, manifest),)
    if library == PLAIN and manifest.output_scaling.squash is None:
        notes = (*notes, NO_LAST_ACTIVATION)
    return Packing(recipe.source, weights, ".safetensors", manifest, original, recipe.normaliser, notes, unused)


def _taken(recipe: Recipe, manifest: PolicyManifest) -> str:
    usual = "as the library's MlpPolicy has it" if recipe.activation else "which cannot show that it was another"
    return (
        f"the file does not name the activation: {manifest.activation} is taken. The comparison is with the network rebuilt in "
        f"torch, {usual}"
    )


def left_over(tensors: Mapping[str, Any], recipe: Recipe) -> tuple[str, ...]:
    """Names of tensors that neither the parts nor the normalisers of a recipe use."""
    used = [values for each in recipe.parts for values in each.tensors.values()]
    if recipe.normaliser is not None:
        used += [recipe.normaliser.mean, recipe.normaliser.variance]
    mine = {_same(np.asarray(values)) for values in used}
    joined = {name for name in tensors if recipe.bins and ".logits." in f".{name}"}
    return tuple(
        name for name, values in tensors.items() if _same(values) not in mine and name not in recipe.uses and name not in joined
    )


def _same(values: Any) -> tuple[int, int]:
    """Where an array's numbers lie and how many they are: the same for views of it, flattened ones too."""
    return int(values.__array_interface__["data"][0]), values.size


def _left_over_note(unused: tuple[str, ...]) -> str:
    """Each by its name, or where they are many the modules that they belong to."""
    if len(unused) <= NAMED_LEFT_OVERS:
        return f"the policy does without {len(unused)} of the file's tensors: {', '.join(unused)}"
    modules = list(dict.fromkeys(name.rpartition(".")[0] or name for name in unused))
    if len(modules) > NAMED_LEFT_OVERS:
        modules = list(dict.fromkeys(name.partition(".")[0] for name in unused))
    more = f" and {len(modules) - NAMED_LEFT_OVERS} more" if len(modules) > NAMED_LEFT_OVERS else ""
    names = ", ".join(modules[:NAMED_LEFT_OVERS])
    return f"the policy does without {len(unused)} of the file's tensors, some or all of {names}{more} (--json names each)"


def _loaded(path: Path) -> Any:
    """A file of torch, numpy or safetensors; where a pickle holds more than tensors its code runs, as in the training."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    if kinds.kind_of(path) == PLAIN:
        import safetensors.torch

        return safetensors.torch.load_file(path)
    import torch

    try:
        with quiet():
            content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:
        try:
            with quiet():
                content = torch.load(path, map_location="cpu", weights_only=False)
        except Exception as error:
            raise _unreadable(path, error) from error
    if not isinstance(content, Mapping) and not hasattr(content, "state_dict"):
        raise UsageProblem(f"{path.name} holds a {type(content).__name__}; save its state_dict, or torch.jit.script of it")
    return _without_halves(content) if isinstance(content, Mapping) else content


def _without_halves(content: Mapping[str, Any]) -> dict[str, Any]:
    """The same with float32 for bfloat16, which numpy has not."""
    made = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            made[name] = _without_halves(value)
        else:
            made[name] = value.float() if "bfloat16" in str(getattr(value, "dtype", "")) else value
    return made


def _unreadable(path: Path, error: Exception) -> UsageProblem:
    if isinstance(error, AttributeError | ModuleNotFoundError):
        return UsageProblem(
            f"{path.name} was written by torch.save of a whole object, whose class is not here ({first_sentence(error)}): in the "
            "script that defines it run torch.jit.script(network).save('policy.pt'), then 'trifarm pack policy.pt'"
        )
    return UsageProblem(
        f"torch cannot read {path.name}: {first_sentence(error)}; is it a checkpoint of torch? Arrays of another library write "
        "with numpy.savez('weights.npz', **arrays) and pack that with --architecture"
    )


def _archive(path: Path, pickled: Path | None, stated: Statement) -> Packing:
    archive = stable_baselines.read(path, pickled)
    recipe = stable_baselines.recipe_of(archive, stated.activation)
    checkpoints.check_width(recipe.parts, stated.manifest, path.name)
    unused = left_over(archive.state, recipe)
    manifest, weights = _made(recipe, stated)
    if archive.policy is not None:
        original: Original = stable_baselines.LibraryOriginal(archive, stated.manifest, stated.scale)
        notes = ()
    else:
        original = TorchOriginal(recipe, stated.manifest, stated.scale, manifest.activation)
        notes = (f"compared with the network rebuilt from its weights, not with the library's own ({archive.why_not})",)
    return Packing(recipe.source, weights, ".safetensors", manifest, original, recipe.normaliser, notes, unused)


def _old_archive(path: Path, stated: Statement) -> Packing:
    tensors, data = stable_baselines2.tensors_of(path)
    recipe = None
    if stated.architecture is None:
        recipe = stable_baselines2.recipe_of(tensors, data, stated.activation, stated.manifest.network_inputs)
    if recipe is None:
        recipe = checkpoints.plain(tensors, stated.architecture, stated.manifest, stated.normaliser, path.name)
    return _rebuilt(recipe, tensors, stated, "sb2")


def _made(recipe: Recipe, stated: Statement) -> tuple[PolicyManifest, bytes]:
    import safetensors.numpy

    manifest = manifest_of(recipe, stated.manifest, stated.scale, stated.activation)
    tensors = {name: values.copy() for name, values in tensors_of(recipe).items()}
    return manifest, safetensors.numpy.save(tensors)


def _program(program: whole.Program, file: str, form: str, stated: Statement) -> Packing:
    whole.check_runs(program, file, stated.manifest)
    manifest = whole.manifest_of(program, stated.manifest, stated.scale)
    unused = program_tensors.unused(program, stated.manifest.network_inputs)
    _check_normalisers(unused, program_tensors.arrays_of(program), stated)
    graph = whole.onnx_of(program, stated.manifest.network_inputs)
    return Packing(form, graph, ".onnx", manifest, whole.ProgramOriginal(program, manifest), unused=unused)


def _check_normalisers(unused: tuple[str, ...], tensors: Mapping[str, Any], stated: Statement) -> None:
    manifest = stated.manifest
    program_tensors.check_normalisers(
        *(unused, tensors, manifest),
        says_actions=stated.action_normaliser is not None,
        says_observations=stated.normaliser is not None or bool(manifest.input_scaling.mean or manifest.input_scaling.low),
    )


def _graph(path: Path, stated: Statement) -> Packing:
    if not onnx_files.keeps_tensors_elsewhere(path):
        raise UsageProblem(
            f"{path.name} is ONNX in one file, which the farm takes as it is: {kinds.next_command(path, stated.manifest)}"
        )
    weights = onnx_files.as_one_file(path)
    after = stated.manifest.output_scaling
    if stated.scale is not None:
        after = after.model_copy(update={"scale": stated.scale})
    manifest = stated.manifest.model_copy(update={"output_scaling": after})
    tensors = onnx_files.tensors_of(weights)
    used = onnx_files.names_used(weights)
    unused = tuple(name for name in tensors if name not in used)
    _check_normalisers(unused, tensors, stated)
    original = onnx_files.GraphOriginal(path, manifest)
    return Packing("onnx with external data", weights, ".onnx", manifest, original, unused=unused)
