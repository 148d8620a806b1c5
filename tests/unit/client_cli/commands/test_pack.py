"""``trifarm pack``: each format goes in as its library writes it, and comes out as a policy that computes the same torques.

Those of rl_games, rsl_rl and skrl are made by hand here, in every key layout that the libraries have published, by modules whose
forward pass is written a second time; what the installed versions save is in ``test_pack_libraries.py``.
"""

import subprocess
import sys

import numpy as np
import pytest
import safetensors.numpy
import torch
from torch import nn

from api_schemas.policy import OutputScaling
from client_cli.packing.original import TorchOriginal
from client_cli.packing.reading import Statement, pack_files
from tests.unit.client_cli.packing.checkpoints import RlGames, RslRl, Skrl, TorchLstm, mlp
from tests.unit.client_cli.packing.packed import MANIFEST, SCALE, SIZE, assert_same, pack

DEPRECATED = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:.*assigned during export:UserWarning")
"""What torch says of TorchScript, which people have all the same, and of exporting its own nn.LSTM."""


@pytest.mark.parametrize("kind", ["mlp", "lstm-after", "gru-before", "bins"])
def test_rl_games(kind, tmp_path, trifarm, manifest):
    module, path, out = RlGames(SIZE, kind), tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": module.state_dict(), "epoch": 7, "last_mean_rewards": np.float32(3.0), "env_state": None}, path)
    asked = pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert (asked.bins, asked.recurrent) == (
        11 if kind == "bins" else None,
        {"lstm-after": "lstm", "gru-before": "gru"}.get(kind),
    )
    assert_same(out, module)


@pytest.mark.parametrize("kind", ["mlp", "lstm", "gru", "since-4", "normaliser-apart"])
def test_rsl_rl(kind, tmp_path, trifarm, manifest):
    module, path, out = RslRl(SIZE, kind), tmp_path / "model_100.pt", tmp_path / "p.safetensors"
    torch.save(module.checkpoint(), path)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert_same(out, module)


@pytest.mark.parametrize("kind", ["mlp", "shared", "lstm"])
def test_skrl(kind, tmp_path, trifarm, manifest):
    module, path, out = Skrl(SIZE, kind), tmp_path / "agent_100.pt", tmp_path / "p.safetensors"
    torch.save(module.checkpoint(), path)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert_same(out, module)


def test_a_state_dict_with_a_stated_architecture(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module, path, out = nn.ModuleDict({"critic": mlp(SIZE, 8, 1), "pi": mlp(SIZE, 32, 9, activation=nn.Tanh)}), *files(tmp_path)
    torch.save(module.state_dict(), path)
    asked = manifest(output_scaling={"scale": SCALE, "clip": 1.0})
    pack(trifarm, path, out=out, manifest=asked, options=("--architecture", "pi.0,pi.2", "--activation", "tanh"))
    assert_same(out, lambda x: module["pi"](x).clamp(-1, 1))


def files(tmp_path):
    return tmp_path / "weights.pt", tmp_path / "p.safetensors"


@DEPRECATED
@pytest.mark.parametrize("stack", [None, {"count": 3, "order": "newest_first"}])
def test_torch_script(stack, tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module = mlp(SIZE * (3 if stack else 1), 32, 9, activation=nn.Tanh)  # only ELU never asks for gradients
    path, out = tmp_path / "policy.pt", tmp_path / "p.onnx"
    torch.jit.script(module).save(path)
    pack(trifarm, path, out=out, manifest=manifest(frame_stack=stack), options=("--scale", str(SCALE)))

    def stacked(trial):
        rows = torch.cat([trial[:1], trial[:1], trial])
        return module(torch.cat([rows[2:], rows[1:-1], rows[:-2]], 1) if stack else trial)

    assert_same(out, stacked)


@DEPRECATED
@pytest.mark.parametrize("exported", [False, True])
def test_a_program_with_states(exported, tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module, out = TorchLstm(SIZE), tmp_path / "p.onnx"
    path, zero = tmp_path / ("policy.pt2" if exported else "policy.pt"), (torch.zeros(1, 1, 16), torch.zeros(1, 1, 16))
    if exported:
        torch.export.save(torch.export.export(module, (torch.zeros(1, SIZE), *zero)), path)
    else:
        torch.jit.script(module).save(path)
    states = () if exported else ("--state", "1,1,16", "--state", "1,1,16")
    asked = pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE), *states))
    assert [state.shape for state in asked.states] == [(1, 1, 16)] * 2
    assert_same(out, module.whole_trial)


