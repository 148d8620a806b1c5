"""A policy that sees and moves everything turned by a third of a circle: another one on each goal, of the same rate.

    python -m tests.benchmarks.turned_policy sim_backend/training/reference_policies/push-adr.safetensors --out turned.onnx

The robot is the same after a third of a turn, with its fingers in another order, and starts and goals of ``push`` lie in every
direction alike. So a policy behind such a turn has its original's rate on the nominal robot, exactly, and on robots that differ
in the mean over all robots; on one goal the two differ. It makes pairs of equal policies for questions that must stay undecided.
"""

import argparse
from pathlib import Path

import numpy as np
from onnx import NodeProto, helper, numpy_helper
from safetensors.numpy import load_file

from api_schemas.observation import term_of
from api_schemas.policy import PolicyManifest
from api_schemas.policy_graph import ACTION, OBSERVATION
from services.policies import graph

THIRD_RAD = 2 * np.pi / 3
BY_FINGER = {"joint_position_rad", "joint_velocity_rad_s", "joint_torque_nm", "previous_action"}
PLACES_BY_FINGER = {"fingertip_position_world_m", "fingertip_velocity_world_m_s", "goal_fingertip_position_world_m"}
PLACES = {"cube_position_world_m", "cube_keypoints_world_m", "goal_position_world_m", "goal_keypoints_world_m"}
UNTURNED = {"tracker_confidence", "tracker_delay_s"}


def turn() -> np.ndarray:
    """About the vertical by a third, shape (3, 3); the second finger comes to lie where the first one is."""
    cos, sin = np.cos(THIRD_RAD), np.sin(THIRD_RAD)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def fingers(each: np.ndarray) -> np.ndarray:
    """The matrix that gives each finger's numbers to the one that it is after the turn, shape (9, 9)."""
    return np.kron(np.roll(np.eye(3), -1, axis=0), each)


def turned_field(field: str, size: int) -> np.ndarray:
    """The matrix that turns a field of an observation, shape (size, size).

    Raises:
        ValueError: a field that is none of places, numbers of joints and what no turn changes.
    """
    if field in BY_FINGER:
        return fingers(np.eye(3))
    if field in PLACES_BY_FINGER:
        return fingers(turn())
    if field in PLACES:
        return np.kron(np.eye(size // 3), turn())
    if field in UNTURNED:
        return np.eye(size)
    raise ValueError(f"{field} cannot be turned; known are {sorted(BY_FINGER | PLACES_BY_FINGER | PLACES | UNTURNED)}")


def turned_observation(manifest: PolicyManifest) -> np.ndarray:
    """The matrix that turns a whole observation, shape (n, n)."""
    terms = [term_of(text) for text in manifest.observation]
    assert all(term.is_whole and term.field for term in terms), "only whole fields are turned"
    parts = [turned_field(term.field or "", term.size) for term in terms]
    whole, at = np.zeros((manifest.observation_size, manifest.observation_size)), 0
    for part in parts:
        whole[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return whole


def turned(weights: Path, out: Path) -> None:
    """Writes the turned policy and its manifest."""
    manifest = PolicyManifest.model_validate_json(weights.with_suffix(".json").read_text())
    model = graph.from_tensors(load_file(weights), manifest)
    inside = {OBSERVATION: "turned_observation", ACTION: "turned_action"}
    nodes = [_renamed(node, inside) for node in model.graph.node]
    before = helper.make_node("MatMul", [OBSERVATION, "turn"], ["turned_observation"])
    after = helper.make_node("MatMul", ["turned_action", "turn_back"], [ACTION])
    matrices = {"turn": turned_observation(manifest).T, "turn_back": fingers(np.eye(3))}
    del model.graph.node[:]
    model.graph.node.extend([before, *nodes, after])
    model.graph.initializer.extend(numpy_helper.from_array(value.astype(np.float32), name) for name, value in matrices.items())
    out.write_bytes(model.SerializeToString())
    plain = PolicyManifest(
        name=f"{manifest.name}-turned",
        observation=manifest.observation,
        action_kind=manifest.action_kind,
        rate_hz=manifest.rate_hz,
        action_delay_s=manifest.action_delay_s,
    )
    out.with_suffix(".json").write_text(plain.model_dump_json(exclude_defaults=True))


def _renamed(node: NodeProto, names: dict[str, str]) -> NodeProto:
    given, gives = ([names.get(name, name) for name in each] for each in (node.input, node.output))
    copy = NodeProto()
    copy.CopyFrom(node)
    del copy.input[:], copy.output[:]
    copy.input.extend(given)
    copy.output.extend(gives)
    return copy


def main() -> None:
    """Writes what is asked for."""
    parser = argparse.ArgumentParser(description="The same policy, turned by a third of a circle.")
    parser.add_argument("policy", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    turned(given.policy, given.out)


if __name__ == "__main__":
    main()
