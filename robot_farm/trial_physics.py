"""The physics that a robot has in one attempt at a trial."""

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.physics import Physics


@dataclass(frozen=True)
class TrialPhysics:
    """Physics (n = 1), the seed of its noise (a whole number below 2**53), and a generator for what the robot does by chance."""

    physics: Physics
    noise_seed: int
    rng: np.random.Generator
