"""``trifarm pack``: each format goes in as its library writes it, and comes out as a policy that computes the same torques.

Those of rl_games, rsl_rl and skrl are made by hand here, in every key layout that the libraries have published, by modules whose
forward pass is written a second time; what the installed versions save is in ``test_pack_libraries.py``.
"""

import io
import subprocess
import sys
import zipfile

import numpy as np
import onnx
import pytest
import safetensors.numpy
import torch
from torch import nn

from api_schemas.policy import OutputScaling
from client_cli.packing.original import TorchOriginal
from client_cli.packing.reading import Statement, pack_files
from tests.unit.client_cli.packing.checkpoints import RlGames, RslRl, Skrl, TorchLstm, mlp
from tests.unit.client_cli.packing.packed import MANIFEST, SCALE, SIZE, assert_same, pack, packed_actions

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
    assert "it keeps memory to itself" in ended.err
    assert not out.exists()


def test_another_network_than_the_original_is_refused(tmp_path, trifarm, manifest, monkeypatch):
    module, path, out = RlGames(SIZE, "mlp"), tmp_path / "last.pth", tmp_path / "p.safetensors"
    torch.save({"model": module.state_dict()}, path)
    action = TorchOriginal._action
    monkeypatch.setattr(TorchOriginal, "_action", lambda self, outputs: action(self, outputs) + 2e-5)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()))
    assert (ended.code, ended.out) == (1, "")
    assert "differs from the original by up to 2" in ended.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        ({"a.weight": torch.zeros(9, SIZE), "a.bias": torch.zeros(9)}, (), "a (linear 18->9)"),
        ({"a.weight": torch.zeros(9, SIZE), "a.bias": torch.zeros(9)}, ("--architecture", "b"), "no module 'b'; it has a"),
        (
            {"a.weight": torch.zeros(9, 7), "a.bias": torch.zeros(9)},
            ("--architecture", "a"),
            "takes 7 numbers, unnamed gives 18",
        ),
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
    assert stated.code == 0
    assert "is taken" not in stated.err
    unused = ended.document["unused"]
    assert {f"model.a2c_network.{name}" for name in ("sigma", "value.weight", "value.bias")} <= set(unused)
    assert not any("actor_mlp" in name or ".running_mean_std" in name for name in unused), "what is used is not called unused"


@DEPRECATED
def test_a_layout_that_does_not_fit_is_answered_with_the_one_that_does(tmp_path, trifarm):
    path = tmp_path / "push.pt"
    torch.jit.script(mlp(97, 16, 9)).save(path)
    ended = trifarm("pack", str(path), "--layout", "rrc2022-push", "--json")
    assert ended.code == 2
    assert "push.pt takes 97 numbers, rrc2022-push gives 54; rrc2022-push-flat gives 97" in ended.document["error"]["detail"]
    ended = trifarm("pack", str(path), "--layout", "rrc2022-push-flat", "--no-try")
    assert (ended.code, "next: trifarm submit" in ended.out) == (0, True)
    assert (tmp_path / "push.onnx").is_file(), "beside the checkpoint where nobody says where"


@DEPRECATED
def test_a_whole_module_is_packed_as_it_is(tmp_path, trifarm, manifest):
    module, path, out = mlp(SIZE, 16, 9), tmp_path / "module.pt", tmp_path / "p.onnx"
    torch.save(module, path)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert_same(out, module)


def test_a_normaliser_of_actions_is_never_left_out_unsaid(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module, path, out = nn.Module(), *files(tmp_path)
    module.net = mlp(SIZE, 16, 9)
    module.register_buffer("action_mean", torch.linspace(-0.1, 0.1, 9))
    module.register_buffer("action_std", torch.linspace(0.05, 0.2, 9))
    torch.save(module.state_dict(), path)
    asked = manifest(output_scaling={"clip": 1.0})
    options = ("--architecture", "net.0,net.2", "--activation", "elu")
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(asked), *options)
    assert ended.code == 2
    assert "--action-normaliser mean-std:action_mean,action_std" in ended.err
    pack(trifarm, path, out=out, manifest=asked, options=(*options, "--action-normaliser", "mean-std:action_mean,action_std"))
    assert_same(out, lambda x: module.net(x) * module.action_std + module.action_mean, scale=1.0)


