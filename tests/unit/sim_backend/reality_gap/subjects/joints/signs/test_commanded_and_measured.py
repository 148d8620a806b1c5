"""What lies between commanded and measured torque: delays of some rows, and ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from sim_backend.reality_gap.subjects.joints.signs.commanded_and_measured import between, causes_between

MOST = 40


def commanded(seed: int, rows: int = 3000) -> np.ndarray:
    """Slow sines and what a controller adds of noise."""
    rng, time = np.random.default_rng(seed), np.arange(rows)
    return 0.6 * np.sin(0.01 * time + seed) + 0.3 * np.sin(0.043 * time) + 0.02 * rng.standard_normal(rows)


def late(series: np.ndarray, rows: int) -> np.ndarray:
    return np.concatenate([np.full(rows, series[0]), series[: len(series) - rows]])


@pytest.mark.parametrize("rows", [0, 1, 3, 12])
def test_a_delay_is_counted_in_rows(rows):
    sent, rng = [commanded(1), commanded(2)], np.random.default_rng(0)
    measured = [late(each, rows) + 0.01 * rng.standard_normal(len(each)) for each in sent]
    found = between(sent, measured, MOST)
    assert found is not None and found.late_rows == rows and not np.isfinite(found.limit_nm) and not found.may_be_filter


def test_a_current_that_rises_through_a_coil_is_no_delay():
    sent, rng = [commanded(1), commanded(2)], np.random.default_rng(0)
    risen = [lfilter([0.2], [1.0, -0.8], each, zi=[0.8 * each[0]])[0] for each in sent]
    found = between(sent, [each + 0.003 * rng.standard_normal(len(each)) for each in risen], MOST)
    assert found is not None and found.late_rows > 1 and found.is_filter


def test_a_limit_is_seen_where_commands_go_beyond_it_also_after_a_delay():
    sent, rng = [commanded(3)], np.random.default_rng(0)
    measured = [np.clip(late(each, 4), -0.5, 0.5) + 0.005 * rng.standard_normal(len(each)) for each in sent]
    found = between(sent, measured, MOST)
    assert found is not None and found.late_rows == 4
    assert abs(found.limit_nm - 0.5) < 2.0 * found.limit_error_nm < 0.02


def test_a_motor_that_gives_less_than_asked_has_neither():
    sent, rng = [commanded(4)], np.random.default_rng(0)
    measured = [0.8 * each + 0.05 * rng.standard_normal(len(each)) for each in sent]
    found = between(sent, measured, MOST)
    assert found is not None and found.late_rows == 0 and not np.isfinite(found.limit_nm)


def test_a_supply_that_sags_for_seconds_is_neither_and_what_noise_and_a_zero_leave_is_nothing():
    sent, rng = [commanded(6)], np.random.default_rng(0)
    sags = 1.0 - 0.15 * (1.0 + np.sin(0.002 * np.arange(3000)))
    measured = [0.9 * each + 0.02 + 0.05 * rng.standard_normal(len(each)) for each in sent]
    plain, sagging = between(sent, measured, MOST), between(sent, [measured[0] * sags], MOST)
    assert plain is not None and sagging is not None
    assert plain.unlike < 0.02 and sagging.unlike > 0.06
    late_and_cut = between(sent, [np.clip(late(sent[0], 4), -0.5, 0.5)], MOST)
    assert late_and_cut is not None and late_and_cut.unlike < 0.01


def test_noise_that_has_nothing_to_do_with_the_command_is_no_delay():
    rng = np.random.default_rng(7)
    found = between([commanded(5)], [rng.standard_normal(3000)], MOST)
    assert found is not None and found.late_rows == 0 and not np.isfinite(found.limit_nm)


def test_what_cannot_be_compared_is_not():
    assert between([np.zeros(3000)], [np.zeros(3000)], MOST) is None, "a command that does not change"
    assert between([commanded(1, 150)], [commanded(1, 150)], MOST) is None, "too few rows"
    gaps = np.where(np.arange(3000) % 20 > 0, np.nan, commanded(6))
    assert between([gaps], [gaps], MOST) is None, "too few rows without gaps"


def test_a_share_that_changes_at_all_joints_is_told_beside_delays_and_without_joints_at_their_limit():
    rng, names = np.random.default_rng(0), ("a", "b", "c")
    sags = 1.0 - 0.03 * np.sin(2.0 * np.pi * np.arange(6000) / 1200)

    def episode(seed: int, sags) -> SimpleNamespace:
        sent = np.stack([commanded(3 * seed + j, 6000) for j in range(3)], axis=1)
        felt = np.stack([late(sags * sent[:, 0], 4), np.clip(sags * sent[:, 1], -0.3, 0.3), sags * sent[:, 2]], axis=1)
        felt += 0.005 * rng.standard_normal(felt.shape)
        return SimpleNamespace(
            path=SimpleNamespace(step_s=0.005, joints=SimpleNamespace(commanded_torque_nm=sent, measured_torque_nm=felt))
        )

    for share, is_told in ((sags, True), (np.ones(6000), False)):
        found = causes_between([episode(1, share), episode(2, share)], names)  # pyrefly: ignore[bad-argument-type]
        assert [(cause.effect, cause.where) for cause in found.causes] == [("action_delay", "a"), ("torque_saturation", "b")]
        assert len(found.unlike) == is_told and all("at all joints alike: 97% to 103%" in said for said in found.unlike)
        assert found.doubts == []


@pytest.mark.parametrize(
    "smoothed",
    [
        lambda torque: lfilter(*butter(1, 0.1), torque),
        lambda torque: lfilter(*butter(2, 0.1), torque),
        lambda torque: lfilter(np.full(5, 0.2), [1.0], torque),
    ],
    ids=["first order", "second order", "mean of five"],
)
@pytest.mark.parametrize("noise_nm", [0.0, 0.003, 0.03])
def test_a_torque_that_is_smoothed_is_no_delay_for_sure(smoothed, noise_nm):
    rng, sent = np.random.default_rng(0), np.stack([commanded(1), commanded(2)], axis=1)
    felt = np.stack([smoothed(column) for column in sent.T], axis=1) + noise_nm * rng.standard_normal(sent.shape)
    joints = SimpleNamespace(commanded_torque_nm=sent, measured_torque_nm=felt)
    speed = np.cumsum(sent, axis=0) * 0.01  # of a mass of 1 kg m^2 that nothing else moves
    episode = SimpleNamespace(path=SimpleNamespace(step_s=0.01, joints=joints, fast_velocity=speed))
    found = causes_between([episode], ("a", "b"))  # pyrefly: ignore[bad-argument-type]
    for place, told in found.smoothed.items():
        j = "ab".index(place)
        images = np.stack([speed[:, j], np.gradient(speed[:, j], 0.01)], axis=1)
        expected = np.abs(np.linalg.lstsq(images, sent[:, j] - felt[:, j], rcond=None)[0])
        np.testing.assert_allclose(told, expected)
    assert {cause.where for cause in found.causes} == {doubt.cause.where for doubt in found.doubts}
    assert found.unlike == [], "a filter explains it"
    assert noise_nm > 0.01 or found.causes or len(found.open) == 2
