"""The policy process of a farm under attack, for measurements alone: ``attacked_farm.py`` puts it in the place of the real one.

A policy attacks if its graph has a tensor whose name says how; every other policy runs as always. To a farm that was not started
for this such a graph is a small network like any other, so that it passes the door and its dry run.
"""

import re
import sys
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

import robot_farm.policy.jailed_policy
from tests.unit.robot_farm.policy.attacking_policy import attack

NAMES = {"spin for ever": "spin", "fork bomb": "fork", "touch 8 GB": "memory", "200 threads": "threads"}
"""The attacks by the words in which a tensor's name says them."""
_MARK = re.compile(rb"attack_(" + "|".join(NAMES.values()).encode() + rb")_here")


def hostile_graph(path: Path, name: str) -> Path:
    """A network that attacks where this module runs it."""
    mark = f"attack_{NAMES[name]}_here"
    weights = np.random.default_rng(0).normal(size=(54, 9)).astype(np.float32) * 0.02
    ends = [helper.make_tensor_value_info(each, TensorProto.FLOAT, [1, size]) for each, size in (("obs", 54), ("act", 9))]
    nodes = [helper.make_node("MatMul", ["obs", mark], ["act"])]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], [numpy_helper.from_array(weights, mark)])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path


def _load(graph: bytes, np, onnxruntime) -> robot_farm.policy.jailed_policy.Act:
    found = _MARK.search(graph)
    if found is None:
        return robot_farm.policy.jailed_policy._load(graph, np, onnxruntime)
    name = next(name for name, word in NAMES.items() if word == found[1].decode())

    def act(_data: bytes):
        attack(name)
        return np.zeros(9, np.float32), 0

    return act


if __name__ == "__main__":
    sys.exit(robot_farm.policy.jailed_policy.main(_load))
