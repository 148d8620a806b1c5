"""Uploads of policies that see: converted and tried on recorded images, and what does not fit is said."""

import json

import numpy as np
import pytest
from onnx import TensorProto

from api_schemas.policy import LAYOUTS, canonical_json
from api_schemas.policy_graph import GraphRunner
from api_schemas.policy_images import PolicyImages
from services.policies import conversion, dry_run, recorded
from services.policies.unfit import UnfitError
from tests.graphs import linear, seeing

SEES = LAYOUTS["images"]


def converted(path, folder, manifest=SEES):
    out = folder / "graph.onnx"
    conversion.convert(path.read_bytes(), path.suffix, canonical_json(manifest), out, 2**20)
    return GraphRunner(dry_run.load(out))


@pytest.mark.parametrize("edge", [270, 54])
def test_a_policy_that_sees_is_converted_and_acts_on_what_it_sees(tmp_path, edge, capsys):
    manifest = SEES.model_copy(update={"images": PolicyImages(input="eyes", shape=(3, edge, edge, 3))})
    policy = converted(seeing(tmp_path / "p.onnx", edge_px=edge, name="eyes"), tmp_path, manifest)
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == {"warnings": []}
    images = np.zeros((3, edge, edge, 3), np.uint8)
    images[1, ..., 2] = 255
    action = policy.act(np.zeros((1, 44), np.float32), images)
    np.testing.assert_allclose(action[0], [0, 0, 0, 0, 0, 0.3, 0, 0, 0], atol=1e-6)
    with pytest.raises(ValueError, match="only the robots of a farm"):
        policy.act(np.zeros((1, 44), np.float32))


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (
            {"edge_px": 135},
            r"takes uint8 of shape \[3, 135, 135, 3\]; the manifest's images are uint8 of shape \[3, 270",
        ),
        ({"kind": TensorProto.FLOAT}, r"'images' takes float of shape"),
        ({"name": "eyes"}, r"go to 'images', which is no input of the graph; it has observation, eyes"),
        ({"inputs": 54}, r"44 numbers .* but the network takes 54; the nearest ready-made layout is images"),
    ],
)
def test_a_graph_that_does_not_take_the_manifests_images_is_refused(tmp_path, made, says):
    with pytest.raises(UnfitError, match=says):
        converted(seeing(tmp_path / "p.onnx", **made), tmp_path)


def test_other_forms_of_weights_cannot_see(tmp_path):
    (path := tmp_path / "p.safetensors").write_bytes(b"\x02\x00\x00\x00\x00\x00\x00\x00{}")
    with pytest.raises(UnfitError, match="safetensors are of a network that takes an observation alone"):
        converted(path, tmp_path)


def test_a_graph_with_images_that_the_manifest_does_not_name_is_told_how(tmp_path):
    blind = SEES.model_copy(update={"images": None})
    with pytest.raises(UnfitError, match="2 inputs") as caught:
        converted(seeing(tmp_path / "p.onnx"), tmp_path, blind)
    assert "images.input 'images'" in caught.value.instead


def test_a_policy_without_images_is_no_other_for_the_images_of_others(tmp_path):
    policy = converted(linear(tmp_path / "p.onnx"), tmp_path, LAYOUTS["rrc2022-push"])
    assert not policy.sees


def test_recorded_images_are_scenes_with_a_cube():
    for edge in (270, 90, 30):
        seen = recorded.recorded_images(edge)
        assert all(each.shape == (3, edge, edge, 3) and each.dtype == np.uint8 for each in seen)
        assert len({each.tobytes() for each in seen}) == len(seen) > 2
        assert min(each.max(axis=-1).astype(int).std() for each in seen) > 20, "they show something"
