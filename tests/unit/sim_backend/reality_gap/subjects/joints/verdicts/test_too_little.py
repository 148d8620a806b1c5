"""What is smaller than a detection limit is no name for a TriFinger."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.healthy import STANDARD_S, detection_limit
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.verdicts.causes import is_too_little, too_little_beside
from sim_backend.reality_gap.verdict import Cause

HEAVIER = detection_limit("link_mass.factor", STANDARD_S)


def mass(by: float) -> Cause:
    return Cause("link_mass", "factor", "lower", 1.0 + by, "share", (1.0, 1.0 + 2.0 * by))


def study(seconds: float = STANDARD_S, *fitted: str, robot=KnownTriFinger, is_of_many: bool = False) -> SimpleNamespace:
    path = SimpleNamespace(step_s=0.001, velocity=np.zeros((round(1000 * seconds), 1)))
    absent = {"link_mass.factor": 1.0}
    return SimpleNamespace(
        robot=object.__new__(robot),
        is_of_many=is_of_many,
        fit=SimpleNamespace(accepted=[SimpleNamespace(effect=effect) for effect in fitted or ("link_mass",)]),
        problem=SimpleNamespace(episodes=[SimpleNamespace(path=path)], names=("lower",)),
        problem_start=lambda key, _: absent.get(key, 0.0),
    )


@pytest.mark.parametrize(("share", "is_little"), [(0.9, True), (1.1, False), (-0.9, True), (-1.1, False)])
def test_what_is_smaller_than_its_limit_is_too_little(share: float, is_little: bool):
    assert is_too_little(study(), [mass(share * HEAVIER)]) is is_little


def test_longer_sessions_show_less():
    assert not is_too_little(study(4.0 * STANDARD_S), [mass(0.6 * HEAVIER)])
    assert is_too_little(study(STANDARD_S / 4.0), [mass(0.9 * HEAVIER)])
    assert detection_limit("link_mass.factor", STANDARD_S / 4.0) == HEAVIER, "a short session's own limit was not measured"


def test_the_other_axis_of_a_tilt_has_the_first_one_s_limit():
    assert detection_limit("table_tilt.pitch_rad", STANDARD_S) == detection_limit("table_tilt.roll_rad", STANDARD_S) > 0.0
    assert detection_limit("cogging.phase_rad", STANDARD_S) == 0.0


def test_only_what_was_fitted_in_a_single_cause_s_session_of_a_trifinger():
    little = [mass(0.5 * HEAVIER)]
    assert not is_too_little(study(STANDARD_S, "backlash"), little), "found without a fit"
    assert not is_too_little(study(robot=UnknownRobot), little)
    assert not is_too_little(study(is_of_many=True), little)
    rubs = Cause("coulomb_friction", "torque_nm", "lower", 0.05, "N m", (0.04, 0.06))
    assert not is_too_little(study(STANDARD_S, "link_mass", "coulomb_friction"), [*little, rubs])


def test_beside_a_cause_that_is_large_enough_the_little_ones_are_no_names_either():
    seen = study(STANDARD_S, "link_mass", "coulomb_friction")
    little, rubs = mass(0.5 * HEAVIER), Cause("coulomb_friction", "torque_nm", "lower", 0.05, "N m", (0.04, 0.06))
    assert too_little_beside(seen, [little, rubs]) == [little]
    assert too_little_beside(seen, [mass(2.0 * HEAVIER), rubs]) == []
    assert too_little_beside(seen, [little]) == [], "a verdict says so of what is alone"


def test_a_loss_by_heat_counts_with_the_rise_that_it_is_told_for():
    limit = detection_limit("thermal_derating.loss_per_k", STANDARD_S)

    def heat(parameter: str, value: float) -> Cause:
        return Cause("thermal_derating", parameter, "lower", value, "", (value, value))

    seen = study(STANDARD_S, "thermal_derating")
    usual = PARAMETERS["thermal_derating.rise_k_nm2"].absent
    assert not is_too_little(seen, [heat("loss_per_k", 0.4 * limit), heat("rise_k_nm2", 3.0 * usual)])
    assert is_too_little(seen, [heat("loss_per_k", 0.4 * limit), heat("rise_k_nm2", 2.0 * usual)])
    assert is_too_little(seen, [heat("loss_per_k", 0.9 * limit)])
