"""The one form that robots run: input ``observation`` float32 [1, n], output ``action`` float32 [1, 9], one file.

A policy with memory also has its states as inputs, and what they are next as outputs, and one that sees has its images
(``api_schemas/policy_graph.py``).
"""

from collections.abc import Mapping

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, checker, helper

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from api_schemas.policy_graph import ACTION, NEXT, OBSERVATION
from api_schemas.policy_images import IMAGES
from services.policies import network
from services.policies.heads import take_action
from services.policies.memory import STATE, stack_frames
from services.policies.scaling import Chain, Remembered, Scaling, after_network, before_network, scaling_of
from services.policies.uploaded import Uploaded

OPSET = 17
IR_VERSION = 8
"""Old enough for every runtime that a robot may have, new enough for OPSET."""
PRODUCER = "trifarm"


def from_tensors(tensors: Mapping[str, np.ndarray], manifest: PolicyManifest) -> ModelProto:
    """The graph of a network, feed-forward or recurrent, with all that surrounds it.

    Raises:
        UnfitError: weights and manifest do not fit each other.
    """
    checked = network.read(tensors, manifest)
    scaling = scaling_of(manifest, tensors)
    chain = _begin(scaling, manifest)
    network.append(chain, checked, manifest.activation)
    _finish(chain, scaling, manifest)
    return _model(chain, manifest, OPSET, IR_VERSION)


def around(uploaded: Uploaded, manifest: PolicyManifest) -> ModelProto:
    """The graph of an uploaded network with all that surrounds it, at the upload's own opset.

    Raises:
        UnfitError: the scaling does not fit.
    """
    scaling = scaling_of(manifest, {})
    chain = _begin(scaling, manifest)
    chain.node("Identity", [chain.at], uploaded.given)
    if uploaded.sees is not None:
        chain.node("Identity", [IMAGES], uploaded.sees)
    for given, gives, shape in uploaded.states:
        chain.node("Identity", [STATE + given], given)
        chain.remembered.append(Remembered(STATE + given, shape, gives))
    chain.nodes += uploaded.nodes
    chain.constants += uploaded.constants
    shape = helper.make_tensor("action_shape", TensorProto.INT64, [2], [1, manifest.network_outputs])
    chain.at = chain.node("Reshape", [uploaded.gives, "action_shape"], "network_action")
    chain.constants.append(shape)
    _finish(chain, scaling, manifest)
    return _model(chain, manifest, uploaded.opset, uploaded.ir_version)


def _begin(scaling: Scaling, manifest: PolicyManifest) -> Chain:
    chain = Chain([], [], OBSERVATION)
    if scaling.size == manifest.observation_size:
        before_network(scaling, chain)
        stack_frames(chain, manifest)
    else:
        stack_frames(chain, manifest)
        before_network(scaling, chain)
    return chain


def _finish(chain: Chain, scaling: Scaling, manifest: PolicyManifest) -> None:
    take_action(chain, manifest)
    after_network(scaling, chain)
    chain.node("Identity", [chain.at], ACTION)


def _model(chain: Chain, manifest: PolicyManifest, opset: int, ir_version: int) -> ModelProto:
    states = chain.remembered
    nodes: list[NodeProto] = [
        *chain.nodes,
        *(helper.make_node("Identity", [each.following], [NEXT + each.name]) for each in states),
    ]
    given = [_value(OBSERVATION, (1, manifest.observation_size)), *(_value(each.name, each.shape) for each in states)]
    if manifest.images is not None:
        given.append(helper.make_tensor_value_info(IMAGES, TensorProto.UINT8, manifest.images.shape))
    gives = [_value(ACTION, (1, ACTION_SIZE)), *(_value(NEXT + each.name, each.shape) for each in states)]
    graph = helper.make_graph(nodes, "policy", given, gives, chain.constants)
    opsets = [helper.make_opsetid("", opset)]
    model = helper.make_model(graph, opset_imports=opsets, producer_name=PRODUCER, ir_version=ir_version)
    checker.check_model(model)
    return model


def _value(name: str, shape: tuple[int, ...]):
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
