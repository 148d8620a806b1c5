"""The network that imitates: normalised inputs, cells if it remembers, linear layers."""

from itertools import pairwise

import numpy as np
import torch
from torch import nn

from api_schemas.policy import PolicyManifest
from api_schemas.policy_network import Cell
from sim_backend.environments.observation_space import observation_space
from sim_backend.training.actor_critic import Inputs
from sim_backend.training.demonstrations.recipe import StudentTable
from sim_backend.training.export import ExportedPolicy, exported_network

CELLS = {Cell.LSTM: nn.LSTM, Cell.GRU: nn.GRU}
PARTS = {Cell.LSTM: 2, Cell.GRU: 1}
"""Numbers that each cell remembers: an LSTM's output and its content, a GRU's output."""


class Student(nn.Module):
    """Observations to actions in units of the largest. What it remembers of n trials has shape (parts, n, cells)."""

    def __init__(self, manifest: PolicyManifest, settings: StudentTable) -> None:
        super().__init__()
        self._manifest, self.cell = manifest, settings.cell
        self.inputs = Inputs(observation_space(manifest), manifest)
        first = self.inputs.features_dim
        self.memory: nn.Module | None = None
        self.parts, self.cells = 0, 0
        if self.cell is not None:
            self.memory, self.parts, self.cells = CELLS[self.cell](first, settings.cells), PARTS[self.cell], settings.cells
            first = settings.cells
        sizes = (first, *settings.hidden, 9)
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))

    @property
    def linear_layers(self) -> list[nn.Linear]:
        """The layers after the cells, the last one included."""
        return [layer for layer in self.layers if isinstance(layer, nn.Linear)]

    def nothing(self, trials: int) -> torch.Tensor:
        """What it remembers of trials that begin."""
        return torch.zeros((self.parts, trials, self.cells))

    def forward(self, observation: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions (steps, n, 9) for observations (steps, n, size) of n trials, and what it remembers after them."""
        x = self.inputs(observation.flatten(0, 1)).unflatten(0, observation.shape[:2])
        if self.cell is Cell.LSTM:
            x, (output, content) = self.memory(x, (state[:1].contiguous(), state[1:].contiguous()))  # type: ignore[misc]
            state = torch.cat([output, content])
        elif self.cell is Cell.GRU:
            x, state = self.memory(x, state)  # type: ignore[misc]
        for layer in self.layers[:-1]:
            x = nn.functional.elu(layer(x))
        return self.layers[-1](x), state

    @torch.no_grad()
    def act(self, observation: np.ndarray, state: torch.Tensor) -> tuple[np.ndarray, torch.Tensor]:
        """Outputs (n, 9), not clipped, for the next observations (n, size), and what it remembers after them."""
        outputs, state = self(torch.from_numpy(observation)[None], state)
        return outputs[0].numpy(), state

    def exported(self, name: str) -> ExportedPolicy:
        """As the farm takes it."""
        cells = None if self.cell is None or self.memory is None else (self.cell, self.memory)
        return exported_network(self.inputs, list(self.layers), cells, self._manifest, name)
