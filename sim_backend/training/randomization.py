"""Robots to train on: physics drawn anew for each of them from a table of ranges (domain randomisation)."""

import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Ranges


def draw_robots(ranges: Ranges, rng: np.random.Generator, n: int) -> Physics:
    """Physics of n robots that were never seen before, at the begin of an episode of each."""
    return ranges.draw_episode(rng, ranges.draw(rng, n))
