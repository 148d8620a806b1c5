"""The draws of a job: a seed for each trial, and for each trial an order of preference over the robots."""

import hashlib
from collections.abc import Sequence

import numpy as np


def trial_seed(seed: int, ordinal: int) -> int:
    """The seed of one trial; depends on nothing but the job's seed and the ordinal."""
    digest = hashlib.sha256(f"trifarm-trial\n{seed}\n{ordinal}".encode()).digest()
    return int.from_bytes(digest[:8]) >> 1


def drawn_order(seed: int, ordinal: int, robots: Sequence[str]) -> tuple[str, ...]:
    """The robots in the order in which a trial prefers them, by permuted blocks: random, balanced, reproducible.

    Each block of ``len(robots)`` trials shares one random permutation, rotated by one for each trial, so that every robot
    is the first choice of exactly one trial of each block.

    Args:
        seed: the job's seed.
        ordinal: the trial's number within the job, from 0.
        robots: the robots known at the moment of the draw; their order does not matter.
    """
    names = sorted(robots)
    count = len(names)
    if count == 0:
        return ()
    block, turn = divmod(ordinal, count)
    digest = hashlib.sha256(f"trifarm-order\n{seed}\n{block}\n{count}".encode()).digest()
    permutation = np.random.default_rng(int.from_bytes(digest[:8])).permutation(count)
    return tuple(names[index] for index in np.roll(permutation, -turn))
