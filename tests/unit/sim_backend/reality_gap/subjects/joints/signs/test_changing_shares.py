"""Measured torques as a share of commanded ones that changes with time, at all joints alike."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sim_backend.reality_gap.subjects.joints.signs.changing_shares import changing_share

STEP_S, SECONDS, JOINTS = 0.005, 20.0, 3
TIME_S = STEP_S * np.arange(round(SECONDS / STEP_S))
SAG = 1.0 - 0.03 * np.sin(2.0 * np.pi * TIME_S / 6.0)[:, None]


def commanded(seed: int) -> np.ndarray:
    """Sines, slow and fast, and one that gets faster, of three joints, N m."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (3, JOINTS))
    turns = np.stack([0.4 * TIME_S, 1.3 * TIME_S, 0.1 * TIME_S**2])[:, :, None]
    return (np.array([0.6, 0.4, 0.3])[:, None, None] * np.sin(2.0 * np.pi * turns + phase[:, None])).sum(axis=0)


def measured(asked: np.ndarray, seed: int, noise_nm: float = 0.02) -> np.ndarray:
    """Each joint's own share of it, with a zero and noise."""
    noise = np.random.default_rng(seed).standard_normal(asked.shape)
    return np.array([0.9, 1.0, 1.1]) * asked + np.array([0.05, 0.0, -0.1]) + noise_nm * noise


def found_in(asked, felt, noise_nm: float = 0.02) -> tuple[float, float] | None:
    """What is found of recordings whose motors give these torques, with noise."""
    return changing_share(asked, [measured(each, 6, noise_nm) for each in felt], [STEP_S] * len(asked))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_supply_that_sags_by_three_percent_is_seen_at_all_joints_alike(seed):
    asked = [commanded(seed), commanded(seed + 10)]
    found = found_in(asked, [each * SAG for each in asked])
    assert found is not None and found == pytest.approx((0.97, 1.03), abs=0.012)


@pytest.mark.parametrize("sizes", [(1.0, 1.0, 1.0), (10.0, 1.0, 1.0)], ids=["alike", "one much larger"])
def test_what_lasts_or_is_one_joint_s_own_is_none(sizes):
    asked = [np.array(sizes) * commanded(4), np.array(sizes) * commanded(5)]
    one = np.where(np.arange(JOINTS) == 0, SAG, 1.0)
    late = [np.concatenate([each[:1], 0.5 * (each[1:] + each[:-1])]) for each in asked]
    dead = [np.where(np.arange(JOINTS) == 2, 0.0, each) for each in asked]
    for felt in (asked, [each * one for each in asked], late, dead):
        assert found_in(asked, felt) is None


@pytest.mark.parametrize("noise_nm", [0.0, 0.02])
def test_joints_that_rest_for_a_while_tell_nothing_and_hide_nothing(noise_nm):
    rests = (TIME_S % 10.0 < 2.0)[:, None]
    held = np.where((TIME_S % 10.0 < 1.0)[:, None], 0.0, 0.3)
    chatter = 1e-3 * np.random.default_rng(3).standard_normal((len(TIME_S), JOINTS))
    for still in (held, held + chatter):
        asked = [np.where(rests, still, commanded(seed)) for seed in (8, 9)]
        assert found_in(asked, asked, noise_nm) is None
        assert found_in(asked, [each * SAG for each in asked], noise_nm) is not None


def test_what_depends_on_how_large_or_fast_a_torque_is_does_not_change_with_time():
    """Currents in whole steps that are cut, a gear that rubs before the sensor, and a current that is smoothed."""
    loud = np.where(TIME_S < 10.0, 0.4, 1.6)[:, None]
    asked = [loud * commanded(seed) for seed in (11, 12)]
    cut = [0.02 * np.trunc(each / 0.02) for each in asked]
    rubs = [each - 0.02 * np.sign(np.gradient(each, axis=0)) for each in asked]
    smoothed = [lfilter([0.4], [1.0, -0.6], each, axis=0) for each in asked]
    for felt in (cut, rubs, smoothed):
        assert found_in(asked, felt, 0.002) is None


def test_too_few_joints_or_rows_tell_nothing_and_each_recording_has_its_own_rate():
    asked = commanded(7)
    felt = measured(asked * SAG, 7)
    alone = np.where(np.arange(JOINTS) == 0, asked, np.nan)
    assert changing_share([alone], [felt], [STEP_S]) is None
    assert changing_share([asked[:1000]], [felt[:1000]], [STEP_S]) is None
    assert changing_share([asked, asked[:20]], [felt, felt[:20]], [STEP_S, 0.1]) is not None
    assert changing_share([asked, asked[:5]], [felt, felt[:5]], [STEP_S, 0.1]) is not None
    two, third = (np.where((np.arange(JOINTS) == 2) == is_third, asked, np.nan) for is_third in (False, True))
    assert changing_share([two, third], [felt, felt], [STEP_S, STEP_S]) is not None
