"""A recurrent policy that sb3-contrib trains for a few steps, and what the library says that it should have done."""

import numpy as np
import pytest

from api_schemas.policy import PolicyManifest, canonical_json
from tests.unit.client_cli.packing.toy_env import ToyEnv

SCALE = 0.1
MANIFEST = PolicyManifest.model_validate(
    {
        "observation": ["joint_position_rad", "joint_velocity_rad_s", "goal_fingertip_position_world_m", "previous_action"],
        "output_scaling": {"scale": SCALE},
    }
)


def trained():
    """RecurrentPPO after a few steps; skips where the library is not installed."""
    contrib = pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed: its RecurrentPPO cannot be trained")
    import torch

    torch.set_num_threads(1)
    settings = {"n_steps": 32, "batch_size": 32, "n_epochs": 4, "learning_rate": 0.02}
    layers = {"lstm_hidden_size": 16, "net_arch": [16]}
    env = ToyEnv(MANIFEST.observation_size)
    model = contrib.RecurrentPPO("MlpLstmPolicy", env, policy_kwargs=layers, seed=3, device="cpu", **settings)
    return model.learn(128)


def saved(model, path):
    """The archive as the library saves it, with its manifest beside."""
    model.save(path)
    path.with_suffix(".json").write_text(canonical_json(MANIFEST))
    return path


def predicted(model, observations, state=None):
    """What the library's own policy does in a trial that begins with a memory, and the memory that it ends with."""
    actions, begins = [], np.array([state is None])
    for observation in observations:
        action, state = model.predict(observation, state, begins, deterministic=True)
        actions.append(action * SCALE)
        begins = np.array([False])
    return np.stack(actions), state
