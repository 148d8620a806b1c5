"""Archives of stable-baselines3 packed with their VecNormalize pickles; sb3-contrib's by hand, in the layout that it saves."""

import io
import json
import zipfile

import numpy as np
import pytest
import torch
from torch import nn

from client_cli.packing import stable_baselines
from client_cli.packing.original import TorchOriginal
from tests.unit.client_cli.packing.checkpoints import mlp
from tests.unit.client_cli.packing.packed import (
    MANIFEST,
    OBSERVATIONS,
    SCALE,
    SIZE,
    STEPS,
    TRIALS,
    assert_same,
    pack,
    packed_actions,
)


def contrib_archive(path, lstm):
    """What sb3-contrib's RecurrentPPO saves, as far as it is read: an LSTM before the actor's layers."""
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

    from tests.unit.client_cli.packing.toy_env import ToyEnv

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


def test_bounds_of_each_joint_are_those_of_the_library(tmp_path, trifarm, manifest):
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    import gymnasium

    from tests.unit.client_cli.packing.toy_env import ToyEnv

    torch.manual_seed(0)
    env, path, out = ToyEnv(SIZE), tmp_path / "model.zip", tmp_path / "p.safetensors"
    low, high = -np.linspace(0.01, 0.05, 9, dtype=np.float32), np.linspace(0.02, 0.03, 9, dtype=np.float32)
    env.action_space = gymnasium.spaces.Box(low, high)
    kwargs = {"ortho_init": False}  # else actions begin so small that no bound is met
    model = stable.PPO("MlpPolicy", env, device="cpu", n_steps=16, batch_size=16, seed=0, policy_kwargs=kwargs)
    model.save(path)
    asked = pack(trifarm, path, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert asked.output_scaling.clip == 1.0
    wanted = model.predict(OBSERVATIONS.reshape(-1, SIZE), deterministic=True)[0]
    assert ((wanted == low) | (wanted == high)).any(axis=0).all(), "every joint meets a bound"
    assert np.abs(packed_actions(out).reshape(-1, 9) - wanted * SCALE).max() <= 1e-5


def test_a_stack_of_stable_baselines_is_that_of_its_own_wrapper(tmp_path, trifarm, manifest):
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

    from tests.unit.client_cli.packing.toy_env import ToyEnv

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
