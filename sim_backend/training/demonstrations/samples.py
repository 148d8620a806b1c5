"""What was seen and what should have been done there, kept in windows of successive control periods."""

import numpy as np
import torch

Batch = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
"""Observations (steps, n, size), actions (steps, n, 9) in units of the largest, and memories at the begin (parts, n, cells)."""


class Samples:
    """Owner of the samples; the oldest windows give way to new ones.

    Args:
        windows: how many are kept.
        window: control periods of each.
        size: of an observation.
        parts: of what the student remembers.
        cells: numbers in each part.
    """

    def __init__(self, windows: int, window: int, size: int, parts: int = 0, cells: int = 0) -> None:
        self._seen = torch.empty((windows, window, size))
        self._wanted = torch.empty((windows, window, 9))
        self._state = torch.empty((windows, parts, cells))
        self._added = 0

    @property
    def windows(self) -> int:
        """Windows that are kept now."""
        return min(self._added, len(self._seen))

    @property
    def count(self) -> int:
        """Samples that are kept now."""
        return self.windows * self._seen.shape[1]

    def add(self, seen: torch.Tensor, wanted: torch.Tensor, state: torch.Tensor) -> None:
        """Observations (window, n, size), actions (window, n, 9), and what was remembered at the begin (parts, n, cells)."""
        rows = torch.from_numpy((self._added + np.arange(seen.shape[1])) % len(self._seen))
        self._seen[rows], self._wanted[rows], self._state[rows] = (
            seen.transpose(0, 1),
            wanted.transpose(0, 1),
            state.transpose(0, 1),
        )
        self._added += seen.shape[1]

    def draw(self, rng: np.random.Generator, samples: int) -> Batch:
        """About so many samples: whole windows where there is memory, otherwise single ones as windows of one period."""
        if self._state.shape[1]:
            rows = torch.from_numpy(rng.integers(self.windows, size=max(1, samples // self._seen.shape[1])))
            return (
                self._seen[rows].transpose(0, 1),
                self._wanted[rows].transpose(0, 1),
                self._state[rows].transpose(0, 1).contiguous(),
            )
        rows = torch.from_numpy(rng.integers(self.count, size=samples))
        return self._seen.flatten(0, 1)[rows][None], self._wanted.flatten(0, 1)[rows][None], torch.zeros((0, samples, 0))
