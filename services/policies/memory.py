"""What a graph remembers of a trial: the last observations of a stack, and the states of recurrent layers."""

import numpy as np
from onnx import GraphProto, TensorProto, ValueInfoProto

from api_schemas.policy import PolicyManifest
from services.policies.scaling import Chain, Remembered
from services.policies.unfit import UnfitError

STATE = "state/"
"""Before the names of a graph's states; those of uploaded graphs and those made here do not meet."""


def stack_frames(chain: Chain, manifest: PolicyManifest) -> None:
    """Goes on from one observation to the stack of the last ones, as one row.

    Nothing but operators that are the same in every opset: one state for each observation that is kept, and where the first is
    to stand for those before it, one number that is 0 in the first call and 1 in the others.
    """
    stack, present, size = manifest.frame_stack, chain.at, manifest.observation_size
    if stack is None:
        return
    kept = [f"{STATE}frame{index}" for index in range(stack.count - 1)]  # the oldest first
    following = [*kept[1:], present]
    seen = kept
    if stack.fill == "first":
        seen = [_filled(chain, name, present) for name in kept]
        following = [*seen[1:], present]
        one = chain.constant("stack_one", np.ones((1, 1), np.float32))
        chain.remembered.append(Remembered(f"{STATE}begun", (1, 1), one))
    chain.remembered += [Remembered(name, (1, size), after) for name, after in zip(kept, following, strict=True)]
    row = [*seen, present] if stack.order == "oldest_first" else [present, *reversed(seen)]
    chain.at = chain.node("Concat", row, "stacked", axis=1)


def _filled(chain: Chain, frame: str, present: str) -> str:
    """The kept observation, or the present one where nothing is kept yet: 0 · kept + 1 · present, exactly."""
    if not any(node.output[0] == "stack_empty" for node in chain.nodes):
        chain.constant("stack_full", np.ones((1, 1), np.float32))
        chain.node("Sub", ["stack_full", f"{STATE}begun"], "stack_empty")
        chain.node("Mul", [present, "stack_empty"], "stack_fill")
    kept = chain.node("Mul", [frame, f"{STATE}begun"], f"{frame}_kept")
    return chain.node("Add", [kept, "stack_fill"], f"{frame}_seen")


def check_states(graph: GraphProto, manifest: PolicyManifest) -> None:
    """Raises unless an uploaded graph has the states that its manifest declares, in float32 and of their shapes.

    Raises:
        UnfitError: names the state and what the graph has instead.
    """
    if manifest.recurrent is not None:
        raise UnfitError("recurrent is for safetensors; an ONNX file's memory is declared with states: input, output and shape")
    inputs, outputs = ({each.name: each for each in ends} for ends in (graph.input, graph.output))
    for state in manifest.states:
        for name, known, end in ((state.input, inputs, "input"), (state.output, outputs, "output")):
            if name not in known:
                raise UnfitError(f"the manifest's state {name!r} is no {end} of the graph; it has {', '.join(known) or 'none'}")
            _check_shape(known[name], state.shape)


def _check_shape(value: ValueInfoProto, shape: tuple[int, ...]) -> None:
    kind = value.type.tensor_type
    if kind.elem_type != TensorProto.FLOAT:
        raise UnfitError(f"state {value.name!r} must be float32")
    has = [each.dim_value if each.HasField("dim_value") else None for each in kind.shape.dim]
    known = kind.HasField("shape")
    if known and (len(has) != len(shape) or any(real not in (None, want) for real, want in zip(has, shape, strict=True))):
        raise UnfitError(f"state {value.name!r} has shape {has}, the manifest says {list(shape)}")
