"""The dry run: what it feeds a policy, and what it refuses before a robot has to."""

import numpy as np
import onnxruntime
import pytest
import safetensors.numpy
from onnx import TensorProto, helper, numpy_helper

from api_schemas.policy import LAYOUTS, ActionKind, OutputScaling, PolicyManifest
from api_schemas.policy_network import Cell
from services.errors import Refused
from services.policies import dry_run, graph, uploaded
from services.policies.jailed_conversion import convert
from services.policies.recorded import recorded_trials
from services.policies.unfit import UnfitError
from tests.graphs import endless
from tests.unit.robot_farm.test_memory import tensors

PUSH = LAYOUTS["rrc2022-push"]
SMALL = OutputScaling(clip=1.0, scale=0.3)


def layers(manifest, bias=0.0, size=0.3):
    weight = np.random.default_rng(3).normal(0, size, (9, manifest.network_inputs)).astype(np.float32)
    return {"layer0.weight": weight, "layer0.bias": np.full(9, bias, np.float32)}


def session_of(weights, manifest):
    content = graph.from_tensors(weights, manifest).SerializeToString()
    return onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])


def tried(weights, manifest):
    return dry_run.run(session_of(weights, manifest), manifest)


def refusal(weights, manifest):
    with pytest.raises(UnfitError) as error:
        tried(weights, manifest)
    return error.value


class Watched:
    """A session that remembers what it was given."""

    def __init__(self, session):
        self.session, self.given, self.gave = session, [], []

    def get_inputs(self):
        return self.session.get_inputs()

    def run(self, names, given):
        self.given.append(given)
        self.gave.append(self.session.run(names, given))
        return self.gave[-1]


def test_a_policy_is_asked_as_a_robot_asks_it():
    """Trial by trial, with its own last action among what it sees and its memory, which each trial begins without."""
    manifest = PUSH.model_copy(update={"recurrent": Cell.LSTM, "output_scaling": SMALL})
    watched = Watched(session_of(tensors(6, 4), manifest))
    assert dry_run.run(watched, manifest) == []
    steps = [trial.steps for trial in recorded_trials()]
    assert len(watched.given) == sum(steps)
    begins = set(np.cumsum([0, *steps[:-1]]).tolist())
    states = [name for name in watched.given[0] if name != "observation"]
    for index, given in enumerate(watched.given):
        action, *memory = [np.zeros(9)] + [np.zeros(1)] * len(states) if index in begins else watched.gave[index - 1]
        np.testing.assert_array_equal(given["observation"][0, -9:], np.ravel(action).astype(np.float32))
        for name, before in zip(states, memory, strict=True):
            np.testing.assert_array_equal(given[name], np.broadcast_to(before, given[name].shape))
    seen = np.concatenate([given["observation"][:, :9] for given in watched.given])
    recorded = np.concatenate([trial.fields["joint_position_rad"] for trial in recorded_trials()])
    np.testing.assert_array_equal(seen, recorded)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_plain_network_of_each_layout_passes(layout):
    manifest = LAYOUTS[layout].model_copy(update={"output_scaling": SMALL})
    assert tried(layers(manifest), manifest) == []


@pytest.mark.parametrize("changes", [{"head": "gaussian"}, {"head": "bins", "bins": 11}, {"frame_stack": {"count": 3}}])
def test_so_does_one_with_another_head_or_a_stack(changes):
    manifest = PolicyManifest.model_validate(PUSH.model_dump() | {"output_scaling": SMALL.model_dump()} | changes)
    rng = np.random.default_rng(4)
    weights = {
        "layer0.weight": rng.normal(0, 0.3, (manifest.network_outputs, manifest.network_inputs)).astype(np.float32),
        "layer0.bias": np.zeros(manifest.network_outputs, np.float32),
    }
    assert tried(weights, manifest) == []


@pytest.mark.parametrize("bias", [0.0, 0.2])
def test_an_action_that_is_always_the_same_is_refused(bias):
    error = refusal(layers(PUSH, bias, size=0.0), PUSH)
    assert error.slug == "dry-run-constant"
    assert f"the same action on 150 different observations: [{bias}" in error.why


def test_so_is_one_that_always_saturates():
    manifest = PUSH.model_copy(update={"output_scaling": SMALL})
    error = refusal(layers(manifest, bias=1e4), manifest)
    assert error.slug == "dry-run-constant"
    assert "output that always saturates" in error.instead


def test_rounding_is_no_variation():
    assert refusal(layers(PUSH, 0.2, size=1e-8), PUSH).slug == "dry-run-constant"
    assert tried(layers(PUSH, 0.2, size=1e-4), PUSH) == []


