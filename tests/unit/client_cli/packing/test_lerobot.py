"""What LeRobot's own ACT does, kept with the program that our exporter made of it there, and what pack makes of that program.

Both files come from ``tests/benchmarks/lerobot_policies.py`` and ``client_cli/packing/lerobot_export.py`` with lerobot 0.4.4; the
program's notes on its sources are taken out.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch

from tests.unit.client_cli.packing.packed import pack, packed_actions

KEPT = Path(__file__).parent / "lerobot"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_packed_act_does_what_lerobot_does(tmp_path, trifarm, manifest):
    torch.set_num_threads(1)
    out = tmp_path / "p.onnx"
    with np.load(KEPT / "act.npz") as file:
        kept = dict(file)
    asked = pack(trifarm, KEPT / "act.pt", out=out, manifest=manifest())
    assert [state.shape[0] for state in asked.states] == [1, 1], "the queue of planned actions, and the place in it"
    assert kept["actions"].std(axis=(0, 1)).min() > 1e-3
    np.testing.assert_allclose(packed_actions(out, kept["observations"]), kept["actions"], atol=1e-5)


@pytest.mark.parametrize(
    ("kind", "reason"),
    [("diffusion", "draws new noise"), ("vqbet", "draws codes at random"), ("smolvla", "sees images"), ("new", "only 'act' is")],
)
def test_kinds_that_fit_no_graph_are_refused_with_the_reason(kind, reason, tmp_path, trifarm, manifest):
    folder = tmp_path / "policy"
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"type": kind, "input_features": {}}))
    safetensors.torch.save_file({"model.weight": torch.zeros(2)}, folder / "model.safetensors")
    ended = trifarm("pack", str(folder), "--manifest", str(manifest()))
    assert (ended.code, reason in ended.err, "torch.jit.script" in ended.err) == (2, True, True), ended.err
    assert len(ended.err.splitlines()) == 1
