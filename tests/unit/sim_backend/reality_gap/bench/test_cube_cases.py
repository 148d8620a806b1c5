"""Cases of the blind test on cubes."""

import numpy as np
import pytest

from sim_backend.reality_gap.bench.cube_cases import (
    LEVELS,
    effect_cases,
    hidden_physics,
    joint_cases,
    load_evidence,
    null_cases,
    save_evidence,
)
from sim_backend.reality_gap.knowledge.hidden import OF_CUBE
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.replay import Replayed
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics

LIMITS = load_calibration().limits


def test_cases_take_every_effect_at_every_level_and_are_the_same_again():
    cases = effect_cases(len(OF_CUBE) * len(LEVELS), 5, LIMITS)
    assert {(case.effect, case.level) for case in cases} == {(effect, level) for effect in OF_CUBE for level in LEVELS}
    assert cases == effect_cases(len(cases), 5, LIMITS)
    assert cases != effect_cases(len(cases), 6, LIMITS)


def test_seeds_are_those_of_no_other_case_and_of_no_healthy_session_of_the_table():
    seeds = [case.seed for case in effect_cases(70, 81, LIMITS) + null_cases(50, 81) + joint_cases(10, 81)]
    assert len(set(seeds)) == len(seeds)
    for first, count in load_calibration().seeds:
        assert not set(seeds) & set(range(first, first + count))


def test_the_effect_is_hidden_and_everything_else_is_healthy():
    case = next(case for case in effect_cases(7, 5, LIMITS) if case.effect == "cube_mass")
    physics = hidden_physics(case)
    assert physics.value("cube_mass.factor") == pytest.approx(case.value)
    assert abs(physics.value("table_friction.coefficient")[0] - 1.0) <= 0.02


def test_an_error_of_a_joint_is_at_one_joint():
    case = joint_cases(1, 5)[0]
    values = hidden_physics(case).value(case.effect)[0]
    assert (values == case.value[0]).sum() == 1
    assert hidden_physics(null_cases(1, 5)[0]).value(case.effect).max() < case.value[0]


def test_evidence_is_kept_and_read_again(tmp_path):
    tracker = TrackerStatistics(500, 0.1, 0.09, 0.003, 1, 2, 3, 450, 0.0325, 0.001, 0.012, 0.92)
    pushes = tuple(Replayed(np.full((3, k), float(k)), np.arange(k), np.arange(k) * 0.1) for k in (2, 4))
    save_evidence(tmp_path / "case.npz", CubeEvidence(tracker, pushes))
    read = load_evidence(tmp_path / "case.npz")
    assert read.tracker == tracker
    assert [push.residual.tolist() for push in read.replayed] == [push.residual.tolist() for push in pushes]
