"""The one form that robots run: input ``observation`` float32 [1, n], output ``action`` float32 [1, 9], one file."""

from collections.abc import Mapping

import numpy as np
from onnx import ModelProto, TensorProto, checker, helper

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from services.policies import network
from services.policies.scaling import after_network, before_network, scaling_of
from services.policies.uploaded import Uploaded

OPSET = 17
IR_VERSION = 8
"""Old enough for every runtime that a robot may have, new enough for OPSET."""
PRODUCER = "trifarm"


def from_tensors(tensors: Mapping[str, np.ndarray], manifest: PolicyManifest) -> ModelProto:
    """The graph of an MLP with its scaling.

    Raises:
        UnfitError: weights and manifest do not fit each other.
    """
    pairs = network.layers(tensors, manifest)
    scaling = scaling_of(manifest, tensors)
    before = before_network(scaling, manifest.observation_size, "observation")
    nodes, constants, given = network.nodes(pairs, manifest.activation, before.at)
    after = after_network(scaling, given)
    end = helper.make_node("Identity", [after.at], ["action"])
    return _model(
        [*before.nodes, *nodes, *after.nodes, end],
        [*before.constants, *constants, *after.constants],
        manifest.observation_size,
        [helper.make_opsetid("", OPSET)],
        IR_VERSION,
    )


def around(uploaded: Uploaded, manifest: PolicyManifest) -> ModelProto:
    """The graph of an uploaded network with the manifest's scaling around it, at the upload's own opset.

    Raises:
        UnfitError: the scaling does not fit.
    """
    scaling, size = scaling_of(manifest, {}), manifest.observation_size
    before = before_network(scaling, size, "observation")
    join = helper.make_node("Identity", [before.at], [uploaded.given])
    shape = helper.make_tensor("action_shape", TensorProto.INT64, [2], [1, ACTION_SIZE])
    flat = helper.make_node("Reshape", [uploaded.gives, "action_shape"], ["network_action"])
    after = after_network(scaling, "network_action")
    end = helper.make_node("Identity", [after.at], ["action"])
    return _model(
        [*before.nodes, join, *uploaded.nodes, flat, *after.nodes, end],
        [*before.constants, *uploaded.constants, shape, *after.constants],
        size,
        [helper.make_opsetid("", uploaded.opset)],
        uploaded.ir_version,
    )


def _model(nodes: list, constants: list, size: int, opsets: list, ir_version: int) -> ModelProto:
    given = helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, size])
    gives = helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, ACTION_SIZE])
    graph = helper.make_graph(nodes, "policy", [given], [gives], constants)
    model = helper.make_model(graph, opset_imports=opsets, producer_name=PRODUCER, ir_version=ir_version)
    checker.check_model(model)
    return model
