"""What the recipes of several experiments share: the networks and rates of the shipped recipe ``push``."""

from typing import Any

SEEDS = (1, 2, 3)
NETWORKS = {"actor": [128, 128], "critic": [256, 128], "privileged": True}
REWARD = {"approach": 1000.0}
FINE_REWARD = REWARD | {"fine_kernel_per_m": 100.0}
"""Of the recipe ``push-adr``, which learns to push with a third of the samples."""
NOMINAL_RATE, REAL_RATE, DAGGER_RATE = 3500.0, 2500.0, 1150.0
"""Samples in a second on one thread, another run beside it on two cores."""
FEW_ROBOTS_RATE = 4000.0
"""With 512 robots in place of 1024 on nominal physics."""
START_RATE = 8000.0
"""On two threads with nothing beside."""
BEFORE_THE_FARM = {"final_trials": 100, "physics": ["nominal", "real"]}


def from_scratch(task: str, samples: int, *, every: int, **more: Any) -> dict[str, Any]:
    """PPO on nominal robots as in the shipped recipe ``push``."""
    return {
        "task": task,
        "layout": "push",
        "physics": "nominal",
        "episode_s": 5.0,
        "samples": samples,
        "reward": REWARD,
        "networks": NETWORKS,
        "ppo": {"robots": 1024, "steps": 16, "minibatch": 4096, "learning_rate": 5e-4, "final_learning_rate": 1e-4},
        "evaluation": {"every_samples": every, "trials": 64, "physics": ["nominal"], "final_trials": 100},
    } | more
