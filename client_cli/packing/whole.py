"""TorchScript, ``torch.export`` programs and whole modules: taken as ONNX graphs, because nobody can name their parts."""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy import ACTION_SIZE, LAYOUTS, PolicyManifest
from api_schemas.policy_network import ActionHead, NetworkState
from client_cli.packing.fitting import layouts_of_width, misfit, reads_begin
from client_cli.packing.original import Stack, scaled_as_stated
from client_cli.packing.quiet import first_sentence, quiet
from client_cli.packing.recipe import Array
from client_cli.terminal.errors import UsageProblem

OPSET = 17
NOTE_FILE = "trifarm.json"
"""An extra file of a TorchScript archive: ``{"states": [[1, 1, 16]]}`` where its maker knows them."""
WIDEST = 512
"""Inputs that a program is tried on to find out how many it takes."""


class Program:
    """A program that takes an observation [1, n], and its states, and gives an action [1, m], and the states' next values.

    Without states its own memory counts, if it has any: ``reset`` is called at the start of a trial, as rsl_rl's exporter
    provides it.
    """

    def __init__(self, module: Any, traced: Any, states: tuple[tuple[int, ...], ...]) -> None:
        self.module, self.traced, self.states = module, traced, states

    def run(self, row: Any, memory: Sequence[Any]) -> tuple[Any, ...]:
        """Everything that it gives for a row of observations, shape (k, n)."""
        import torch

        with torch.no_grad():
            outputs = self.module(row, *memory)
        return tuple(outputs) if isinstance(outputs, tuple | list) else (outputs,)

    def blank(self) -> list[Any]:
        """The states of a trial that begins."""
        import torch

        return [torch.zeros(*shape) for shape in self.states]


def torch_script(path: Path, states: tuple[tuple[int, ...], ...]) -> Program:
    """A TorchScript file; the shapes of its states must be stated where its maker has not written them into it.

    Raises:
        UsageProblem: torch cannot read it.
    """
    import torch

    extra = {NOTE_FILE: ""}
    try:
        with quiet():  # deprecated by torch, but what people have
            module = torch.jit.load(path, map_location="cpu", _extra_files=extra).eval()
    except Exception as error:
        raise UsageProblem(f"torch cannot read {path.name}: {first_sentence(error)}") from error
    noted = json.loads(extra[NOTE_FILE]).get("states", []) if extra[NOTE_FILE] else []
    return Program(module, module, states or tuple(tuple(shape) for shape in noted))


def whole_module(module: Any, states: tuple[tuple[int, ...], ...]) -> Program:
    """What ``torch.save(module)`` wrote."""
    module = module.eval().cpu().float()
    for parameter in module.parameters():
        parameter.requires_grad_(False)
    return Program(module, module, states)


def torch_export(path: Path, manifest: PolicyManifest) -> Program:
    """A ``torch.export`` archive; its states' shapes are those of its example inputs.

    Raises:
        UsageProblem: it was exported for something else than one observation.
    """
    import torch

    try:
        with quiet():
            program = torch.export.load(path)
    except Exception as error:
        raise UsageProblem(f"torch cannot read {path.name}: {first_sentence(error)}") from error
    module = program.module()
    if program.example_inputs is None:
        raise UsageProblem(f"{path.name} has no example inputs; export it again with torch.export.save")
    inputs, _ = program.example_inputs
    shape = tuple(inputs[0].shape)
    if len(shape) != 2 or shape[0] != 1:
        raise UsageProblem(
            f"{path.name} was exported for an input of shape {shape}; export it for (1, {manifest.network_inputs})"
        )
    if shape[1] != manifest.network_inputs:
        raise misfit(path.name, [shape[1]], manifest)
    idle = [node.name for node in program.graph.nodes if node.op == "placeholder" and not node.users]
    unused = [name for name in program.graph_signature.user_inputs if name in idle]
    if unused:
        raise UsageProblem(
            f"the exported program does not use its input {unused[0]!r}; torch takes one tensor that is given twice for one "
            "input: export again with a tensor of its own for each state"
        )
    with quiet():
        traced = torch.jit.trace(module, tuple(inputs), check_trace=False)
    return Program(module, traced, tuple(tuple(each.shape) for each in inputs[1:]))