def test_an_exported_program_without_states(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module, path, out = mlp(SIZE, 32, 18), tmp_path / "policy.pt2", tmp_path / "p.onnx"
    torch.export.save(torch.export.export(module, (torch.zeros(1, SIZE),)), path)
    pack(trifarm, path, out=out, manifest=manifest(head="gaussian"), options=("--scale", str(SCALE)))
    assert_same(out, lambda trial: module(trial)[:, :9])


@DEPRECATED
def test_a_program_exported_with_one_tensor_for_two_states_is_refused(tmp_path, trifarm, manifest):
    path, zero = tmp_path / "policy.pt2", torch.zeros(1, 1, 16)
    torch.export.save(torch.export.export(TorchLstm(SIZE), (torch.zeros(1, SIZE), zero, zero)), path)
    ended = trifarm("pack", str(path), "--out", str(tmp_path / "p.onnx"), "--manifest", str(manifest()))
    assert ended.code == 2
    assert "a tensor of its own for each state" in ended.err


@DEPRECATED
def test_a_program_that_hides_its_memory_is_refused(tmp_path, trifarm, manifest):
    """A graph keeps no buffers between calls: what rsl_rl's exporter writes must be packed from its checkpoint instead."""

    class Hidden(nn.Module):
        def __init__(self):
            super().__init__()
            self.cell, self.last = nn.GRU(SIZE, 8), nn.Linear(8, 9)
            self.register_buffer("hidden_state", torch.zeros(1, 1, 8))

        def forward(self, x):
            y, h = self.cell(x[None], self.hidden_state)
            self.hidden_state[:] = h
            return self.last(y[0])

    path, out = tmp_path / "policy.pt", tmp_path / "p.onnx"
    torch.jit.script(Hidden()).save(path)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()))
    assert ended.code == 1
    assert "Memory that a program keeps to itself" in ended.err
    assert not out.exists()


def test_another_network_than_the_original_is_refused(tmp_path, trifarm, manifest, monkeypatch):
    module, path, out = RlGames(SIZE, "mlp"), tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": module.state_dict()}, path)
    act = TorchOriginal.act
    monkeypatch.setattr(TorchOriginal, "act", lambda self, observation: act(self, observation) + 2e-5)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()))
    assert (ended.code, ended.out) == (1, "")
    assert "differs from the original by up to 2" in ended.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        ({"a.weight": torch.zeros(9, SIZE), "a.bias": torch.zeros(9)}, (), "a (linear 18->9)"),
        ({"a.weight": torch.zeros(9, SIZE), "a.bias": torch.zeros(9)}, ("--architecture", "b"), "no module 'b'; it has a"),
        ({"a.weight": torch.zeros(9, 7), "a.bias": torch.zeros(9)}, ("--architecture", "a"), "of 18 numbers: a (linear 7->9)"),
        ({"a.weight": torch.zeros(8, SIZE), "a.bias": torch.zeros(8)}, ("--architecture", "a"), "network gives 8 numbers"),
        ({"a.weight": torch.zeros(9, SIZE), "a.bias": torch.full((9,), torch.nan)}, ("--architecture", "a"), "not finite"),
        ({"model": {"a2c_network.value.weight": torch.zeros(1, 3)}}, (), "no actor that can be packed"),
        ([1, 2], (), "holds a list"),
        ({}, ("--activation", "gelu"), "choose from elu, relu, tanh"),
        ({}, ("--format", "zip"), "choose from auto, sb3"),
        ({}, ("--state", "one"), "is not a shape"),
    ],
)
def test_what_cannot_be_packed_is_said(content, options, words, tmp_path, trifarm, manifest):
    path, out = files(tmp_path)
    torch.save(content, path)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), *options)
    assert ended.code == 2, ended.err
    assert words in ended.err
    assert not out.exists()


def test_torch_is_missed_with_one_clear_line(tmp_path):
    hidden = "import sys; sys.modules['torch'] = None; import importlib.util; find = importlib.util.find_spec; "
    hidden += "importlib.util.find_spec = lambda name, *rest: None if name == 'torch' else find(name, *rest); "
    arguments = ["pack", str(tmp_path / "a.pt"), "--out", str(tmp_path / "a.safetensors"), "--layout", "pose"]
    code = f"{hidden}from client_cli.main import run; run({arguments!r})"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "pip install -e '.[learning]' in the clone" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_other_commands_never_load_torch():
    code = "import sys; import client_cli.main; print('torch' in sys.modules, 'client_cli.packing' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["False", "False"]


def test_the_tensors_of_an_mlp_are_the_ones_of_the_documented_form(tmp_path, trifarm, manifest):
    module, path, out = RlGames(SIZE, "mlp"), tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": module.state_dict()}, path)
    asked = pack(trifarm, path, out=out, manifest=manifest())
    tensors = safetensors.numpy.load_file(out)
    assert sorted(tensors) == ["layer0.bias", "layer0.weight", "layer1.bias", "layer1.weight", "running_mean", "running_var"]
    assert asked.output_scaling == OutputScaling(clip=1.0)
    statement = Statement(MANIFEST)
    assert pack_files([path], statement).weights == out.read_bytes(), "the same file packs to the same bytes"


def test_names_of_compiled_modules_and_bfloat16_are_read(tmp_path, trifarm, manifest):
    module, path, out = RlGames(SIZE, "mlp"), tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": {f"_orig_mod.{name}": value for name, value in module.state_dict().items()}}, path)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert_same(out, module)
    torch.save({name: value.bfloat16() for name, value in mlp(SIZE, 9).state_dict().items()}, path)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--architecture", "0"))


def test_the_activation_that_was_taken_is_said(tmp_path, trifarm, manifest):
    path, out = tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": RlGames(SIZE, "mlp").state_dict()}, path)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), "--json")
    assert "elu is taken" in ended.err
    assert ended.document["source"] == "rl_games"
    stated = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), "--activation", "elu")
    assert (stated.code, stated.err) == (0, "")
