"""Policies at the door: what is taken computes what was sent, what cannot be taken is refused with a reason."""

import io
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import safetensors.numpy
from onnx import TensorProto, helper, numpy_helper

from api_schemas.policy import LAYOUTS, ActionKind, InputScaling, OutputScaling, PolicyManifest
from tests.integration.farm_process import services, sha256, small_policy

SHARED = Path(__file__).parents[3] / "shared" / "data" / "policies"
EXPERTS = {"push_expert": "rrc2022-push", "lift_expert": "rrc2022-lift"}


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("policies") / "farm") as running:
        yield running


def graph_of(farm, answer):
    assert answer.status_code in (200, 201), answer.text
    graph = farm.admin.get(f"/v1/policies/{answer.json()['digest']}/graph")
    assert graph.headers["etag"] == f'"{answer.json()["graph_sha256"]}"'
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(graph.content, options, providers=["CPUExecutionProvider"])


def actions(session, observations):
    return np.concatenate([session.run(["action"], {"observation": row[None, :]})[0] for row in observations])


def forward(tensors, manifest, observations):
    """The documented formula in float64."""
    low, high = tensors["observation_low"].astype(float), tensors["observation_high"].astype(float)
    x = 2 * (observations - low) / (high - low) - 1
    spread = np.sqrt(tensors["running_var"].astype(float) + manifest.input_scaling.epsilon)
    y = np.clip((x - tensors["running_mean"]) / spread, -5, 5)
    for index in range(5):
        y = y @ tensors[f"layer{index}.weight"].astype(float).T + tensors[f"layer{index}.bias"]
        if index < 4:
            y = np.where(y > 0, y, np.expm1(np.minimum(y, 0)))
    return np.clip(y, -1, 1) * tensors["torque_limit_nm"]


@pytest.mark.parametrize("name", EXPERTS)
def test_published_experts_compute_the_same_torques(farm, name):
    path = SHARED / f"{name}.safetensors"
    if not path.exists():
        pytest.skip(f"{path.name} is not beside this checkout")
    weights, manifest = path.read_bytes(), LAYOUTS[EXPERTS[name]]
    answer = farm.upload(weights, manifest)
    assert answer.json()["warnings"] == []
    tensors = safetensors.numpy.load(weights)
    low, high = tensors["observation_low"], tensors["observation_high"]
    observations = np.random.default_rng(0).uniform(low, high, (200, len(low))).astype(np.float32)
    given = actions(graph_of(farm, answer), observations)
    assert np.abs(given - forward(tensors, manifest, observations.astype(float))).max() <= 1e-5


def test_the_same_policy_again_is_the_same_policy(farm):
    first, second = (farm.upload(*small_policy(seed=5)) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json()
    assert farm.admin.get(f"/v1/policies/{first.json()['digest']}").json() == first.json()
    assert first.json()["digest"] in [each["digest"] for each in farm.admin.get("/v1/policies").json()["policies"]]


@pytest.mark.parametrize("gone", ["weights_sha256", "graph_sha256", "the graph of another version"])
def test_a_policy_whose_files_are_gone_has_them_again_when_it_is_sent_again(farm, gone):
    first = farm.upload(*small_policy(seed=6)).json()
    if gone == "the graph of another version":
        with closing(sqlite3.connect(farm.data / "farm.sqlite")) as truth, truth:
            truth.execute("UPDATE policy SET graph_sha256 = ? WHERE digest = ?", ("0" * 64, first["digest"]))
    else:
        (farm.data / "files" / "sha256" / first[gone][:2] / first[gone]).unlink()
    again = farm.upload(*small_policy(seed=6))
    assert (again.status_code, again.json()) == (200, first)
    assert graph_of(farm, again).get_inputs()
    for name in (first["weights_sha256"], first["graph_sha256"]):
        assert (farm.data / "files" / "sha256" / name[:2] / name).is_file()


def test_a_policy_may_come_without_its_digest(farm):
    weights, manifest = small_policy(seed=15)
    form = {"files": {"weights": ("w.safetensors", weights)}, "data": {"manifest": manifest.model_dump_json()}}
    first, second = (farm.admin.post("/v1/policies", **form) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json() == farm.upload(weights, manifest).json()
    form["data"]["manifest"] = "{}"
    assert farm.admin.post("/v1/policies", **form).json()["type"] == "/problems/manifest-invalid"
    assert farm.admin.post("/v1/policies", content=b"x").json()["type"] == "/problems/form-incomplete"


def test_a_wrong_digest_is_refused_and_the_right_one_named(farm):
    weights, manifest = small_policy(seed=6)
    answer = farm.admin.put(
        "/v1/policies/" + "0" * 64,
        files={"weights": ("w.safetensors", weights)},
        data={"manifest": manifest.model_dump_json()},
    )
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/digest-mismatch")
    assert len(answer.json()["digest"]) == 64


def refused(farm, weights, manifest, *words, filename="weights.safetensors"):
    answer = farm.upload(weights, manifest, filename=filename)
    assert answer.status_code == 422, answer.text
    for word in words:
        assert word in answer.json()["detail"]


def test_a_refused_upload_leaves_nothing_in_the_store(farm):
    weights, layout = small_policy(seed=7)
    tensors = safetensors.numpy.load(weights) | {"extra": np.zeros(3, np.float32)}
    before = stored(farm)
    refused(farm, safetensors.numpy.save(tensors), layout, "unknown: extra")
    wrong = farm.admin.put(
        "/v1/policies/" + "0" * 64,
        files={"weights": ("w.safetensors", weights)},
        data={"manifest": layout.model_dump_json()},
    )
    assert wrong.status_code == 422
    assert stored(farm) == before
    accepted = farm.upload(weights, layout).json()
    assert stored(farm) - before == {accepted["weights_sha256"], accepted["graph_sha256"]}
    assert (farm.data / "files/sha256" / sha256(weights)[:2] / sha256(weights)).read_bytes() == weights


def stored(farm):
    return {path.name for path in (farm.data / "files").rglob("*") if path.is_file()}


def test_shapes_that_do_not_fit_are_explained(farm):
    weights, _ = small_policy("rrc2022-push")
    refused(farm, weights, LAYOUTS["rrc2022-lift"], "75 numbers", "goal_keypoints_world_m 24", "takes 54", "rrc2022-push with 54")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"extra": np.zeros(3, np.float32)}, "unknown: extra"),
        ({"layer1.bias": None}, "missing: layer1.bias"),
        ({"layer1.bias": np.zeros(8, np.float32)}, "layer1"),
        ({"layer0.bias": np.full(8, np.nan, np.float32)}, "not finite"),
        ({"running_mean": np.zeros(54)}, "both or neither"),
        ({"layer0.bias": np.zeros(8, np.int32)}, "dtype"),
    ],
)
def test_bad_tensors_are_refused(farm, change, word):
    weights, manifest = small_policy()
    tensors = safetensors.numpy.load(weights) | change
    kept = {name: values for name, values in tensors.items() if values is not None}
    refused(farm, safetensors.numpy.save(kept), manifest, word)


