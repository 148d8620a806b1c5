"""Readings that stand still and catch up are an encoder's fault; what stands for other reasons is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.measured.sensor_noise import encoder_step
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.signs.standing_readings import against_standing_readings, standing_readings
from sim_backend.reality_gap.verdict import EffectJudged, Told, Verdict, VerdictKind

STEP_S, ROWS, NOISE_RAD = 0.004, 5000, 1e-4
NAMES = ("shoulder", "elbow")
BEGINS = np.arange(450, 4900, 400)


def moved() -> np.ndarray:
    at = STEP_S * np.arange(ROWS)
    noise = NOISE_RAD * np.random.default_rng(1).normal(size=(ROWS, 2))
    return np.stack([1.5 * np.sin(3.0 * at), 1.2 * np.sin(2.3 * at + 1.0)], axis=1) + noise


def held(position_rad: np.ndarray, joints: list[int], begins: np.ndarray, rows: int) -> np.ndarray:
    """The same where the readings of some joints stay what they were for some rows."""
    found = position_rad.copy()
    for begin in begins:
        found[begin : begin + rows, joints] = found[begin - 1, joints]
    return found


def of(position_rad: np.ndarray, step_s: float = STEP_S):
    joints = JointSignals(NAMES[-position_rad.shape[1] :], position_rad, commanded_torque_nm=np.zeros_like(position_rad))
    path = SimpleNamespace(joints=joints, step_s=step_s, encoder_step_rad=encoder_step(position_rad))
    return [SimpleNamespace(path=path)]


@pytest.mark.parametrize("rows", [2, 3, 8])
def test_an_encoder_that_stands_still_by_itself_is_seen(rows: int):
    (found,) = standing_readings(of(held(moved(), [1], BEGINS, rows)), NAMES)
    assert found.joint == "elbow"
    assert 3 <= found.times <= len(BEGINS)
    assert found.longest_s == pytest.approx(rows * STEP_S)


def test_a_slow_joint_of_a_fast_recording_is_looked_at_over_several_rows():
    """From row to row it moves by less than four times its noise."""
    at = 1e-3 * np.arange(ROWS)
    noise = NOISE_RAD * np.random.default_rng(1).normal(size=(ROWS, 2))
    slow = np.stack([0.19 * np.sin(1.3 * at), 0.15 * np.sin(2.3 * at + 1.0)], axis=1) + noise
    dropped = held(slow, [1], BEGINS, 42)
    (found,) = standing_readings(of(dropped, 1e-3), NAMES)
    assert found.joint == "elbow" and 3 <= found.times <= len(BEGINS)
    assert found.longest_s == pytest.approx(0.042, abs=0.008)
    assert standing_readings(of(slow, 1e-3), NAMES) == []
    assert standing_readings(of(dropped, 1e-2), NAMES) == [], "rows of 10 ms are not thinned out"


@pytest.mark.parametrize(
    "position_rad",
    [
        moved(),
        held(moved(), [0, 1], BEGINS, 3),
        held(moved(), [1], BEGINS[:2], 3),
        held(moved(), [1], BEGINS, 1),
        held(moved(), [1], np.arange(5, ROWS - 5, 4), 2),
        np.where((np.arange(ROWS) > 2000)[:, None] & (np.arange(ROWS) < 2400)[:, None], np.nan, moved()),
        np.round(moved() / 0.02) * 0.02,
    ],
    ids=[
        "nothing",
        "rows that are written twice",
        "twice only",
        "for one row",
        "slower than it is written",
        "a gap",
        "coarse steps",
    ],
)
def test_what_stands_for_other_reasons_is_none(position_rad: np.ndarray):
    assert standing_readings(of(position_rad), NAMES) == []


def test_of_one_joint_it_must_last_longer():
    alone = [moved()[:, 1:], held(moved(), [1], BEGINS, 2)[:, 1:], held(moved(), [1], BEGINS, 3)[:, 1:]]
    assert [len(standing_readings(of(positions), NAMES[1:])) for positions in alone] == [0, 0, 1]


def test_a_joint_that_is_stopped_comes_after_by_and_by():
    speed = np.diff(moved(), axis=0, prepend=0.0)[:, 1]
    for begin in BEGINS:
        speed[begin : begin + 3] = 0.0
        speed[begin + 3 : begin + 9] *= 1.5
    position = moved()
    position[:, 1] = np.cumsum(speed)
    assert standing_readings(of(position), NAMES) == []


def test_it_stands_before_whatever_else_is_said():
    episodes = of(held(moved(), [1], BEGINS, 3))
    effects = (EffectJudged("viscous_friction", Told.NAMED), EffectJudged("gravity", Told.EXCLUDED, 0.1, "m/s^2"))
    named = Verdict(verdict=VerdictKind.NAMED, summary="Friction.", effects=effects)
    said = against_standing_readings(named, episodes, NAMES)
    assert said.verdict is VerdictKind.UNEXPLAINED
    assert "encoder of elbow stood still" in said.summary
    assert said.summary.endswith("Friction.")
    assert [each.told for each in said.effects] == [Told.NOT_JUDGED, Told.EXCLUDED]
    nothing = Verdict(verdict=VerdictKind.NOTHING_WRONG, summary="")
    assert against_standing_readings(nothing, of(moved()), NAMES) is nothing
