"""Robots to train on: physics drawn anew for each trial, from a table of ranges or by automatic domain randomisation.

Ranges are presets (those of Dactyl, Allshire et al. and IsaacGymEnvs lie in ``effects/presets``, each row with its source), or a
file that a reality-gap study wrote, whose intervals are then drawn from (``draw = "interval_90"``).
"""

from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from sim_backend.effects.estimate import Draw
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Ranges, load_ranges
from sim_backend.training.adr import AutomaticRandomization
from sim_backend.training.recipe import Recipe


def draw_robots(ranges: Ranges, rng: np.random.Generator, n: int, nominal_share: float = 0.0) -> Physics:
    """Physics of n robots that were never seen before, at the begin of an episode of each; some of them nominal ones."""
    drawn = ranges.draw_episode(rng, ranges.draw(rng, n))
    nominal = np.flatnonzero(rng.random(n) < nominal_share) if nominal_share else np.empty(0, dtype=int)
    return drawn.with_rows(nominal, Physics.nominal(len(nominal))) if len(nominal) else drawn


class Randomizer(Protocol):
    """What draws the robots of a run, and what it has become."""

    def draw(self, rng: np.random.Generator, robots: np.ndarray) -> Physics:
        """Physics of robots that begin a trial."""
        ...

    def told(self, robots: np.ndarray, success: np.ndarray) -> None:
        """How the trials ended that these robots had before their present ones."""
        ...

    def state(self) -> dict[str, Any]:
        """What :meth:`restore` needs: numbers, lists and texts."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`state` gave."""
        ...

    def document(self) -> dict[str, Any]:
        """For the run's record."""
        ...

    def curve(self) -> dict[str, float]:
        """Numbers for the line of progress."""
        ...


class FixedRandomization:
    """Robots from the whole table, always."""

    def __init__(self, ranges: Ranges, nominal_share: float = 0.0) -> None:
        self._ranges, self._nominal_share = ranges, nominal_share

    def draw(self, rng: np.random.Generator, robots: np.ndarray) -> Physics:
        """Physics of robots that begin a trial."""
        return draw_robots(self._ranges, rng, len(robots), self._nominal_share)

    def told(self, robots: np.ndarray, success: np.ndarray) -> None:
        """Nothing follows from it."""

    def state(self) -> dict[str, Any]:
        """Nothing changes."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Nothing changes."""

    def document(self) -> dict[str, Any]:
        """The table's name."""
        return {"physics": self._ranges.name}

    def curve(self) -> dict[str, float]:
        """Nothing changes."""
        return {}


def randomizer_of(recipe: Recipe) -> Randomizer:
    """What the recipe asks for."""
    ranges = ranges_to_train_on(recipe.physics_source)
    settings = recipe.randomization
    if settings.method == "none":
        return FixedRandomization(ranges, recipe.nominal_share)
    return AutomaticRandomization(ranges, settings, recipe.ppo.robots)


def ranges_to_train_on(name_or_path: str) -> Ranges:
    """Ranges by name or file; those of a study are drawn from their intervals, whatever the file says of other uses."""
    ranges = load_ranges(name_or_path)
    if not ranges.estimate.intervals:
        return ranges
    return replace(ranges, estimate=replace(ranges.estimate, draws=Draw.INTERVAL_90))
