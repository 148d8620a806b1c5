"""Small ONNX policies that behave in a chosen way, made for the tests."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


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


def no_number(path: Path, *, inputs: int = 54) -> Path:
    """Finite weights whose actions are the root of a negative number."""
    nodes = [
        helper.make_node("MatMul", ["observation", "w"], ["x"]),
        helper.make_node("Add", ["x", "b"], ["below"]),
        helper.make_node("Sqrt", ["below"], ["action"]),
    ]
    weights, bias = np.zeros((inputs, 9), np.float32), np.full((1, 9), -1.0, np.float32)
    return _model(nodes, [_tensor("w", weights), _tensor("b", bias)], inputs, path)


def endless(path: Path, *, inputs: int = 54) -> Path:
    """Adds up one number for ever (2^62 rounds)."""
    body = helper.make_graph(
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
    nodes = [
        helper.make_node("MatMul", ["observation", "w"], ["start"]),
        helper.make_node("Loop", ["rounds", "go", "start"], ["action"], body=body),
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