def check_runs(program: Program, file: str, manifest: PolicyManifest) -> None:
    """Runs the program once on an observation of the manifest's width, before anything is exported.

    Raises:
        UsageProblem: it takes another width, which is named with the layouts that have it, reads only the begin of a ready-made
            layout, as far as another one goes, or gives no action.
    """
    import torch

    try:
        with quiet():
            outputs = program.run(torch.zeros(1, manifest.network_inputs), program.blank())
    except Exception as error:
        raise _why_not(program, file, manifest, error) from error
    if len(outputs) != 1 + len(program.states):
        shapes = ", ".join(str(tuple(getattr(each, "shape", ()))) for each in outputs)
        raise UsageProblem(
            f"{file} gives {len(outputs)} values of shapes {shapes}, and an action and {len(program.states)} states are wanted: "
            "wrap it so that it returns the action alone, or give the shape of each state with --state"
        )
    action = outputs[0]
    if not hasattr(action, "numel"):
        raise UsageProblem(f"{file} gives a {type(action).__name__}; wrap it so that it returns the action as one tensor")
    if action.numel() != manifest.network_outputs:
        wanted = (
            f"an action has {ACTION_SIZE}: one for each joint"
            if manifest.network_outputs == ACTION_SIZE
            else (f"the manifest's head wants {manifest.network_outputs}")
        )
        hint = '; nine means and nine deviations are "head": "gaussian" in the manifest' if action.numel() == 18 else ""
        raise UsageProblem(f"{file} gives {action.numel()} numbers, and {wanted}{hint}")
    _check_reads_all(program, file, manifest)


def _check_reads_all(program: Program, file: str, manifest: PolicyManifest) -> None:
    """A program that picks its part of an observation runs on longer ones, too: a ready-made layout must not be such a one."""
    import torch

    if manifest.observation != getattr(LAYOUTS.get(manifest.name), "observation", None):
        return
    widths = _widths(program, manifest)
    if not layouts_of_width(narrowest := min(widths, default=manifest.network_inputs)) or narrowest == manifest.network_inputs:
        return
    rows = torch.rand(8, 1, manifest.network_inputs, generator=torch.Generator().manual_seed(0))
    with quiet():
        same = all(
            torch.equal(program.run(row, program.blank())[0], program.run(row[:, :narrowest], program.blank())[0]) for row in rows
        )
    if same:
        raise reads_begin(file, narrowest, manifest)


def _why_not(program: Program, file: str, manifest: PolicyManifest, error: Exception) -> UsageProblem:
    widths = _widths(program, manifest)
    if widths:
        return misfit(file, widths, manifest)
    said = first_sentence(error)
    if "missing value for argument" in str(error) or "required positional argument" in str(error):
        return UsageProblem(f"{file} wants more than an observation ({said}); give the shape of each state with --state")
    return UsageProblem(
        f"{file} cannot be run on one observation of shape (1, {manifest.network_inputs}), nor on any other up to {WIDEST} "
        f"numbers ({said}); wrap it in a module whose forward takes (1, n) and returns (1, {ACTION_SIZE}), and script that"
    )


def _widths(program: Program, manifest: PolicyManifest) -> list[int]:
    """Widths on which it runs: the layouts' first, then all; several where it takes parts of what it is given."""
    import torch

    known = sorted({layout.network_inputs for layout in LAYOUTS.values() if layout.images is None})
    found = []
    for width in (*known, *(each for each in range(1, WIDEST + 1) if each not in known)):
        if found and width not in known:
            break
        if _gives(program, torch.zeros(1, width)) == manifest.network_outputs:
            found.append(width)
    return sorted(found)


