"""The draws of a job: a seed for each trial, and for each trial an order of preference over the robots."""

import hashlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np


def trial_seed(seed: int, ordinal: int) -> int:
    """The seed of one trial; depends on nothing but the job's seed and the ordinal."""
    digest = hashlib.sha256(f"trifarm-trial\n{seed}\n{ordinal}".encode()).digest()
    return int.from_bytes(digest[:8]) >> 1


MOST_DRAWN = 20
"""Robots of an order. A trial that so many cannot run goes to any other; a thousand names would be most of a trial's row."""

BLOCKS_KEPT = 64
"""Permutations that are kept, since all trials of a block share one and jobs are drawn from at the same time."""


def drawn_order(seed: int, ordinal: int, robots: Sequence[str]) -> tuple[str, ...]:
    """The robots in the order in which a trial prefers them, by permuted blocks: random, balanced, reproducible.

    Each block of ``len(robots)`` trials shares one random permutation, rotated by one for each trial, so that every robot
    is the first choice of exactly one trial of each block. The first ``MOST_DRAWN`` of it are the order.

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
    permutation = _permutation(seed, block, count)
    return tuple(names[permutation[(turn + place) % count]] for place in range(min(count, MOST_DRAWN)))


@lru_cache(BLOCKS_KEPT)
def _permutation(seed: int, block: int, count: int) -> tuple[int, ...]:
    digest = hashlib.sha256(f"trifarm-order\n{seed}\n{block}\n{count}".encode()).digest()
    return tuple(np.random.default_rng(int.from_bytes(digest[:8])).permutation(count).tolist())