@DEPRECATED
def test_onnx_in_two_files_becomes_one(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    module, path, out = mlp(SIZE, 16, 9), tmp_path / "policy.onnx", tmp_path / "p.onnx"
    torch.onnx.export(module, (torch.zeros(1, SIZE),), path, dynamo=False, opset_version=17)
    alone = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()))
    assert (alone.code, "which the farm takes as it is: 'trifarm check policy.onnx" in alone.err) == (2, True)
    where = {"save_as_external_data": True, "location": "weights.bin", "size_threshold": 0}
    onnx.save(onnx.load(path), path, **where)
    pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert_same(out, module)


def test_an_archive_of_stable_baselines2_is_packed(tmp_path, trifarm):
    from tests.benchmarks.foreign_policies import MANIFEST as EXPECTED
    from tests.benchmarks.foreign_policies import old_archive

    (path,), _ = old_archive(tmp_path)
    expected = tmp_path / "robot.json"
    expected.write_text(EXPECTED.model_dump_json())
    out = tmp_path / "p.safetensors"
    wrong = trifarm("pack", str(tmp_path / path), "--manifest", str(expected), "--format", "sb3", "--out", str(out))
    assert (wrong.code, "is an archive of stable-baselines2, not --format sb3" in wrong.err) == (2, True)
    ended = trifarm("pack", str(tmp_path / path), "--manifest", str(expected), "--out", str(out), "--no-try", "--json")
    assert (ended.code, ended.document["source"]) == (0, "stable-baselines2")
    assert "model/pi/logstd:0" in ended.document["unused"]
    given = np.load(io.BytesIO(zipfile.ZipFile(tmp_path / path).read("parameters")))
    observation = np.random.default_rng(0).normal(size=EXPECTED.observation_size).astype(np.float32)
    x = observation
    for layer in ("pi_fc0", "pi_fc1"):
        x = np.tanh(x @ given[f"model/{layer}/w:0"] + given[f"model/{layer}/b:0"])
    wanted = np.clip(x @ given["model/pi/w:0"] + given["model/pi/b:0"], -1, 1)
    np.testing.assert_allclose(packed_actions(out, observation[None, None])[0, 0], wanted, atol=1e-5)


def test_bounds_of_each_joint_are_kept(tmp_path, trifarm):
    """A PPO2 of stable-baselines2 whose joints have bounds of their own, which no single clip says."""
    from tests.benchmarks.foreign_policies import MANIFEST as EXPECTED
    from tests.benchmarks.foreign_policies import old_archive

    low, high = -np.linspace(0.1, 0.5, 9), np.linspace(0.2, 0.36, 9)
    (path,), _ = old_archive(tmp_path, low, high)
    expected, out = tmp_path / "robot.json", tmp_path / "p.safetensors"
    expected.write_text(EXPECTED.model_dump_json())
    words = ("--manifest", str(expected), "--out", str(out), "--no-try", "--json", "--scale", "2")
    ended = trifarm("pack", str(tmp_path / path), *words)
    assert ended.code == 0, ended.err
    assert not any(name.startswith("model/pi.") for name in ended.document["unused"])
    given = np.load(io.BytesIO(zipfile.ZipFile(tmp_path / path).read("parameters")))
    x = observations = np.random.default_rng(0).normal(size=(40, EXPECTED.observation_size)).astype(np.float32)
    for layer in ("pi_fc0", "pi_fc1"):
        x = np.tanh(x @ given[f"model/{layer}/w:0"] + given[f"model/{layer}/b:0"])
    outputs = x @ given["model/pi/w:0"] + given["model/pi/b:0"]
    assert ((outputs < low).any(axis=0) | (outputs > high).any(axis=0)).all(), "every joint meets a bound"
    wanted = 2 * np.clip(outputs, low, high)
    np.testing.assert_allclose(packed_actions(out, observations[None])[0], wanted, atol=2e-5)


