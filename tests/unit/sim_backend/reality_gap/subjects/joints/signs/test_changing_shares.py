"""Measured torques as a share of commanded ones that changes with time, at all joints alike."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.signs.changing_shares import changing_share

STEP_S, SECONDS, JOINTS = 0.005, 20.0, 3
TIME_S = STEP_S * np.arange(round(SECONDS / STEP_S))
SAG = 1.0 - 0.03 * np.sin(2.0 * np.pi * TIME_S / 6.0)[:, None]


def commanded(seed: int) -> np.ndarray:
    """Sines, slow and fast, and one that gets faster, of three joints, N m."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (3, JOINTS))
    turns = np.stack([0.4 * TIME_S, 1.3 * TIME_S, 0.1 * TIME_S**2])[:, :, None]
    return (np.array([0.6, 0.4, 0.3])[:, None, None] * np.sin(2.0 * np.pi * turns + phase[:, None])).sum(axis=0)


def measured(asked: np.ndarray, seed: int) -> np.ndarray:
    """Each joint's own share of it, with a zero and noise."""
    noise = np.random.default_rng(seed).standard_normal(asked.shape)
    return np.array([0.9, 1.0, 1.1]) * asked + np.array([0.05, 0.0, -0.1]) + 0.02 * noise


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_supply_that_sags_by_three_percent_is_seen_at_all_joints_alike(seed):
    asked = [commanded(seed), commanded(seed + 10)]
    found = changing_share(asked, [measured(each * SAG, seed) for each in asked], STEP_S)
    assert found is not None and found == pytest.approx((0.97, 1.03), abs=0.008)


def test_what_lasts_or_is_one_joint_s_own_is_none():
    asked = [commanded(4), commanded(5)]
    one = np.where(np.arange(JOINTS) == 1, SAG, 1.0)
    late = [np.concatenate([each[:1], 0.5 * (each[1:] + each[:-1])]) for each in asked]
    for felt in (asked, [each * one for each in asked], late, [np.zeros_like(each) for each in asked]):
        assert changing_share(asked, [measured(each, 6) for each in felt], STEP_S) is None


def test_too_few_joints_or_rows_tell_nothing():
    asked = commanded(7)
    felt = measured(asked * SAG, 7)
    alone = np.where(np.arange(JOINTS) == 0, asked, np.nan)
    assert changing_share([alone], [felt], STEP_S) is None
    assert changing_share([asked[:1000]], [felt[:1000]], STEP_S) is None