def test_torques_that_no_motor_has_are_refused():
    """What ±1 meant in the training was left out, and the policy mostly asks for much."""
    error = refusal(layers(PUSH, size=30.0), PUSH.model_copy(update={"output_scaling": OutputScaling(clip=1.0)}))
    assert error.slug == "dry-run-limits"
    assert "-1 to 1 N m" in error.why
    assert "-0.4 to 0.4 N m" in error.why
    assert "scale" in error.instead


def test_torques_that_are_too_much_now_and_then_are_told_and_clipped():
    (warning,) = tried(layers(PUSH, size=0.05), PUSH)
    assert "robots clip them" in warning
    assert "N m" in warning


@pytest.mark.parametrize(
    ("kind", "fits", "degrees"),
    [(ActionKind.JOINT_POSITION, [0.3, 0.9, -1.5], [20.0, 60.0, -90.0]), (ActionKind.JOINT_POSITION_DELTA, [0.0] * 3, [5.0] * 3)],
)
def test_positions_are_held_to_the_joints_limits(kind, fits, degrees):
    manifest = PUSH.model_copy(update={"action_kind": kind, "output_scaling": OutputScaling()})
    weights = layers(PUSH, size=0.005)
    assert tried(weights | {"layer0.bias": np.tile(fits, 3).astype(np.float32)}, manifest) == []
    error = refusal(weights | {"layer0.bias": np.tile(degrees, 3).astype(np.float32)}, manifest)
    assert error.slug == "dry-run-limits"
    assert "rad" in error.why


def test_numbers_that_become_infinite_are_refused():
    manifest = PolicyManifest(observation=PUSH.observation)
    error = refusal({"layer0.weight": np.full((9, 54), 3e38, np.float32), "layer0.bias": np.zeros(9, np.float32)}, manifest)
    assert error.slug == "dry-run-not-finite"
    assert "actions on recorded observations are not finite" in error.why


def slow_network(size, rounds):
    """Multiplies a square matrix of ``size`` so many times for one action."""
    given = helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 54])
    gives = helper.make_tensor_value_info("act", TensorProto.FLOAT, [1, 9])
    rng = np.random.default_rng(0)
    square = rng.normal(0, size**-0.5, (size, size)).astype(np.float32)
    constants = [numpy_helper.from_array(rng.normal(size=(54, 9)).astype(np.float32) * 0.01, "w")]
    constants += [numpy_helper.from_array(square, "m"), numpy_helper.from_array(np.zeros(1, np.float32), "zero")]
    # It depends on the observation, so that nothing of it is computed beforehand, and adds nothing.
    nodes = [helper.make_node("ReduceMean", ["obs"], ["mean"], keepdims=0), helper.make_node("Mul", ["m", "mean"], ["m0"])]
    nodes += [helper.make_node("MatMul", [f"m{index}", "m"], [f"m{index + 1}"]) for index in range(rounds)]
    nodes += [
        helper.make_node("ReduceMean", [f"m{rounds}"], ["sum"], keepdims=0),
        helper.make_node("Mul", ["sum", "zero"], ["none"]),
    ]
    nodes += [helper.make_node("MatMul", ["obs", "w"], ["x"]), helper.make_node("Add", ["x", "none"], ["act"])]
    network = helper.make_graph(nodes, "net", [given], [gives], constants)
    return helper.make_model(network, opset_imports=[helper.make_opsetid("", 17)], ir_version=8).SerializeToString()


def test_the_rate_decides_what_is_too_slow():
    """A network of some 10 ms is refused at 1000 Hz and taken at 4 Hz."""
    manifest = PolicyManifest(observation=PUSH.observation, rate_hz=1000)
    content = graph.around(uploaded.parse(slow_network(400, 4), manifest), manifest).SerializeToString()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    with pytest.raises(UnfitError, match=r"ms of CPU time, the control period is 1 ms") as error:
        dry_run.run(session, manifest)
    assert error.value.slug == "dry-run-too-slow"
    assert dry_run.run(session, manifest.model_copy(update={"rate_hz": 4})) == []


async def refused_by_the_child(tmp_path, name, content, manifest):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(Refused) as error:
        await convert(path, manifest, tmp_path, 60)
    assert {"file", "part", "instead"} <= set(error.value.members)
    return error.value


async def test_one_that_never_ends_is_stopped_and_refused(tmp_path):
    content = endless(tmp_path / "e.onnx").read_bytes()
    error = await refused_by_the_child(tmp_path, "w.onnx", content, PUSH)
    assert error.slug == "dry-run-too-slow"
    assert "2 s of CPU time" in error.detail


async def test_the_child_says_what_the_dry_run_found(tmp_path):
    content = safetensors.numpy.save(layers(PUSH, size=0.0))
    assert (await refused_by_the_child(tmp_path, "w.safetensors", content, PUSH)).slug == "dry-run-constant"
