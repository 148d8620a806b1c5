"""Small policies of LeRobot, written by LeRobot itself in its own environment: ``python lerobot_policies.py FOLDER STATE ENV``.

``act`` and ``diffusion`` for a state and an environment state of so many numbers, and ``act.npz``, what LeRobot's own ACT does in
four trials (``observations`` and ``actions``). Nothing of trifarm is needed. The suite keeps the last, with 9 and 9 numbers, and
what ``client_cli/packing/lerobot_export.py`` makes of ``act``, in ``tests/unit/client_cli/packing/lerobot``.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy
from lerobot.policies.factory import make_pre_post_processors

STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"


def features(state, environment):
    """What goes in and what comes out."""
    given = {
        STATE: PolicyFeature(type=FeatureType.STATE, shape=(state,)),
        ENVIRONMENT: PolicyFeature(type=FeatureType.ENV, shape=(environment,)),
    }
    return given, {ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(9,))}


def statistics(state, environment):
    """Numbers of a made-up dataset."""
    torch.manual_seed(0)
    sizes = {STATE: state, ENVIRONMENT: environment, ACTION: 9}
    found = {name: {"mean": torch.randn(size) * 0.05, "std": torch.rand(size) * 0.1 + 0.1} for name, size in sizes.items()}
    for each in found.values():
        each |= {"min": each["mean"] - 3 * each["std"], "max": each["mean"] + 3 * each["std"]}
    return found


def save(policy, folder, state, environment):
    """The policy and its processors, as a training leaves them."""
    before, after = make_pre_post_processors(policy.config, dataset_stats=statistics(state, environment))
    policy.save_pretrained(folder)
    before.save_pretrained(folder)
    after.save_pretrained(folder)


def record(policy, folder, state, environment):
    """LeRobot's own actions, one observation after the other, between its own processors."""
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(folder))
    observations = np.random.default_rng(1).normal(size=(4, 25, state + environment)).astype(np.float32)
    actions = []
    for row in torch.from_numpy(observations).flatten(0, 1):
        if len(actions) % 25 == 0:
            policy.reset()
        with torch.no_grad():
            batch = before({STATE: row[None, :state], ENVIRONMENT: row[None, state:]})
            actions.append(after(policy.select_action(batch))[0].numpy())
    np.savez(folder.with_suffix(".npz"), observations=observations, actions=np.stack(actions).reshape(4, 25, 9))


def main():
    """Write both."""
    out, state, environment = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    given, made = features(state, environment)
    torch.manual_seed(1)
    small = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 32, "n_encoder_layers": 1, "n_decoder_layers": 1}
    settings = {"input_features": given, "output_features": made, "device": "cpu"}
    act = ACTConfig(chunk_size=12, n_action_steps=5, use_vae=False, pretrained_backbone_weights=None, **small, **settings)
    policy = ACTPolicy(act).eval()
    save(policy, out / "act", state, environment)
    record(policy, out / "act", state, environment)
    diffusion = DiffusionConfig(
        horizon=8, n_obs_steps=2, n_action_steps=4, down_dims=(32, 64), diffusion_step_embed_dim=16, n_groups=4, **settings
    )
    save(DiffusionPolicy(diffusion).eval(), out / "diffusion", state, environment)


if __name__ == "__main__":
    main()
