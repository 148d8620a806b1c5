"""The two networks of an imitation: the published expert as it is, and the student that learns from it."""

import itertools
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import nn

from sim_backend.trifinger import constants as c


class Teacher:
    """The published expert: its scaling, its network and its torque limit, as its tensors give them."""

    def __init__(self, path: Path) -> None:
        self._w = {name: tensor.float() for name, tensor in load_file(path).items()}

    @torch.no_grad()
    def act(self, observation: torch.Tensor) -> torch.Tensor:
        """Torques (n, 9) in N m for observations (n, 54)."""
        w = self._w
        x = 2 * (observation - w["observation_low"]) / (w["observation_high"] - w["observation_low"]) - 1
        x = ((x - w["running_mean"]) / torch.sqrt(w["running_var"] + 1e-5)).clamp(-5, 5)
        layers = sum(name.endswith(".weight") for name in w)
        for index in range(layers):
            x = x @ w[f"layer{index}.weight"].T + w[f"layer{index}.bias"]
            if index < layers - 1:
                x = nn.functional.elu(x)
        return x.clamp(-1, 1) * w["torque_limit_nm"]


class Student(nn.Module):
    """A smaller network with the same inputs; its inputs are normalised by the first samples it has seen."""

    mean: torch.Tensor
    variance: torch.Tensor

    def __init__(self, inputs: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        sizes = (inputs, *hidden, 9)
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("variance", torch.ones(inputs))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions in units of the torque limit, before clipping."""
        x = ((observation - self.mean) / torch.sqrt(self.variance + 1e-5)).clamp(-5, 5)
        for layer in self.layers[:-1]:
            x = nn.functional.elu(layer(x))
        return self.layers[-1](x)

    @torch.no_grad()
    def normalise(self, mean: torch.Tensor, variance: torch.Tensor) -> None:
        """Scale the inputs by these from now on, each of shape (inputs,)."""
        self.mean.copy_(mean)
        self.variance.copy_(variance)

    @torch.no_grad()
    def act(self, observation: torch.Tensor) -> torch.Tensor:
        """Torques (n, 9), N m."""
        return self(observation).clamp(-1, 1) * c.MAX_TORQUE_NM
