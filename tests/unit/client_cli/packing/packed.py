"""What the tests of ``trifarm pack`` share: the manifest, the command, and what the farm makes of the packed files."""

import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import safetensors.numpy
import torch

from api_schemas.policy import MAX_WEIGHTS_BYTES, PolicyManifest, canonical_json
from api_schemas.policy_graph import GraphRunner
from client_cli.packing import comparison
from services.policies import conversion, graph, uploaded
from services.policies.unfit import UnfitError

MANIFEST = PolicyManifest(observation=("joint_position_rad", "joint_velocity_rad_s"))
SIZE = 18
SCALE = 0.36
TRIALS, STEPS = 4, 25
OBSERVATIONS = np.random.default_rng(1).normal(size=(TRIALS, STEPS, SIZE)).astype(np.float32) * 2


def converted_here(weights, suffix, manifest):
    """The graph that the farm's own program makes, in this process; `test_the_example_packs` starts that program."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(conversion, "_say", lambda **_: None)
        patch.setattr(conversion.signal, "setitimer", lambda *_: None)
        out = Path(folder) / "graph.onnx"
        with suppress(UnfitError):  # of the dry run, which pack does not ask for either once the graph is there
            conversion.convert(weights, suffix, canonical_json(manifest), out, MAX_WEIGHTS_BYTES)
        return out.read_bytes()


def pack(trifarm, *files, out, manifest, options=()):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison, "converted", converted_here)
        ended = trifarm(*("pack", *map(str, files), "--out", str(out), "--manifest", str(manifest)), *options)
    assert ended.code == 0, ended.err
    difference = float(ended.out.split("observations: ")[1].split()[0])
    assert difference <= 1e-5
    assert "N m" in ended.out
    print(f"{files[0].name}: {difference:.2g} N m")
    return PolicyManifest.model_validate_json(out.with_suffix(".json").read_text())


def packed_actions(out, observations=OBSERVATIONS):
    """What the farm's graph of the packed files gives in each trial, shape (trials, steps, 9)."""
    asked = PolicyManifest.model_validate_json(out.with_suffix(".json").read_text())
    content = out.read_bytes()
    if out.suffix == ".onnx":
        model = graph.around(uploaded.parse(content, asked), asked)
    else:
        model = graph.from_tensors(safetensors.numpy.load(content), asked)
    policy = GraphRunner(onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"]))
    trials = []
    for trial in observations:
        policy.forget()
        trials.append(np.concatenate([policy.act(row[None]) for row in trial]))
    return np.stack(trials)


def assert_same(out, module, scale=SCALE):
    """The packed files against a module that takes a whole trial (steps, n) and gives (steps, 9), by hand and not by pack."""
    with torch.no_grad():
        wanted = np.stack([module(torch.from_numpy(trial)).numpy() for trial in OBSERVATIONS]) * scale
    assert np.abs(wanted).max() > 0.05
    assert np.abs(packed_actions(out) - wanted).max() <= 1e-5
