"""Another damping of a stated controller is told beside the frictions and gains that move a joint as it does."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.subjects.joints.verdicts.stated_dampings import perhaps_other_damping, plain_dampings
from sim_backend.reality_gap.subjects.joints.verdicts.torques_and_rollouts import in_both
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

NAMES, SAMPLES, ROW_S = ("near", "far"), 50, 0.004
STIFFNESS, DAMPING = 60.0, 2.0
INERTIA_KG_M2 = 0.01
RUBS = Cause("viscous_friction", "damping_nm_s_rad", "near", 1.0, "N m s/rad", (0.9, 1.1))
LIGHTER = Cause("rotor_inertia", "armature_kg_m2", "near", 0.0075, "kg m^2", (0.0065, 0.0085))
GAIN = Cause("position_gain", "factor", "near", 1.5, "", (1.45, 1.55))
WEAK = Cause("torque_constant", "error", "near", -0.33, "", (-0.36, -0.3))


def law(**other: float) -> Feedback:
    """A PD controller of the first joint alone."""
    numbers = {"target_rad": 0.1, "stiffness_nm_rad": STIFFNESS, "damping_nm_s_rad": DAMPING, "limit_nm": np.inf}
    numbers |= {"back_emf_nm_s_rad": 0.0, "desired_nm": 0.0, "on_board": 0.0, **other}
    return Feedback(
        **{name: np.column_stack([np.full(SAMPLES, value), np.full(SAMPLES, np.nan)]) for name, value in numbers.items()}
    )


def doubted(*causes: Cause, damping=DAMPING) -> dict[str, str]:
    nominal = {LIGHTER.effect: INERTIA_KG_M2}
    found = perhaps_other_damping(causes, NAMES, np.array([damping, np.nan]), lambda cause: nominal.get(cause.effect, 0.0), ROW_S)
    return {doubt.cause.effect: doubt.other for doubt in found}


@pytest.mark.parametrize(
    ("causes", "share"),
    [
        ((RUBS,), "1.5"),
        ((replace(RUBS, where="far"),), ""),
        ((replace(RUBS, value=-2.5),), ""),
        ((GAIN, WEAK), "0.67"),
        ((GAIN, replace(WEAK, where="far")), ""),
        ((GAIN, replace(WEAK, value=-0.2, interval_90=(-0.23, -0.17))), ""),
        ((GAIN,), ""),
        ((WEAK,), ""),
    ],
    ids=["friction", "torques are recorded", "more than all", "two for one", "elsewhere", "stiffer, too", "gain", "constant"],
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


@pytest.mark.parametrize(
    ("other", "is_plain"),
    [({}, True), ({"desired_nm": 0.5}, False), ({"back_emf_nm_s_rad": 0.1, "damping_nm_s_rad": 0.0}, False)],
    ids=["nothing else", "torque beside", "a voltage"],
)
def test_only_a_controller_that_sends_nothing_else_is_a_friction(other, is_plain):
    found = plain_dampings([law(), law(**other)])
    assert np.isnan(found[1]) and (found[0] == DAMPING if is_plain else np.isnan(found[0]))


def test_a_motion_that_was_named_is_open_then():
    named = Verdict(VerdictKind.NAMED, "The robot goes where …", (GAIN, WEAK))
    doubts = perhaps_other_damping(named.causes, NAMES, np.array([DAMPING, np.nan]), lambda _: 0.0, ROW_S)
    found = in_both(Verdict(VerdictKind.NOTHING_WRONG, "…"), named, (), doubts)
    assert found.verdict is VerdictKind.CONFUSABLE and "damps 0.67 times as much as is stated" in found.summary
    assert found.record_next == ("the torques that the controller of near sends, beside its targets",)
