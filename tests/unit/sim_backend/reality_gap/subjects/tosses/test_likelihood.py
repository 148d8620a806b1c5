"""Scales, weights, folds and gains on held-out tosses."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.tosses.evidence import EvidenceKind
from sim_backend.reality_gap.subjects.tosses.likelihood import (
    Point,
    Weights,
    by_episode,
    folds_of,
    held_out_gains,
    scale_of,
    sign_flip_p,
    total,
    weights,
)

_KIND = EvidenceKind("rest", "m", 1, 0.1, 0.0, "height at rest")


@pytest.mark.parametrize("dimensions", [1, 3])
def test_scale_of_students_t_is_recovered(dimensions):
    rng = np.random.default_rng(1)
    shared = np.sqrt(4.0 / rng.chisquare(4.0, (20_000, 1)))
    values = np.linalg.norm(0.3 * rng.standard_normal((20_000, dimensions)) * shared, axis=1)
    assert scale_of(values, dimensions) == pytest.approx(0.3, rel=0.03)


def test_many_tosses_count_no_more_than_their_common_error_allows():
    kind = EvidenceKind("rest", "m", 1, 0.1, 0.05, "height at rest")
    (weight,) = weights([kind], {"rest": np.zeros(10_000)}).of.values()
    assert 10_000 * weight == pytest.approx(1.0 + (0.1 / 0.05) ** 2, rel=0.01)


def test_tosses_of_one_episode_stay_together():
    episodes = np.repeat(np.arange(12), 3)
    folds = folds_of(episodes, np.random.default_rng(0))
    assert len(set(folds.tolist())) == 5
    assert all(len(set(folds[episodes == episode].tolist())) == 1 for episode in range(12))


def test_a_true_shift_gains_and_a_fit_of_noise_does_not():
    rng, n = np.random.default_rng(2), 200
    folds, weight, noise = np.arange(n) % 5, Weights({"rest": 1.0}), rng.normal(0.0, 0.1, n)

    def gain(truth: float) -> float:
        points = [Point({}, {"rest": noise + truth - shift}) for shift in np.linspace(-0.3, 0.3, 61)]
        base = Point({}, {"rest": noise + truth})
        return sum(held_out_gains([_KIND], weight, base, points, folds)["rest"])

    assert gain(0.1) > 30.0
    assert gain(0.0) < 2.0


def test_missing_evidence_counts_nothing():
    residuals = {"rest": np.array([0.1, np.nan, -0.1])}
    alone = {"rest": np.array([0.1, -0.1])}
    assert total([_KIND], Weights({"rest": 1.0}), residuals) == pytest.approx(total([_KIND], Weights({"rest": 1.0}), alone))


def test_chance_gives_no_small_p_more_often_than_it_says():
    rng = np.random.default_rng(3)
    p = np.array([sign_flip_p(list(rng.standard_normal((6, 25))), rng, 400) for _ in range(200)])
    assert np.mean(p < 0.05) < 0.1
    assert sign_flip_p([np.ones(30), rng.standard_normal(30)], rng) < 0.01
    assert by_episode(np.array([1.0, 2.0, 4.0]), np.array([7, 7, 9])) == pytest.approx([3.0, 4.0])
