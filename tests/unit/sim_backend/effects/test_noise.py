"""Counter-based random numbers: distributed as they say, independent, and the same whoever asks."""

import numpy as np
import pytest
from scipy import stats

from sim_backend.effects import noise

SEEDS = np.array([0, 1, 2, 12345, noise.MAX_SEED])


@pytest.mark.parametrize("seed", SEEDS)
def test_numbers_have_their_distribution(seed: int):
    steps = np.arange(-500, 19_500)
    normal = noise.gaussians(np.full(len(steps), seed), steps, np.array([3]))[:, 0]
    even = noise.uniforms(np.full(len(steps), seed), steps, np.array([3]))[:, 0]
    assert stats.kstest(normal, "norm").pvalue > 1e-4
    assert stats.kstest(even, "uniform").pvalue > 1e-4


def test_neighbours_are_independent():
    steps = np.arange(20_000)
    numbers = noise.gaussians(np.full(len(steps), 7), steps, np.arange(5))
    limit = 4.5 / np.sqrt(len(steps))
    assert np.abs(np.corrcoef(numbers.T) - np.eye(5)).max() < limit
    assert all(abs(np.corrcoef(numbers[1:, k], numbers[:-1, k])[0, 1]) < limit for k in range(5))
    next_seed = noise.gaussians(np.full(len(steps), 8), steps, np.arange(5))
    assert abs(np.corrcoef(numbers[:, 0], next_seed[:, 0])[0, 1]) < limit
    seeds = noise.gaussians(np.arange(20_000), np.zeros(20_000), np.array([0]))[:, 0]
    assert stats.kstest(seeds, "norm").pvalue > 1e-4 and abs(np.corrcoef(seeds[1:], seeds[:-1])[0, 1]) < limit


def test_the_layout_of_a_batch_does_not_matter():
    together = noise.gaussians(np.array([4, 5, 6]), np.array([1, 2, 3]), np.array([0, 9]))
    alone = [noise.gaussians(np.array([seed]), np.array([step]), np.array([0, 9]))[0] for seed, step in ((4, 1), (5, 2), (6, 3))]
    assert (together == np.stack(alone)).all()
    assert together[1, 1] == noise.gaussian(5.0, 2.0, 9), "the control callback keeps seeds and clocks as float64"