@pytest.mark.parametrize("name", ["w.pt", "w.zip", "w.pkl", "w.onnx", ""])
def test_other_files_are_refused_by_name(farm, name):
    weights, manifest = small_policy()
    answer = farm.upload(weights, manifest, filename=name or None)
    assert answer.status_code == 422


@pytest.mark.parametrize("cut", [0, 1, 7, 8, 100, -1])
def test_truncated_weights_are_refused(farm, cut):
    weights, manifest = small_policy()
    refused(farm, weights[:cut], manifest)


def onnx_network(nodes, *, constants=(), columns=54, rows=1, outputs=9, opsets=(("", 17),), ir_version=8, out_shape=None):
    given = helper.make_tensor_value_info("obs", TensorProto.FLOAT, [rows, columns])
    gives = helper.make_tensor_value_info("act", TensorProto.FLOAT, out_shape or [rows, outputs])
    graph = helper.make_graph(nodes, "net", [given], [gives], list(constants))
    opset_imports = [helper.make_opsetid(*each) for each in opsets]
    return helper.make_model(graph, opset_imports=opset_imports, ir_version=ir_version).SerializeToString()


def linear(opset=17, rows=1, columns=54):
    weight = np.random.default_rng(1).normal(0, 0.5, (columns, 9)).astype(np.float32)
    node = helper.make_node("MatMul", ["obs", "w"], ["act"])
    constants = [numpy_helper.from_array(weight, "w")]
    return onnx_network([node], constants=constants, rows=rows, columns=columns, opsets=(("", opset),)), weight


@pytest.mark.parametrize("opset", [7, 9, 11, 13, 17, 21])
@pytest.mark.parametrize("rows", [1, "batch"])
def test_onnx_of_many_opsets_is_scaled_before_and_after(farm, opset, rows):
    network, weight = linear(opset, rows)
    scaling = InputScaling(low=(-2.0,) * 54, high=(3.0,) * 54, mean=(0.1,) * 54, variance=(0.5,) * 54, clip=1.5)
    output = OutputScaling(clip=0.8, scale=tuple(0.1 * n for n in range(1, 10)))
    layout = LAYOUTS["rrc2022-push"]
    manifest = PolicyManifest(observation=layout.observation, input_scaling=scaling, output_scaling=output)
    session = graph_of(farm, farm.upload(network, manifest, filename="p.onnx"))
    observations = np.random.default_rng(2).uniform(-2, 3, (20, 54)).astype(np.float32)
    x = np.clip(((2 * (observations.astype(float) + 2) / 5 - 1) - 0.1) / np.sqrt(0.5 + 1e-5), -1.5, 1.5)
    expected = np.clip(x @ weight, -0.8, 0.8) * output.scale
    assert np.abs(actions(session, observations) - expected).max() < 1e-5