def _gives(program: Program, row: Any) -> int | None:
    """How many numbers it gives for a row, None if it fails on it."""
    try:
        with quiet():
            return int(program.run(row, program.blank())[0].numel())
    except Exception:
        return None


def onnx_of(program: Program, takes: int) -> bytes:
    """The program as a single-file graph with the inputs ``observation``, ``state0`` … and outputs ``action``, ``state0_next`` …

    Raises:
        UsageProblem: torch cannot export it.
    """
    import torch

    numbers = range(len(program.states))
    inputs = (torch.zeros(1, takes), *program.blank())
    names = {
        "input_names": ["observation", *(f"state{index}" for index in numbers)],
        "output_names": ["action", *(f"state{index}_next" for index in numbers)],
    }
    file = io.BytesIO()
    try:
        with quiet():
            torch.onnx.export(program.traced, inputs, file, dynamo=False, opset_version=OPSET, **names)  # pyrefly: ignore[bad-argument-type]
    except Exception as error:
        raise UsageProblem(
            f"torch cannot export the program to ONNX ({first_sentence(error)}); the operators that the farm takes are listed in "
            "docs/policies.md: write the network with those, or pack its state_dict with --architecture"
        ) from error
    return file.getvalue()


def manifest_of(program: Program, wanted: PolicyManifest, scale: float | None) -> PolicyManifest:
    """The user's manifest with the program's states and the stated scale."""
    states = (
        NetworkState(input=f"state{index}", output=f"state{index}_next", shape=shape)
        for index, shape in enumerate(program.states)
    )
    after = wanted.output_scaling if scale is None else wanted.output_scaling.model_copy(update={"scale": scale})
    return wanted.model_copy(update={"states": tuple(states), "output_scaling": after})


class ProgramOriginal:
    """The program in torch, between the scaling that the manifest states."""

    def __init__(self, program: Program, packed: PolicyManifest) -> None:
        self._program, self._manifest, self._stack = program, packed, Stack(packed)
        self.begin()

    def begin(self) -> None:
        """Begin a trial."""
        self._memory = self._program.blank()
        self._stack.begin()
        if hasattr(self._program.module, "reset"):
            self._program.module.reset()

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        scaling = self._manifest.input_scaling
        lengths = [len(each) for each in (scaling.low, scaling.mean) if each]
        if lengths and lengths[0] != observation.size:
            row = scaled_as_stated(self._stack(observation), scaling)
        else:
            row = self._stack(scaled_as_stated(observation, scaling))
        import torch

        action, *self._memory = self._program.run(torch.from_numpy(row.astype(np.float32))[None], self._memory)
        return finished(action.detach().numpy().astype(np.float64).ravel(), self._manifest)

    def batch(self, observations: Array) -> Array | None:
        """Actions (k, 9) for observations (k, n) in one call; None for a program with memory, or one that takes one at a time."""
        import torch

        if self._program.states or self._manifest.frame_stack is not None:
            return None
        rows = np.stack([scaled_as_stated(row, self._manifest.input_scaling) for row in observations]).astype(np.float32)
        try:
            with quiet():
                outputs = self._program.run(torch.from_numpy(rows), ())[0].detach().numpy().astype(np.float64)
            return np.stack([finished(row.ravel(), self._manifest) for row in outputs.reshape(len(rows), -1)])
        except Exception:
            return None


def finished(outputs: Array, manifest: PolicyManifest) -> Array:
    """An action (9,) from a program's outputs, as the manifest says."""
    after, bins = manifest.output_scaling, manifest.bins
    values = outputs[:ACTION_SIZE]
    if manifest.head is ActionHead.BINS and bins is not None:
        values = outputs.reshape(ACTION_SIZE, bins).argmax(1) * 2 / (bins - 1) - 1
    values = np.tanh(values) if after.squash else values
    values = values if after.clip is None else np.clip(values, -after.clip, after.clip)
    return values * np.asarray(1.0 if after.scale is None else after.scale) + np.asarray(after.offset or 0.0)
