"""The measurement of an attacked farm does attack, and only where its own policy process runs."""

import numpy as np
import pytest

from robot_farm.policy.jail import JailedPolicy, PolicyFailedError
from tests.benchmarks.attacking_robot_policy import hostile_graph
from tests.graphs import linear

OBSERVATION = np.linspace(-1, 1, 54, dtype=np.float32)
ATTACKER = "tests.benchmarks.attacking_robot_policy"


def test_a_hostile_graph_attacks_there_and_is_a_plain_network_elsewhere(tmp_path):
    graph = hostile_graph(tmp_path / "p.onnx", "fork bomb")
    with JailedPolicy("hostile", graph, module=ATTACKER) as policy:
        policy.reset()
        with pytest.raises(PolicyFailedError, match="PermissionError"):
            policy.act(OBSERVATION)
    with JailedPolicy("plain", linear(tmp_path / "plain.onnx"), module=ATTACKER) as policy:
        policy.reset()
        assert np.abs(policy.act(OBSERVATION)[0]).max() > 0