def test_joint_position_policies_take_no_torque_limit(farm):
    weights, layout = small_policy(seed=9)
    manifest = PolicyManifest(observation=layout.observation, action_kind=ActionKind.JOINT_POSITION)
    tensors = safetensors.numpy.load(weights)
    observation = np.full((1, 54), 0.3, np.float32)
    hidden = observation @ tensors["layer0.weight"].T + tensors["layer0.bias"]
    hidden = np.where(hidden > 0, hidden, np.expm1(np.minimum(hidden, 0)))
    expected = hidden @ tensors["layer1.weight"].T + tensors["layer1.bias"]
    assert np.allclose(actions(graph_of(farm, farm.upload(weights, manifest)), observation), expected, atol=1e-6)


def test_onnx_that_is_more_than_a_network_is_refused(farm, tmp_path):
    manifest = LAYOUTS["rrc2022-push"]
    network, _ = linear()
    refused(farm, b"not onnx at all", manifest, filename="p.onnx")
    refused(farm, network[: len(network) // 2], manifest, filename="p.onnx")
    custom = onnx_network([helper.make_node("Evil", ["obs"], ["act"], domain="evil")], opsets=(("", 17), ("evil", 1)))
    refused(farm, custom, manifest, "evil", filename="p.onnx")
    smuggled = onnx_network([helper.make_node("Evil", ["obs"], ["act"], domain="com.microsoft")])
    refused(farm, smuggled, manifest, "com.microsoft", filename="p.onnx")
    model = onnx.load_model_from_string(network)
    onnx.external_data_helper.set_external_data(model.graph.initializer[0], "/etc/passwd")
    refused(farm, model.SerializeToString(), manifest, "one file", filename="p.onnx")
    wrong, _ = linear(columns=40)
    refused(farm, wrong, manifest, "takes 40", "nearest ready-made layout", filename="p.onnx")
    drawn = helper.make_node("RandomNormalLike", ["obs"], ["noise"])
    inside = onnx.load_model_from_string(network).graph.initializer
    noisy = onnx_network([drawn, helper.make_node("MatMul", ["noise", "w"], ["act"])], constants=inside)
    refused(farm, noisy, manifest, "RandomNormalLike", "deterministic mean action", filename="p.onnx")
    old, _ = linear(opset=6)
    refused(farm, old, manifest, "opset 6", filename="p.onnx")


def test_what_the_dry_run_finds_is_refused_with_its_type(farm):
    layout = LAYOUTS["rrc2022-push"].model_copy(update={"output_scaling": OutputScaling(), "input_scaling": InputScaling()})
    for value, slug in ((0.0, "dry-run-constant"), (3e38, "dry-run-not-finite"), (1e3, "dry-run-limits")):
        columns = np.full((54, 9), value, np.float32)
        columns[45:] = 0  # the previous action, which it would add to what it does now
        constants = [numpy_helper.from_array(columns, "w")]
        network = onnx_network([helper.make_node("MatMul", ["obs", "w"], ["act"])], constants=constants)
        answer = farm.upload(network, layout, filename="p.onnx")
        assert (answer.status_code, answer.json()["type"]) == (422, f"/problems/{slug}")
        assert answer.json()["part"] == "the dry run"
        assert answer.json()["instead"]


def test_weights_that_are_no_numbers_are_refused(farm):
    nan = numpy_helper.from_array(np.full((54, 9), np.nan, np.float32), "w")
    broken = onnx_network([helper.make_node("MatMul", ["obs", "w"], ["act"])], constants=[nan])
    refused(farm, broken, LAYOUTS["rrc2022-push"], "tensor 'w'", "not finite", filename="p.onnx")


def endless_network():
    """A loop of 2^62 turns that the runtime carries out node by node."""
    inner = helper.make_graph(
        [
            helper.make_node("Identity", ["go"], ["go_on"]),
            helper.make_node("Sin", ["state"], ["state_next"]),
        ],
        "body",
        [
            helper.make_tensor_value_info("turn", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("state", TensorProto.FLOAT, [1, 9]),
        ],
        [
            helper.make_tensor_value_info("go_on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("state_next", TensorProto.FLOAT, [1, 9]),
        ],
    )
    constants = [
        numpy_helper.from_array(np.ones((54, 9), np.float32), "w"),
        numpy_helper.from_array(np.array(2**62), "turns"),
        numpy_helper.from_array(np.array(True), "yes"),
    ]
    nodes = [
        helper.make_node("MatMul", ["obs", "w"], ["start"]),
        helper.make_node("Loop", ["turns", "yes", "start"], ["act"], body=inner),
    ]
    return onnx_network(nodes, constants=constants)


def test_a_network_that_computes_for_ever_is_refused(farm):
    answer = farm.upload(endless_network(), LAYOUTS["rrc2022-push"], filename="p.onnx")
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/dry-run-too-slow")
    assert "more than 2 s of CPU time" in answer.json()["detail"]


def test_manifests_are_checked(farm):
    weights, _ = small_policy()
    for text in ("", "[]", "{", '{"observation": ["nothing"]}', '{"observation": ["joint_position_rad"], "rate_hz": 7}'):
        answer = farm.admin.put(
            "/v1/policies/" + "0" * 64, files={"weights": ("w.safetensors", io.BytesIO(weights))}, data={"manifest": text}
        )
        assert (answer.status_code, answer.json()["type"]) in {
            (422, "/problems/manifest-invalid"),
            (422, "/problems/form-incomplete"),
        }
