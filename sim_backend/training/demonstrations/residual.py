"""A residual: PPO learns what is added to the actions of a policy that stays as it is (Johannink et al. 2018, arXiv 1812.03201).

What is exported is one network again: both side by side in the same layers, their last ones summed.
"""

import numpy as np
from gymnasium import spaces

from api_schemas.policy import InputScaling
from sim_backend.environments.practice import Practice
from sim_backend.environments.vec_env import SEEN, TrifingerVecEnv
from sim_backend.training.actor_critic import CLIP, EPSILON, ActorCritic
from sim_backend.training.demonstrations.plain_policy import PlainPolicy
from sim_backend.training.export import ExportedPolicy, count_layers, exported
from sim_backend.training.recipe import ResidualTable

LARGEST = 10.0
"""Bound of a residual's outputs; so wide that the sum is what is clipped, as in the exported network."""


class FrozenPolicy:
    """The policy that stays as it is, in the units of the residual's outputs.

    Args:
        settings: which policy, and what a residual of 1 is.
        practice: what is practised.

    Raises:
        ValueError: it cannot be summed with a residual; the message says why.
    """

    def __init__(self, settings: ResidualTable, practice: Practice) -> None:
        plain = PlainPolicy(settings.policy, settings.layout, practice, "have a residual")
        self.share, self.layers = settings.share, count_layers(plain.tensors)
        self.fix_inputs, self.outputs = plain.fix_inputs, plain.outputs
        self.tensors, self.mean, self.variance = plain.tensors, plain.mean, plain.variance

    def with_residual(self, policy: ActorCritic, practice: Practice, name: str) -> ExportedPolicy:
        """Both as one network."""
        residual = exported(policy, practice.manifest, name)
        if count_layers(residual.tensors) != self.layers:
            raise ValueError(
                f"the frozen policy has {self.layers - 1} hidden layers and the residual's actor "
                f"{count_layers(residual.tensors) - 1}; give networks.actor as many"
            )
        tensors = {"running_mean": self.mean, "running_var": self.variance}
        for index in range(self.layers):
            first, second = (
                {key: each[f"layer{index}.{key}"] for key in ("weight", "bias")} for each in (self.tensors, residual.tensors)
            )
            last = index == self.layers - 1
            if last:
                second = {key: values * np.float32(self.share) for key, values in second.items()}
            tensors |= {f"layer{index}.{key}": values for key, values in _joined(first, second, index, last=last).items()}
        scaled = {"input_scaling": InputScaling(clip=CLIP, epsilon=EPSILON)}
        return ExportedPolicy(tensors, residual.manifest.model_copy(update=scaled))


class ResidualRobots(TrifingerVecEnv):
    """Robots whose actions are the frozen policy's plus what is asked of them. Owner of what was seen last."""

    def __init__(self, frozen: FrozenPolicy, practice: Practice, **settings) -> None:
        super().__init__(practice, **settings)
        self._frozen = frozen
        self.action_space = spaces.Box(-LARGEST, LARGEST, (9,), dtype=np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the sum of both."""
        super().step_async(self._frozen.outputs(self._seen) + self._frozen.share * actions)

    def _shown(self, observation: np.ndarray):
        shown = super()._shown(observation)
        self._seen = shown[SEEN] if isinstance(shown, dict) else shown
        return shown


def _joined(first: dict, second: dict, index: int, *, last: bool) -> dict[str, np.ndarray]:
    """A layer of both networks: inputs in common at first, side by side after that, summed at the end."""
    if last:
        weight = np.concatenate([first["weight"], second["weight"]], axis=1)
        return {"weight": weight, "bias": first["bias"] + second["bias"]}
    bias = np.concatenate([first["bias"], second["bias"]])
    if index == 0:
        return {"weight": np.concatenate([first["weight"], second["weight"]]), "bias": bias}
    (a, b), (p, q) = first["weight"].shape, second["weight"].shape
    weight = np.zeros((a + p, b + q), dtype=np.float32)
    weight[:a, :b], weight[a:, b:] = first["weight"], second["weight"]
    return {"weight": weight, "bias": bias}
