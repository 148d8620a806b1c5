"""TorchScript and ``torch.export`` programs: taken whole, as ONNX graphs, because nobody can name their parts."""

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from api_schemas.policy_network import ActionHead, NetworkState
from client_cli.packing.original import Stack, scaled_as_stated
from client_cli.packing.recipe import Array
from client_cli.terminal.errors import UsageProblem

OPSET = 17


class Program:
    """A program that takes an observation [1, n], and its states, and gives an action [1, m], and the states' next values.

    Without states its own memory counts, if it has any: ``reset`` is called at the start of a trial, as rsl_rl's exporter
    provides it.
    """

    def __init__(self, module: Any, traced: Any, states: tuple[tuple[int, ...], ...]) -> None:
        self.module, self.traced, self.states = module, traced, states


def torch_script(path: Path, states: tuple[tuple[int, ...], ...]) -> Program:
    """A TorchScript file; the shapes of its states must be stated, because it does not say them."""
    import torch

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecated by torch, but what people have
        module = torch.jit.load(path, map_location="cpu").eval()
    return Program(module, module, states)


def torch_export(path: Path, takes: int) -> Program:
    """A ``torch.export`` archive; its states' shapes are those of its example inputs.

    Raises:
        UsageProblem: it was exported for something else than one observation.
    """
    import torch

    program = torch.export.load(path)
    module = program.module()
    if program.example_inputs is None:
        raise UsageProblem(f"{path.name} has no example inputs; export it again with torch.export.save")
    inputs, _ = program.example_inputs
    if tuple(inputs[0].shape) != (1, takes):
        raise UsageProblem(f"{path.name} was exported for an input of shape {tuple(inputs[0].shape)}; export it for (1, {takes})")
    idle = [node.name for node in program.graph.nodes if node.op == "placeholder" and not node.users]
    unused = [name for name in program.graph_signature.user_inputs if name in idle]
    if unused:
        raise UsageProblem(
            f"the exported program does not use its input {unused[0]!r}; torch takes one tensor that is given twice for one "
            "input: export again with a tensor of its own for each state"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        traced = torch.jit.trace(module, tuple(inputs), check_trace=False)
    return Program(module, traced, tuple(tuple(each.shape) for each in inputs[1:]))


def onnx_of(program: Program, takes: int) -> bytes:
    """The program as a single-file graph with the inputs ``observation``, ``state0`` … and outputs ``action``, ``state0_next`` …

    Raises:
        UsageProblem: torch cannot export it.
    """
    import torch

    numbers = range(len(program.states))
    inputs = (torch.zeros(1, takes), *(torch.zeros(*shape) for shape in program.states))
    names = {
        "input_names": ["observation", *(f"state{index}" for index in numbers)],
        "output_names": ["action", *(f"state{index}_next" for index in numbers)],
    }
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            torch.onnx.export(program.traced, inputs, file, dynamo=False, opset_version=OPSET, **names)  # pyright: ignore[reportArgumentType]
        except Exception as error:
            raise UsageProblem(f"torch cannot export the program to ONNX: {str(error)[:500]}") from error
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
        import torch

        self._memory = [torch.zeros(*shape) for shape in self._program.states]
        self._stack.begin()
        if hasattr(self._program.module, "reset"):
            self._program.module.reset()

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        import torch

        scaling = self._manifest.input_scaling
        lengths = [len(each) for each in (scaling.low, scaling.mean) if each]
        if lengths and lengths[0] != observation.size:
            row = scaled_as_stated(self._stack(observation), scaling)
        else:
            row = self._stack(scaled_as_stated(observation, scaling))
        with torch.no_grad():
            outputs = self._program.module(torch.from_numpy(row.astype(np.float32))[None], *self._memory)
        action, *self._memory = outputs if isinstance(outputs, tuple | list) else (outputs,)
        return self._finished(action.detach().numpy().astype(np.float64).ravel())

    def _finished(self, outputs: Array) -> Array:
        after, bins = self._manifest.output_scaling, self._manifest.bins
        values = outputs[:ACTION_SIZE]
        if self._manifest.head is ActionHead.BINS and bins is not None:
            values = outputs.reshape(ACTION_SIZE, bins).argmax(1) * 2 / (bins - 1) - 1
        values = np.tanh(values) if after.squash else values
        values = values if after.clip is None else np.clip(values, -after.clip, after.clip)
        return values * np.asarray(1.0 if after.scale is None else after.scale) + np.asarray(after.offset or 0.0)
