"""Replayed pushes as a few numbers."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.cube import TRIALS
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES, contact_summary
from sim_backend.reality_gap.subjects.cube.replay import Replayed

MASS = [i for i, trial in enumerate(TRIALS) if trial.effect == "cube_mass"]


def _push(rng, truth: int | None) -> Replayed:
    """A push whose residuals are small under one trial, and under all others what tells that one from them."""
    way = rng.normal(0.0, 1.0, (len(TRIALS), 120))
    way[0] = 0.0
    residual = (way[truth] if truth is not None else 0.0) - way + rng.normal(0.0, 0.02, 120)
    return Replayed(residual, np.arange(120) % 6, np.linspace(0.0, 0.6, 120))


def test_without_pushes_there_is_no_summary():
    assert contact_summary([]) is None


def test_the_score_is_where_the_true_trial_says_it_would_be():
    rng = np.random.default_rng(1)
    found = contact_summary([_push(rng, MASS[1]) for _ in range(5)])
    assert found is not None
    values, response = found.response["cube_mass"]
    assert values.tolist() == [TRIALS[i].value for i in MASS]
    assert found.score == pytest.approx(response[1], abs=1.0)
    assert np.linalg.norm(found.score) > 10.0
    assert np.linalg.norm(found.score - response[0]) > 10.0


def test_a_healthy_push_scores_little():
    rng = np.random.default_rng(2)
    found = contact_summary([_push(rng, None) for _ in range(5)])
    assert found is not None
    assert np.abs(found.score).max() < 2.0
    assert len(found.score) == len(CONTACT_NAMES)


def test_one_push_gone_wrong_counts_less():
    rng = np.random.default_rng(3)
    pushes = [_push(rng, None) for _ in range(5)]
    wrong = Replayed(pushes[0].residual + rng.normal(0.0, 6.0, 120), pushes[0].channel, pushes[0].time_s)
    alone, among = contact_summary([wrong]), contact_summary([wrong, *pushes[1:]])
    assert alone is not None and among is not None
    assert np.linalg.norm(among.score) < 0.7 * np.linalg.norm(alone.score)
