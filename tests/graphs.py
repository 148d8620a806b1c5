"""Small ONNX policies that behave in a chosen way, made for the tests."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json

GOOD_ACTIONS = 60
"""More than an upload's dry run asks for in a row."""


def _model(nodes, initializers, inputs: int, path: Path) -> Path:
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, inputs])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 9])],
        initializers,
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path


def _tensor(name: str, value) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(value), name)


def linear(path: Path, *, inputs: int = 54, seed: int = 0, bias: float = 0.0) -> Path:
    """Random weights; ``bias`` may be NaN."""
    weights = np.random.default_rng(seed).normal(size=(inputs, 9)).astype(np.float32) * 0.1
    nodes = [
        helper.make_node("MatMul", ["observation", "w"], ["x"]),
        helper.make_node("Tanh", ["x"], ["y"]),
        helper.make_node("Add", ["y", "b"], ["action"]),
    ]
    return _model(nodes, [_tensor("w", weights), _tensor("b", np.full((1, 9), bias, np.float32))], inputs, path)


def seeing(path: Path, *, inputs: int = 44, edge_px: int = 270, name: str = "images", kind: int = TensorProto.UINT8) -> Path:
    """A policy that sees: nine joint torques that grow with the red, green and blue of the three views, 0.3 N m at the most.

    What it reads of the observation is next to nothing, so that it is the images that move the robot.
    """
    shape = [3, edge_px, edge_px, 3]
    nodes = [
        helper.make_node("Cast", [name], ["bright"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["bright"], ["of_each"], axes=[1, 2], keepdims=0),
        helper.make_node("Reshape", ["of_each", "row"], ["means"]),
        helper.make_node("Mul", ["means", "share"], ["seen"]),
        helper.make_node("MatMul", ["observation", "w"], ["felt"]),
        helper.make_node("Add", ["seen", "felt"], ["action"]),
    ]
    given = [_tensor("row", np.array([1, 9])), _tensor("share", np.float32(0.3 / 255))]
    graph = helper.make_graph(
        nodes,
        "policy",
        [
            helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, inputs]),
            helper.make_tensor_value_info(name, kind, shape),
        ],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 9])],
        [*given, _tensor("w", np.full((inputs, 9), 1e-6, np.float32))],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path


def _doubling() -> onnx.GraphProto:
    """The body of a loop: one addition, and on."""
    return helper.make_graph(
        [
            helper.make_node("Identity", ["go_in"], ["go_out"]),
            helper.make_node("Add", ["sum_in", "sum_in"], ["sum_out"]),
        ],
        "round",
        [
            helper.make_tensor_value_info("round", TensorProto.INT64, []),
            helper.make_tensor_value_info("go_in", TensorProto.BOOL, []),
            helper.make_tensor_value_info("sum_in", TensorProto.FLOAT, [1, 9]),
        ],
        [
            helper.make_tensor_value_info("go_out", TensorProto.BOOL, []),
            helper.make_tensor_value_info("sum_out", TensorProto.FLOAT, [1, 9]),
        ],
    )


def endless(path: Path, *, inputs: int = 54) -> Path:
    """Adds up one number for ever (2^62 rounds)."""
    nodes = [
        helper.make_node("MatMul", ["observation", "w"], ["start"]),
        helper.make_node("Loop", ["rounds", "go", "start"], ["action"], body=_doubling()),
    ]
    initializers = [
        _tensor("w", np.zeros((inputs, 9), np.float32)),
        _tensor("rounds", np.array(2**62)),
        _tensor("go", np.array(True)),
    ]
    return _model(nodes, initializers, inputs, path)


def memory_hog(path: Path, *, inputs: int = 54, gigabytes: int = 64) -> Path:
    """Asks for far more memory than a policy may have."""
    floats = gigabytes * 2**28
    nodes = [
        helper.make_node("ReduceSum", ["observation"], ["one"], keepdims=0),
        helper.make_node("Expand", ["one", "huge"], ["wide"]),
        helper.make_node("ReduceMax", ["wide"], ["top"], keepdims=0),
        helper.make_node("Expand", ["top", "nine"], ["action"]),
    ]
    return _model(nodes, [_tensor("huge", np.array([floats])), _tensor("nine", np.array([1, 9]))], inputs, path)


