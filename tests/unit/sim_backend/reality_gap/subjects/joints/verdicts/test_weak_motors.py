"""Many causes that the constants of all motors stand for are not named for sure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.joint_effects import SCALES
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutProblem
from sim_backend.reality_gap.subjects.joints.verdicts.weak_motors import against_weak_motors, perhaps_a_weak_supply
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.verdicts.test_unnamed_rivals import arm, followed

FITTED = ("link_mass.factor", "coulomb_friction.torque_nm", "viscous_friction.damping_nm_s_rad")


def selected(shares):
    """A study of an arm whose torques are told as such shares, and what masses and frictions of both joints come to."""
    robot, really, recordings = UnknownRobot(Tolerance()), arm(0.8, 0.15), []
    if shares == (1.0, 1.0):  # a lighter link and less friction instead
        really.body_mass[2], really.body_inertia[2] = 0.8 * really.body_mass[2], 0.8 * really.body_inertia[2]
        really.dof_frictionloss[:] *= [0.4, 0.5]
    for seed in (1, 2):
        recording = followed(really, 1.0, seed)
        assert recording.joints is not None and recording.joints.commanded_torque_nm is not None
        told = recording.joints.commanded_torque_nm * shares
        recordings.append(replace(recording, joints=replace(recording.joints, commanded_torque_nm=told)))
    study = study_joints(arm(0.8, 0.15), recordings, lambda *_: None, robot=robot, gate=np.inf)
    problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)
    terms = tuple(Term(key, joint, 0.01 * SCALES[key]) for key in FITTED for joint in (0, 1))
    taken = (SimpleNamespace(terms=terms),)
    fit, nominal = problem.fitted(problem.start, terms), problem.fitted(problem.start, ())
    return study, SimpleNamespace(problem=problem, fit=fit, nominal=nominal, taken=taken)


@pytest.mark.parametrize("shares", [(0.8, 0.785), (1.0, 1.0)], ids=["weak motors", "a lighter link with less friction"])
def test_causes_that_are_more_than_motors_stand_beside_the_constants_of_all(shares):
    study, selection = selected(shares)
    found = against_weak_motors(Verdict(VerdictKind.NAMED, "Many."), study, selection, (True, True))
    constants = {cause.where: cause.value for cause in found.causes if cause.effect == "torque_constant"}
    if shares == (1.0, 1.0):
        assert found.verdict is VerdictKind.NAMED and not constants
    else:
        assert found.verdict is VerdictKind.CONFUSABLE and "all motors (2)" in found.summary
        assert constants == pytest.approx({"upper": 1 / 0.8 - 1, "lower": 1 / 0.785 - 1}, abs=0.05)
    few = SimpleNamespace(**vars(selection) | {"taken": (SimpleNamespace(terms=selection.taken[0].terms[:2]),)})
    assert against_weak_motors(Verdict(VerdictKind.NAMED, "Two."), study, few, (True, True)).verdict is VerdictKind.NAMED


def warm(*joints: str) -> list[Cause]:
    return [Cause("thermal_derating", "loss_per_k", joint, 0.01, "1/K", (0.005, 0.015)) for joint in joints]


@pytest.mark.parametrize(
    ("joints", "is_driven", "rise_k", "is_doubted"),
    [
        (("upper", "lower"), (True, True), None, True),
        (("upper",), (True, True), None, False),
        (("upper",), (True, False), None, True),
        (("upper", "lower"), (True, True), 20.0, False),
    ],
    ids=["all", "one of two", "the only one", "temperatures are known"],
)
def test_motors_that_all_get_weaker_may_have_a_weak_supply(joints, is_driven, rise_k, is_doubted):
    path = SimpleNamespace(joints=SimpleNamespace(temperature_rise_k=rise_k))
    study = SimpleNamespace(problem=SimpleNamespace(names=("upper", "lower"), episodes=[SimpleNamespace(path=path)]))
    found = perhaps_a_weak_supply(study, warm(*joints), is_driven)  # pyrefly: ignore[bad-argument-type]
    assert [doubt.cause.where for doubt in found] == (list(joints) if is_doubted else [])
