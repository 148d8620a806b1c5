import json
from pathlib import Path

import pytest

from api_schemas.policy import LAYOUTS, MAX_WEIGHTS_BYTES, policy_digest
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.errors import UsageProblem

EMPTY_SHA256_OF_ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "expert.safetensors"
    path.write_bytes(b"abc")
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_digested_with_the_weights(weights, layout):
    policy = read_policy(weights, None, layout)
    assert policy.digest == policy_digest(EMPTY_SHA256_OF_ABC, LAYOUTS[layout])


def test_a_manifest_beside_the_weights_is_found(weights):
    weights.with_suffix(".json").write_text(LAYOUTS["pose"].model_dump_json())
    assert read_policy(weights, None, None).manifest == LAYOUTS["pose"]


def test_a_named_manifest_wins_over_the_one_beside(weights, tmp_path):
    weights.with_suffix(".json").write_text("broken")
    other = tmp_path / "other.json"
    other.write_text(LAYOUTS["keypoints"].model_dump_json())
    assert read_policy(weights, other, None).manifest == LAYOUTS["keypoints"]


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("absent.onnx", None, "there is no file"),
        ("model.pt", b"x", "cannot carry code: .safetensors, .onnx, .zip; "),
        ("model", b"x", "no suffix"),
        ("empty.onnx", b"", "1 to 67108864"),
        ("huge.onnx", b"\0" * (MAX_WEIGHTS_BYTES + 1), "67108865 bytes"),
    ],
)
def test_weights_that_cannot_be_used_are_refused(tmp_path, name, content, says):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UsageProblem, match=says):
        read_policy(tmp_path / name, None, "pose")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nonsense", "not JSON"),
        (json.dumps({"observation": ["colour"]}), "unknown observation field 'colour'"),
        (json.dumps({"observation": ["tracker_delay_s"], "rate_hz": 300}), "rate_hz is 300"),
        (json.dumps({}), "not valid: observation is missing"),
    ],
)
def test_a_manifest_that_cannot_be_used_is_refused(weights, tmp_path, text, says):
    manifest = tmp_path / "manifest.json"
    manifest.write_text(text)
    with pytest.raises(UsageProblem, match=says):
        read_policy(weights, manifest, None)


def test_without_manifest_the_layouts_are_listed(weights):
    with pytest.raises(UsageProblem, match=f"--layout with one of {', '.join(LAYOUTS)}$"):
        read_policy(weights, None, None)


def test_manifest_and_layout_exclude_each_other(weights, tmp_path):
    with pytest.raises(UsageProblem, match="not both"):
        read_policy(weights, tmp_path / "m.json", "pose")


def test_an_unknown_layout_is_refused_with_the_known_ones(weights):
    with pytest.raises(UsageProblem, match="no layout 'rrc2021'; choose from rrc2022-push"):
        read_policy(weights, None, "rrc2021")


def test_an_absent_manifest_is_named(weights, tmp_path):
    with pytest.raises(UsageProblem, match=r"absent\.json: No such file"):
        read_policy(weights, tmp_path / "absent.json", None)


def test_a_layout_given_as_a_manifest_is_recognised(weights):
    with pytest.raises(UsageProblem, match="No such file or directory; push is the name of a layout: did you mean --layout push"):
        read_policy(weights, Path("push"), None)
