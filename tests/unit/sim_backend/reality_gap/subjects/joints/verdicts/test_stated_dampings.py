"""Another damping of a stated controller is told beside the frictions and gains that move a joint as it does."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.verdicts.stated_dampings import (
    are_asked_for_torques,
    braking_dampings,
    perhaps_other_damping,
)
from sim_backend.reality_gap.subjects.joints.verdicts.torques_and_rollouts import in_both
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

NAMES, SAMPLES, ROW_S = ("near", "far"), 50, 0.004
STIFFNESS, DAMPING = 60.0, 2.0
INERTIA_KG_M2 = 0.01
RUBS = Cause("viscous_friction", "damping_nm_s_rad", "near", 1.0, "N m s/rad", (0.9, 1.1))
LIGHTER = Cause("rotor_inertia", "armature_kg_m2", "near", 0.0075, "kg m^2", (0.0065, 0.0085))
GAIN = Cause("position_gain", "factor", "near", 1.5, "", (1.45, 1.55))
WEAK = Cause("torque_constant", "error", "near", -0.33, "", (-0.36, -0.3))


def of_law(desired_torque_nm: float | None = None, **other: float) -> JointSignals:
    """What a PD controller of the first joint alone drives."""
    numbers = {"target_rad": 0.1, "stiffness_nm_rad": STIFFNESS, "damping_nm_s_rad": DAMPING, "limit_nm": np.inf}
    numbers |= {"back_emf_nm_s_rad": 0.0, "desired_nm": 0.0, "on_board": 0.0, **other}
    law = Feedback(**{name: beside_nothing(value) for name, value in numbers.items()})
    desired_nm = None if desired_torque_nm is None else beside_nothing(desired_torque_nm)
    return JointSignals(NAMES, np.zeros((SAMPLES, 2)), desired_torque_nm=desired_nm, feedback=law)


def beside_nothing(value: float) -> np.ndarray:
    return np.column_stack([np.full(SAMPLES, value), np.full(SAMPLES, np.nan)])


def doubted(*causes: Cause, damping=DAMPING, is_asked=False) -> dict[str, str]:
    nominal = {LIGHTER.effect: INERTIA_KG_M2}
    dampings, are_asked = np.array([damping, np.nan]), np.array([is_asked, False])
    found = perhaps_other_damping(causes, NAMES, dampings, lambda cause: nominal.get(cause.effect, 0.0), ROW_S, are_asked)
    return {doubt.cause.effect: doubt.other for doubt in found}


@pytest.mark.parametrize(
    ("causes", "share"),
    [
        ((RUBS,), "1.5"),
        ((replace(RUBS, where="far"),), ""),
        ((replace(RUBS, value=-2.5),), ""),
        ((replace(RUBS, value=25.0),), ""),
        ((GAIN, WEAK), "0.67"),
        ((GAIN, replace(WEAK, where="far")), ""),
        ((GAIN, replace(WEAK, value=-0.2, interval_90=(-0.23, -0.17))), ""),
        ((GAIN,), ""),
        ((WEAK,), ""),
    ],
    ids=[
        "friction",
        "torques are recorded",
        "more than all",
        "far more than is stated",
        "two for one",
        "elsewhere",
        "stiffer, too",
        "gain",
        "constant",
    ],
)
def test_what_another_damping_is_instead(causes, share):
    found = doubted(*causes)
    assert set(found) == ({cause.effect for cause in causes} if share else set())
    assert all(f"damps {share} times as much as is stated" in said for said in found.values())


def test_what_a_held_damping_takes_of_a_rotor_is_doubted_with_it():
    assert set(doubted(RUBS, LIGHTER)) == {"viscous_friction", "rotor_inertia"}
    assert set(doubted(RUBS, replace(LIGHTER, value=0.012))) == {"viscous_friction"}
    assert set(doubted(RUBS, replace(LIGHTER, value=0.003))) == {"viscous_friction"}
    assert not doubted(LIGHTER)


def test_torques_that_a_controller_adds_show_what_its_motor_makes_of_them_and_not_what_it_damps():
    assert set(doubted(RUBS, LIGHTER, is_asked=True)) == {"viscous_friction", "rotor_inertia"}
    assert not doubted(GAIN, WEAK, is_asked=True)
    asked = of_law(0.5, desired_nm=0.5)
    assert are_asked_for_torques([of_law(), asked]).tolist() == [True, False]
    assert not are_asked_for_torques([of_law(), JointSignals(NAMES, np.zeros((SAMPLES, 2)))]).any()


@pytest.mark.parametrize(
    ("other", "brakes"),
    [
        ({}, True),
        ({"desired_torque_nm": 0.5, "desired_nm": 0.5}, True),
        ({"desired_nm": 0.5}, False),
        ({"desired_torque_nm": 0.5, "desired_nm": 0.7}, False),
        ({"back_emf_nm_s_rad": 0.1, "damping_nm_s_rad": 0.0}, False),
    ],
    ids=["nothing else", "torque beside", "velocity beside", "both beside", "a voltage"],
)
def test_only_a_controller_whose_targets_have_no_velocity_is_a_friction(other, brakes):
    found = braking_dampings([of_law(), of_law(**other)])
    assert np.isnan(found[1]) and (found[0] == DAMPING if brakes else np.isnan(found[0]))
    assert np.isnan(braking_dampings([of_law(), JointSignals(NAMES, np.zeros((SAMPLES, 2)))])).all()


def test_of_controllers_that_damp_differently_no_factor_is_one_friction():
    assert np.isnan(braking_dampings([of_law(damping_nm_s_rad=1.0), of_law(damping_nm_s_rad=4.0)])).all()


def test_a_motion_that_was_named_is_open_then():
    named = Verdict(VerdictKind.NAMED, "The robot goes where …", (GAIN, WEAK))
    doubts = perhaps_other_damping(named.causes, NAMES, np.array([DAMPING, np.nan]), lambda _: 0.0, ROW_S, np.zeros(2))
    found = in_both(Verdict(VerdictKind.NOTHING_WRONG, "…"), named, (), doubts)
    assert found.verdict is VerdictKind.CONFUSABLE and "damps 0.67 times as much as is stated" in found.summary
    assert found.record_next == ("the torques that the controller of near sends, beside its targets",)
