import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from api_schemas.policy import LAYOUTS
from services.policies.randomness import DRAWING
from services.policies.unfit import UnfitError
from services.policies.uploaded import parse

MANIFEST = LAYOUTS["rrc2022-push"]
WEIGHT = numpy_helper.from_array(np.ones((54, 9), np.float32), "w")


def flag(value, name="flag"):
    return numpy_helper.from_array(np.array(value), name)


def network(*nodes, constants=(), functions=(), inner=()):
    """A linear network whose result goes through the nodes, from ``raw`` to ``act``; ``inner`` lie in branches of an If."""
    given = helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 54])
    gives = helper.make_tensor_value_info("act", TensorProto.FLOAT, [1, 9])
    body = [helper.make_node("MatMul", ["obs", "w"], ["raw"]), *nodes]
    if inner:
        branch = helper.make_graph(inner, "branch", [], [helper.make_tensor_value_info("act_in", TensorProto.FLOAT, [1, 9])])
        body.append(helper.make_node("If", ["yes"], ["act"], then_branch=branch, else_branch=branch))
    graph = helper.make_graph(body, "net", [given], [gives], [WEIGHT, flag(True, "yes"), *constants])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], functions=functions).SerializeToString()


def refused(content, *words):
    with pytest.raises(UnfitError) as raised:
        parse(content, MANIFEST)
    for word in words:
        assert word in str(raised.value)


@pytest.mark.parametrize("operator", sorted(DRAWING))
def test_operators_that_draw_are_refused_at_any_depth(operator):
    words = (f"operator {operator} draws random numbers", "deterministic mean action")
    refused(network(helper.make_node(operator, ["raw"], ["act"])), *words)
    refused(network(inner=[helper.make_node(operator, ["raw"], ["act_in"])]), *words)
    deeper = helper.make_graph([helper.make_node(operator, ["raw"], ["act_in"])], "deeper", [], [])
    refused(network(inner=[helper.make_node("If", ["yes"], ["act_in"], then_branch=deeper, else_branch=deeper)]), *words)


def test_operators_that_draw_are_refused_in_a_loop_and_with_a_seed():
    body = helper.make_graph([helper.make_node("RandomNormalLike", ["raw"], ["act_in"], seed=1.0)], "body", [], [])
    refused(network(helper.make_node("Loop", ["", "yes", "raw"], ["act"], body=body)), "operator RandomNormalLike")
    refused(network(helper.make_node("Scan", ["raw"], ["act"], body=body, num_scan_inputs=1)), "operator RandomNormalLike")


def test_local_functions_are_refused_whatever_is_in_them():
    node = helper.make_node("RandomNormalLike", ["x"], ["y"])
    function = helper.make_function("", "Relu", ["x"], ["y"], [node], [helper.make_opsetid("", 17)])
    refused(network(helper.make_node("Relu", ["raw"], ["act"]), functions=[function]), "its own functions")


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize(
    ("node", "constants"),
    [
        (helper.make_node("Dropout", ["raw", "ratio", "flag"], ["out"]), [flag(True)]),
        (helper.make_node("Dropout", ["raw", "", "flag"], ["out"]), []),
        (helper.make_node("BatchNormalization", ["raw", *"smbv"], ["out"], training_mode=1), []),
        (helper.make_node("BatchNormalization", ["raw", *"smbv"], ["out", "mean"]), []),
    ],
)
def test_training_mode_is_refused(node, constants, inside):
    last = helper.make_node("Identity", ["out"], ["act_in" if inside else "act"])
    content = network(constants=constants, inner=[node, last]) if inside else network(node, last, constants=constants)
    refused(content, f"operator {node.op_type} is in training mode", "deterministic mean action")


def test_a_name_that_is_false_in_one_place_only_is_not_trusted():
    inner = [
        helper.make_node("Not", ["yes"], ["flag"]),
        helper.make_node("Dropout", ["raw", "", "flag"], ["act_in"]),
    ]
    refused(network(constants=[flag(False)], inner=inner), "operator Dropout")


@pytest.mark.parametrize(
    ("nodes", "constants"),
    [
        ([helper.make_node("Dropout", ["raw"], ["act"])], []),
        ([helper.make_node("Dropout", ["raw", "", "flag"], ["act"])], [flag(False)]),
        (
            [
                helper.make_node("Constant", [], ["flag"], value=flag([False])),
                helper.make_node("Dropout", ["raw", "", "flag"], ["act"]),
            ],
            [],
        ),
        ([helper.make_node("BatchNormalization", ["raw", *"smbv"], ["act"])], []),
    ],
)
def test_what_does_nothing_outside_training_is_taken(nodes, constants):
    assert parse(network(*nodes, constants=constants), MANIFEST).gives == "network/act"