def test_bounds_that_are_half_infinite_are_refused(tmp_path, trifarm):
    from tests.benchmarks.foreign_policies import MANIFEST as EXPECTED
    from tests.benchmarks.foreign_policies import old_archive

    (path,), _ = old_archive(tmp_path, -np.ones(9), np.r_[np.inf, np.ones(8)])
    (tmp_path / "robot.json").write_text(EXPECTED.model_dump_json())
    ended = trifarm("pack", str(tmp_path / path), "--manifest", str(tmp_path / "robot.json"), "--no-try")
    assert (ended.code, "finite bounds, or none at all" in ended.err) == (2, True)


@DEPRECATED
def test_two_files_of_one_stem_are_not_written_over_each_other(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    first, second = mlp(SIZE, 8, 9), mlp(SIZE, 8, 9)
    torch.jit.script(first).save(tmp_path / "best.pt")
    torch.jit.script(second).save(tmp_path / "best.jit")
    words = ("pack", str(tmp_path), "--manifest", str(manifest()), "--scale", str(SCALE))
    assert trifarm(*words).code == 0
    assert_same(tmp_path / "packed" / "best-pt.onnx", first)
    assert_same(tmp_path / "packed" / "best-jit.onnx", second)
    ended = trifarm(*words, "--out", str(tmp_path))
    assert (ended.code, "would be written over" in ended.err) == (2, True)


@DEPRECATED
def test_a_folder_is_packed_in_one_go(tmp_path, trifarm, manifest):
    for epoch in (2, 10):
        torch.jit.script(mlp(SIZE, 8, 9)).save(tmp_path / f"ep_{epoch}.pt")
    (tmp_path / "notes.txt").write_text("not a checkpoint")
    (tmp_path / "broken.pt").write_bytes(b"nothing")
    expected = manifest()
    ended = trifarm("pack", str(tmp_path), "--manifest", str(expected), "--json")
    assert (ended.code, ended.document["packed"], ended.document["not_packed"]) == (1, 2, 1)
    assert sorted(path.name for path in (tmp_path / "packed").glob("*.onnx")) == ["ep_10.onnx", "ep_2.onnx"]
    assert "broken.pt: not packed: torch cannot read broken.pt" in ended.err


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("actor.h5", b"\x89HDF\r\n\x1a\n" + bytes(99), "python -m tf2onnx.convert --keras actor.h5"),
        ("params.pkl", b"\x80\x04N.", "numpy.savez('weights.npz', **arrays)"),
        ("weights.pt", b"nothing at all", "is it a checkpoint of torch?"),
    ],
)
def test_a_refusal_names_the_next_command(name, content, words, tmp_path, trifarm, manifest):
    path = tmp_path / name
    path.write_bytes(content)
    ended = trifarm("pack", str(path), "--manifest", str(manifest()))
    assert (ended.code, ended.out) == (2, "")
    assert words in ended.err
    assert len(ended.err.splitlines()) <= 2


class Picking(nn.Module):
    """Takes what it wants from the begin of an observation, however long that is."""

    def __init__(self, width):
        super().__init__()
        self.width, self.network = width, mlp(width, 16, 9)

    def forward(self, seen):
        return self.network(seen[:, : self.width])


@DEPRECATED
@pytest.mark.parametrize(("width", "code"), [(97, 2), (139, 0)])
def test_a_program_that_reads_the_begin_of_a_longer_layout_is_told_the_one_it_is_of(width, code, tmp_path, trifarm):
    path = tmp_path / "mine.pt"
    torch.jit.script(Picking(width)).save(path)
    ended = trifarm("pack", str(path), "--layout", "rrc2022-lift-flat", "--no-try")
    assert ended.code == code, ended.err
    told = "mine.pt reads only the first 97 of the 139 numbers of rrc2022-lift-flat; rrc2022-push-flat gives 97: give --layout"
    assert (told in ended.err) == (width == 97)
    assert path.with_suffix(".onnx").exists() == (code == 0)
