"""Policies with memory at the door of real services: converted, kept under their own digest, refused with a reason."""

import json

import numpy as np
import onnxruntime
import pytest
import safetensors.numpy

from api_schemas.policy import LAYOUTS, PolicyManifest
from api_schemas.policy_graph import GraphRunner
from tests.integration.farm_process import services
from tests.unit.robot_farm.test_memory import OBSERVATIONS, tensors


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("memory") / "farm") as running:
        yield running


def manifest(**changes):
    return PolicyManifest.model_validate(json.loads(LAYOUTS["rrc2022-push"].model_dump_json()) | changes)


def test_a_recurrent_policy_is_kept_and_its_graph_remembers(farm):
    weights, asked = safetensors.numpy.save(tensors(12, 3)), manifest(recurrent="gru", output_scaling={"clip": 1.0, "scale": 0.3})
    answer = farm.upload(weights, asked)
    assert answer.status_code == 201, answer.text
    assert answer.json()["warnings"] == []
    assert PolicyManifest.model_validate(answer.json()["manifest"]) == asked
    graph = farm.admin.get(f"/v1/policies/{answer.json()['digest']}/graph")
    policy = GraphRunner(onnxruntime.InferenceSession(graph.content, providers=["CPUExecutionProvider"]))
    first, second = (policy.act(OBSERVATIONS[:1]) for _ in range(2))
    policy.forget()
    np.testing.assert_array_equal(policy.act(OBSERVATIONS[:1]), first)
    assert np.abs(first - second).max() > 1e-3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "a file with memory needs recurrent in its manifest"),
        ({"recurrent": "lstm"}, "recurrent layer 0 has shapes"),
        ({"recurrent": "gru", "head": "bins", "bins": 11}, "needs 99"),
        ({"recurrent": "gru", "frame_stack": {"count": 2}}, "stacked 2 times 108"),
    ],
)
def test_what_does_not_fit_is_refused(farm, changes, words):
    answer = farm.upload(safetensors.numpy.save(tensors(12, 3)), manifest(**changes))
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
