"""Small policies of LeRobot, written by LeRobot itself in its own environment: ``python lerobot_policies.py FOLDER STATE ENV``.

``act`` and ``diffusion`` for a state and an environment state of so many numbers; nothing of trifarm is needed.
"""

import sys
from pathlib import Path

import torch
from lerobot.configs.types import FeatureType, PolicyFeature  # pyright: ignore[reportMissingImports]
from lerobot.policies.act.configuration_act import ACTConfig  # pyright: ignore[reportMissingImports]
from lerobot.policies.act.modeling_act import ACTPolicy  # pyright: ignore[reportMissingImports]
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig  # pyright: ignore[reportMissingImports]
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy  # pyright: ignore[reportMissingImports]
from lerobot.policies.factory import make_pre_post_processors  # pyright: ignore[reportMissingImports]

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


def main():
    """Write both."""
    out, state, environment = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    given, made = features(state, environment)
    torch.manual_seed(1)
    small = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 32, "n_encoder_layers": 1, "n_decoder_layers": 1}
    settings = {"input_features": given, "output_features": made, "device": "cpu"}
    act = ACTConfig(chunk_size=12, n_action_steps=5, use_vae=False, pretrained_backbone_weights=None, **small, **settings)
    save(ACTPolicy(act).eval(), out / "act", state, environment)
    diffusion = DiffusionConfig(
        horizon=8, n_obs_steps=2, n_action_steps=4, down_dims=(32, 64), diffusion_step_embed_dim=16, n_groups=4, **settings
    )
    save(DiffusionPolicy(diffusion).eval(), out / "diffusion", state, environment)


if __name__ == "__main__":
    main()
