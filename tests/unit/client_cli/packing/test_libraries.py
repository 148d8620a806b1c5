"""``trifarm pack`` on checkpoints that rsl_rl, skrl, rl_games and sb3-contrib wrote themselves after a few steps of training."""

import numpy as np
import pytest
import torch

from client_cli.packing import stable_baselines
from tests.unit.client_cli.packing import libraries
from tests.unit.client_cli.packing.packed import OBSERVATIONS, SCALE, SIZE, assert_same, pack, packed_actions
from tests.unit.client_cli.packing.toy_env import ToyEnv

pytestmark = pytest.mark.filterwarnings("ignore")
"""What the libraries say of each other's versions."""


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)
    torch.manual_seed(0)


CASES = {
    "rsl_rl": ("rsl_rl", "model_2.pt", lambda path: libraries.rsl_rl(path, SIZE, None), None),
    "rsl_rl lstm": ("rsl_rl", "model_2.pt", lambda path: libraries.rsl_rl(path, SIZE, "lstm"), "lstm"),
    "rsl_rl gru": ("rsl_rl", "model_2.pt", lambda path: libraries.rsl_rl(path, SIZE, "gru"), "gru"),
    "skrl": ("skrl", "agent_32.pt", lambda path: libraries.skrl(path, SIZE), None),
    "rl_games": ("rl_games", "last_cube_ep_2.pth", lambda path: libraries.rl_games(path, SIZE, None), None),
    "rl_games lstm": ("rl_games", "last_cube_ep_2.pth", lambda path: libraries.rl_games(path, SIZE, "lstm"), "lstm"),
}
"""The library, its file's name, what trains, and the memory that the packed policy must have."""


@pytest.mark.parametrize("case", CASES)
def test_what_the_library_saved_computes_what_the_library_computes(case, tmp_path, trifarm, manifest):
    library, name, train, memory = CASES[case]
    pytest.importorskip(library, reason=f"{library} is not installed")
    actions, out = train(tmp_path / name), tmp_path / "p.safetensors"
    asked = pack(trifarm, tmp_path / name, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert asked.recurrent == memory
    assert_same(out, actions)


def test_recurrent_ppo_of_sb3_contrib(tmp_path, trifarm, manifest):
    contrib = pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    normalised = VecNormalize(DummyVecEnv([lambda: ToyEnv(SIZE)]))
    settings = {"n_steps": 32, "batch_size": 32, "learning_rate": 1e-2, "policy_kwargs": {"lstm_hidden_size": 16}}
    model = contrib.RecurrentPPO("MlpLstmPolicy", normalised, seed=0, device="cpu", **settings).learn(64)
    path, statistics, out = tmp_path / "model.zip", tmp_path / "vec_normalize.pkl", tmp_path / "p.safetensors"
    model.save(path)
    normalised.save(str(statistics))
    asked = pack(trifarm, path, statistics, out=out, manifest=manifest(), options=("--scale", str(SCALE)))
    assert (asked.recurrent, asked.activation) == ("lstm", "tanh")
    assert stable_baselines.read(path, statistics).policy is not None, "the original is the library's own policy"
    normalised.training = False
    given = packed_actions(out)
    for trial, packed in zip(OBSERVATIONS, given, strict=True):
        state, begins, wanted = None, np.array([True]), []
        for row in normalised.normalize_obs(trial):
            action, state = model.predict(row, state, begins, deterministic=True)
            wanted.append(action)
            begins = np.array([False])
        assert np.abs(packed - np.stack(wanted) * SCALE).max() <= 1e-5
