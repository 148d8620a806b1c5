"""Automatic domain randomisation (OpenAI et al. 2019, arXiv 1910.07113, section 5): ranges grow as the policy copes with them.

Each number of a table of ranges has two boundaries, which begin at its nominal value. Part of the trials have one number at one
of its boundaries and all others within theirs; when enough of those ended, the boundary moves out if their success rate is high
and in if it is low.
"""

from typing import Any

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Range, Ranges
from sim_backend.training.recipe import Randomization

_DECIDING = frozenset(effect.key(p) for effect in CATALOGUE.values() for p in effect.parameters)
"""Numbers whose absent value means that there is no effect; the others only say how it looks."""
_NONE = -1
_LEAST_WIDTH = 1e-3
"""Share of the whole range that counts as its width where it has none yet, so that the entropy is finite."""


class AutomaticRandomization:
    """Owner of the boundaries and of which trial is at which.

    Args:
        ranges: where the boundaries end.
        settings: thresholds and steps.
        robots: that practise.
    """

    def __init__(self, ranges: Ranges, settings: Randomization, robots: int) -> None:
        self._ranges, self._settings = ranges, settings
        self._rows = ranges.rows
        self.reach = np.zeros((len(self._rows), 2))  # share of the way from nominal to the lower and upper end
        self._outcomes: list[list[bool]] = [[] for _ in range(2 * len(self._rows))]
        self._at, self._was_at = np.full(robots, _NONE), np.full(robots, _NONE)

    def draw(self, rng: np.random.Generator, robots: np.ndarray) -> Physics:
        """Physics of robots that begin a trial, some of them at a boundary."""
        n = len(robots)
        at = np.where(rng.random(n) < self._settings.at_boundary, rng.integers(2 * len(self._rows), size=n), _NONE)
        self._was_at[robots], self._at[robots] = self._at[robots], at
        values: dict[str, Any] = {}
        for index, row in enumerate(self._rows):
            low, high = self._boundaries(index)
            drawn = rng.uniform(low, high, (n, row.parameter.width if row.each else 1))
            drawn[at == 2 * index], drawn[at == 2 * index + 1] = low, high
            drawn = np.broadcast_to(drawn, (n, row.parameter.width))
            values[row.key] = drawn[:, 0] if row.parameter.width == 1 else drawn
        return Physics.stack([self._ranges.shared] * n).changed(values)

    def told(self, robots: np.ndarray, success: np.ndarray) -> None:
        """Count the trials that ended at a boundary, and move it when there are enough."""
        for boundary, succeeded in zip(self._was_at[robots], success, strict=True):
            if boundary == _NONE:
                continue
            outcomes = self._outcomes[boundary]
            outcomes.append(bool(succeeded))
            if len(outcomes) >= self._settings.trials:
                self._move(int(boundary), float(np.mean(outcomes)))
                outcomes.clear()

    def _move(self, boundary: int, success_rate: float) -> None:
        step = self._settings.step
        by = step if success_rate >= self._settings.high else -step if success_rate <= self._settings.low else 0.0
        place = divmod(boundary, 2)
        self.reach[place] = np.clip(self.reach[place] + by, 0.0, 1.0)

    def _boundaries(self, index: int) -> tuple[float, float]:
        low, high = _ends(self._rows[index])
        nominal = _nominal(self._rows[index])
        below, above = self.reach[index]
        return nominal + below * (low - nominal), nominal + above * (high - nominal)

    @property
    def entropy(self) -> float:
        """Mean logarithm of the share of its whole range that each number's boundaries leave open; 0 when all is open."""
        widths = []
        for index, row in enumerate(self._rows):
            (low, high), (first, last) = self._boundaries(index), _ends(row)
            widths.append((high - low) / (last - first) if last > first else 1.0)
        return float(np.mean(np.log(np.maximum(widths, _LEAST_WIDTH)))) if widths else 0.0

    def state(self) -> dict[str, Any]:
        """Boundaries and outcomes so far."""
        return {"reach": self.reach.tolist(), "outcomes": self._outcomes}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`state` gave."""
        self.reach, self._outcomes = np.array(state["reach"]), [list(each) for each in state["outcomes"]]

    def document(self) -> dict[str, Any]:
        """Where the boundaries are."""
        boundaries = {row.key: list(self._boundaries(index)) for index, row in enumerate(self._rows)}
        return {"physics": self._ranges.name, "method": "adr", "entropy": self.entropy, "boundaries": boundaries}

    def curve(self) -> dict[str, float]:
        """The entropy."""
        return {"entropy": self.entropy}


def _nominal(row: Range) -> float:
    """Where a number's boundaries begin: where its effect is absent, or the middle where it only says how the effect looks."""
    return row.parameter.absent if row.key in _DECIDING else (row.low + row.high) / 2


def _ends(row: Range) -> tuple[float, float]:
    """The whole range, which takes in the nominal value."""
    nominal = _nominal(row)
    return min(row.low, nominal), max(row.high, nominal)
