"""A turned policy acts as its original does in the turned world, is another one on the same goal, and is what a farm takes."""

import numpy as np
import onnxruntime
from safetensors.numpy import load_file

from api_schemas.policy import PolicyManifest
from api_schemas.policy_graph import ACTION, OBSERVATION
from services.policies import graph, uploaded
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from tests import ROOT
from tests.benchmarks.turned_policy import fingers, turn, turned, turned_observation

ADR = ROOT / "sim_backend/training/reference_policies/push-adr.safetensors"


def act(model, seen):
    return onnxruntime.InferenceSession(model).run([ACTION], {OBSERVATION: seen.astype(np.float32)[None]})[0][0]


def test_the_robot_is_the_same_after_a_third_of_a_turn():
    joints = np.random.default_rng(1).uniform(-1, 1, 9)
    there = fingertip_position_world_m(fingers(np.eye(3)) @ joints)
    np.testing.assert_allclose(there, fingers(turn()) @ fingertip_position_world_m(joints), atol=1e-12)


def test_it_acts_as_its_original_does_in_the_turned_world(tmp_path):
    turned(ADR, tmp_path / "turned.onnx")
    manifest = PolicyManifest.model_validate_json(ADR.with_suffix(".json").read_text())
    original = graph.from_tensors(load_file(ADR), manifest).SerializeToString()
    own = PolicyManifest.model_validate_json((tmp_path / "turned.json").read_text())
    taken = graph.around(uploaded.parse((tmp_path / "turned.onnx").read_bytes(), own), own).SerializeToString()
    rng, differ = np.random.default_rng(2), 0.0
    for _ in range(20):
        seen = rng.normal(0, 0.1, manifest.observation_size)
        there = act(original, turned_observation(manifest) @ seen)
        np.testing.assert_allclose(act(taken, seen), fingers(np.eye(3)).T @ there, atol=2e-6)
        differ = max(differ, float(np.abs(act(taken, seen) - act(original, seen)).max()))
    assert differ > 0.05, "N m: it is another policy"