def long_error(path: Path, *, inputs: int = 54) -> Path:
    """Fails when it runs, with an error that quotes a name of several thousand characters."""
    nodes = [
        helper.make_node("ReduceSum", ["observation"], ["one"], keepdims=0),
        helper.make_node("Cast", ["one"], ["index"], to=TensorProto.INT64),
        helper.make_node("Add", ["index", "far"], ["beyond"]),
        helper.make_node("Gather", ["nine", "beyond"], ["picked"], name="n" * 5000),
        helper.make_node("Cast", ["picked"], ["number"], to=TensorProto.FLOAT),
        helper.make_node("Expand", ["number", "shape"], ["action"]),
    ]
    initializers = [
        _tensor("far", np.array(10**6)),
        _tensor("nine", np.arange(9)),
        _tensor("shape", np.array([1, 9])),
    ]
    return _model(nodes, initializers, inputs, path)


def _in_time(path: Path, late, initializers) -> Path:
    """A good policy until it has acted ``GOOD_ACTIONS`` times, which it counts; from then on ``late`` decides.

    ``late`` are nodes that make ``fault`` of ``beyond``, shape (1, 1): how many actions beyond those. Its manifest lies beside.
    """
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size]) for name, size in (("observation", 54), ("n", 1))]
    gives = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size]) for name, size in (("action", 9), ("n_next", 1))]
    weights = np.random.default_rng(0).normal(size=(54, 9)).astype(np.float32) * 0.1
    nodes = [
        helper.make_node("Add", ["n", "one"], ["n_next"]),
        helper.make_node("Sub", ["n_next", "good"], ["beyond"]),
        *late,
        helper.make_node("Mul", ["fault", "nothing"], ["none"]),
        helper.make_node("MatMul", ["observation", "w"], ["x"]),
        helper.make_node("Tanh", ["x"], ["y"]),
        helper.make_node("Add", ["y", "none"], ["action"]),
    ]
    numbers = {"one": 1.0, "good": float(GOOD_ACTIONS), "nothing": 0.0}
    constants = [_tensor(name, np.full((1, 1), number, np.float32)) for name, number in numbers.items()]
    graph = helper.make_graph(nodes, "policy", ends, gives, [*constants, _tensor("w", weights), *initializers])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    states = [{"input": "n", "output": "n_next", "shape": [1, 1]}]
    manifest = PolicyManifest.model_validate(LAYOUTS["rrc2022-push"].model_dump() | {"states": states})
    path.with_suffix(".json").write_text(canonical_json(manifest))
    return path


def no_number_in_time(path: Path) -> Path:
    """Its weights are finite, and so are its first actions; then comes the root of a negative number."""
    return _in_time(path, [helper.make_node("Neg", ["beyond"], ["left"]), helper.make_node("Sqrt", ["left"], ["fault"])], [])


def endless_in_time(path: Path) -> Path:
    """Its first actions are quick; then it adds up one number for ever."""
    late = [
        helper.make_node("Relu", ["beyond"], ["late"]),
        helper.make_node("Mul", ["late", "many"], ["long"]),
        helper.make_node("Cast", ["long"], ["wide"], to=TensorProto.INT64),
        helper.make_node("Reshape", ["wide", "scalar"], ["rounds"]),
        helper.make_node("Loop", ["rounds", "go", "start"], ["fault"], body=_doubling()),
    ]
    initializers = [
        _tensor("many", np.full((1, 1), 2.0**50, np.float32)),
        _tensor("scalar", np.array([], np.int64)),
        _tensor("go", np.array(True)),
        _tensor("start", np.zeros((1, 9), np.float32)),
    ]
    return _in_time(path, late, initializers)
