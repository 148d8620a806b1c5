"""``trifarm pack``: each format goes in as its library writes it, and comes out as a policy that computes the same torques.

rl_games, rsl_rl, skrl and sb3-contrib are not installed here: their checkpoints are made by hand in the key layout that they
publish, by modules whose forward pass is written here a second time.
"""

import json
import subprocess
import sys

import numpy as np
import onnxruntime
import pytest
import safetensors.numpy
import torch
from torch import nn

from api_schemas.policy import OutputScaling, PolicyManifest
from api_schemas.policy_graph import GraphRunner
from client_cli.packing import stable_baselines
from client_cli.packing.original import TorchOriginal
from client_cli.packing.reading import Statement, pack_files
from services.policies import graph, uploaded
from tests.unit.client_cli.checkpoints import RlGames, RslRl, Skrl, TorchLstm, mlp

DEPRECATED = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:.*assigned during export:UserWarning")
"""What torch says of TorchScript, which people have all the same, and of exporting its own nn.LSTM."""
MANIFEST = PolicyManifest(observation=("joint_position_rad", "joint_velocity_rad_s"))
SIZE = 18
SCALE = 0.36
TRIALS, STEPS = 4, 25
OBSERVATIONS = np.random.default_rng(1).normal(size=(TRIALS, STEPS, SIZE)).astype(np.float32) * 2


@pytest.fixture
def manifest(tmp_path):
    def write(**changes):
        path = tmp_path / "wanted.json"
        path.write_text(PolicyManifest.model_validate(json.loads(MANIFEST.model_dump_json()) | changes).model_dump_json())
        return path

    return write


def pack(trifarm, *files, out, manifest, options=()):
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
    module, path, out = mlp(SIZE * (3 if stack else 1), 32, 9), tmp_path / "policy.pt", tmp_path / "p.onnx"
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
    assert "pip install 'trifarm[learning]'" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_other_commands_never_load_torch():
    code = "import sys; import client_cli.main; print('torch' in sys.modules, 'client_cli.packing' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["False", "False"]


def contrib_archive(path, lstm):
    """What sb3-contrib's RecurrentPPO saves, as far as it is read: an LSTM before the actor's layers."""
    import io
    import zipfile

    state = {f"lstm_actor.{name}": value for name, value in lstm["lstm"].state_dict().items()}
    state |= {f"mlp_extractor.policy_net.{name}": value for name, value in lstm["net"].state_dict().items()}
    state |= {f"action_net.{name}": value for name, value in lstm["last"].state_dict().items()}
    weights = io.BytesIO()
    torch.save(state, weights)
    space = {"low": str(-np.ones(9)), "high": str(np.ones(9)), ":serialized:": "AAAA"}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("policy.pth", weights.getvalue())
        archive.writestr("data", json.dumps({"action_space": space, "use_sde": False, "policy_kwargs": {}}))


def test_recurrent_ppo_of_sb3_contrib_by_its_keys(tmp_path, trifarm, manifest):
    torch.manual_seed(0)
    parts = {"lstm": nn.LSTM(SIZE, 16), "net": mlp(16, 24, 24, activation=nn.Tanh, last=True), "last": nn.Linear(24, 9)}
    path, out = tmp_path / "model.zip", tmp_path / "p.safetensors"
    contrib_archive(path, parts)
    asked = pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert (asked.recurrent, asked.activation) == ("lstm", "tanh")
    assert_same(out, lambda trial: parts["last"](parts["net"](parts["lstm"](trial)[0])).clamp(-1, 1))


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG", "bins"])
def test_stable_baselines(algorithm, tmp_path, trifarm, manifest):
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    from tests.unit.client_cli.toy_env import ToyEnv

    torch.manual_seed(0)
    normalised = VecNormalize(DummyVecEnv([lambda: ToyEnv(SIZE, bins=algorithm == "bins")]))
    settings = {"n_steps": 16} if algorithm in ("PPO", "A2C", "bins") else {"learning_starts": 4, "buffer_size": 100}
    settings |= {"batch_size": 16} if algorithm in ("PPO", "bins") else {}
    kwargs = {"net_arch": [16, 16], "activation_fn": nn.ELU}
    kind = getattr(stable, "PPO" if algorithm == "bins" else algorithm)
    model = kind("MlpPolicy", normalised, device="cpu", policy_kwargs=kwargs, seed=0, **settings)
    model.learn(48)
    path, statistics, out = tmp_path / "model.zip", tmp_path / "vec_normalize.pkl", tmp_path / "p.safetensors"
    model.save(path)
    normalised.save(str(statistics))
    asked = pack(trifarm, path, statistics, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert asked.activation == "elu"
    normalised.training = False
    rows = normalised.normalize_obs(OBSERVATIONS.reshape(-1, SIZE))
    wanted = model.predict(rows, deterministic=True)[0].reshape(TRIALS, STEPS, 9)
    wanted = (wanted / 5 - 1 if algorithm == "bins" else wanted) * SCALE
    assert np.abs(packed_actions(out) - wanted).max() <= 1e-5
    # The same by the keys alone, as where the library is not installed.
    archive = stable_baselines.read(path, statistics, with_library=False)
    recipe = stable_baselines.recipe_of(archive, None)
    by_keys = TorchOriginal(recipe, MANIFEST, SCALE, recipe.activation or "")
    assert np.abs(np.stack([by_keys.act(row) for row in OBSERVATIONS[0]]) - wanted[0]).max() <= 1e-5


def test_a_stack_of_stable_baselines_is_that_of_its_own_wrapper(tmp_path, trifarm, manifest):
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

    from tests.unit.client_cli.toy_env import ToyEnv

    torch.manual_seed(0)
    stacked = VecNormalize(VecFrameStack(DummyVecEnv([lambda: ToyEnv(SIZE)]), 3))
    model = stable.PPO("MlpPolicy", stacked, device="cpu", n_steps=16, batch_size=16)
    model.learn(32)
    path, statistics, out = tmp_path / "model.zip", tmp_path / "vec_normalize.pkl", tmp_path / "p.safetensors"
    model.save(path)
    stacked.save(str(statistics))
    asked = manifest(frame_stack={"count": 3, "fill": "zeros"})
    pack(trifarm, path, statistics, out=out, manifest=asked, options=("--scale", str(SCALE)))
    stacked.training = False
    live, raw, wanted, seen = VecFrameStack(DummyVecEnv([lambda: ToyEnv(SIZE)]), 3), ToyEnv(SIZE), [], []
    row, plain = live.reset(), raw.reset()[0]
    for _ in range(10):
        wanted.append(model.predict(stacked.normalize_obs(row), deterministic=True)[0][0] * SCALE)
        seen.append(plain)
        row, plain = live.step(np.zeros((1, 9)))[0], raw.step(np.zeros(9))[0]
    given = packed_actions(out, [np.stack(seen)])[0]
    assert np.abs(given - np.stack(wanted)).max() <= 1e-5


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
