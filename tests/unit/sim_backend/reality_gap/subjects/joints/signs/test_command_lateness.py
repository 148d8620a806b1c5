"""How late commands came, from how many samples each one was awaited."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.signs.command_lateness import lateness_std_s, with_measured_lateness
from sim_backend.reality_gap.subjects.joints.torques.fit import JointFit
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import LateCommands, SentTorque
from sim_backend.trifinger import constants as c

STEP_S = 1e-3
REST_RAD = np.tile([0.0, 0.9, -1.7], 3)


@pytest.mark.parametrize("std_s", [0.0004, 0.001, 0.003])
def test_the_scale_of_half_normal_lateness_is_found_from_rounded_counts(std_s):
    late = np.round(std_s / STEP_S * np.abs(np.random.default_rng(2).standard_normal(4000)))
    found, error = lateness_std_s(late, STEP_S)
    assert found == pytest.approx(std_s, abs=3.5 * error)
    assert error < 0.05 * std_s


def test_commands_that_come_in_time_are_not_late():
    assert lateness_std_s(np.zeros(100), STEP_S)[0] == 0.0


def test_each_target_is_late_by_the_samples_in_which_the_one_before_it_acts():
    steps, late = 400, (0, 3, 1, 0, 5, 2, 0)
    offset = 0.02 * np.random.default_rng(3).standard_normal((len(late) + 1, 9))
    target = np.repeat(REST_RAD + offset, steps // 8, axis=0)
    acting = target.copy()
    for index, samples in enumerate(late, start=1):
        start = index * steps // 8
        acting[start : start + samples] = target[start - 1]
    nothing, state = np.zeros((steps, 9)), JointState(9)

    def pipeline(targets: np.ndarray, sent: np.ndarray) -> SentTorque:
        signals = {"velocity_rad_s": nothing, "position_target_rad": targets, "desired_torque_nm": nothing}
        return SentTorque(JointSignals(c.JOINT_NAMES, nothing + REST_RAD, commanded_torque_nm=sent, **signals), sent, STEP_S)

    sent = -pipeline(acting, nothing).residual(state)
    found = pipeline(target, sent).late_commands(state)
    assert found.steps.tolist() == list(late)
    sent[3 * steps // 8 + 7] = np.nan
    assert pipeline(target, sent).late_commands(state).steps.tolist() == [*late[:2], *late[3:]], (
        "what is not known is not counted"
    )
    assert found.left < 1e-12 < found.beside


TERM = Term("timing_jitter.std_s", 0, 1e-3)


def measured(std_s=0.001, *, left=0.01, is_of_many=True, excluded=(), accepted=(), steps=None) -> JointFit:
    """What is made of a fit that has not seen the lateness of 2000 commands."""
    steps = np.round(std_s / STEP_S * np.abs(np.random.default_rng(5).standard_normal(2000))) if steps is None else steps
    episode = SimpleNamespace(late_commands=lambda _: LateCommands(steps, 40.0, 40.0 * left), path=SimpleNamespace(step_s=STEP_S))
    look = SimpleNamespace(catalogue=SimpleNamespace(terms=(Term("action_delay.delay_s", 0, 1e-3), TERM)))
    empty = dict.fromkeys(field.name for field in fields(JointFit))
    problem = SimpleNamespace(episodes=(episode,), excluded=excluded, is_of_many=is_of_many)
    fit = JointFit(**(empty | {"problem": problem, "accepted": accepted, "state": JointState(9), "errors": {}, "looks": (look,)}))
    return with_measured_lateness(problem, fit)  # pyrefly: ignore[bad-argument-type] - what is looked at of it


def test_late_commands_are_a_cause_though_the_fit_saw_none():
    fit = measured()
    (cause,) = fit.accepted
    assert (cause.effect, cause.where, cause.terms) == ("timing_jitter", PLATFORM, (TERM,))
    assert cause.gain > 1000.0
    (error_s,) = fit.errors["timing_jitter", PLATFORM]
    assert fit.state.value("timing_jitter.std_s")[0] == pytest.approx(0.001, abs=3.5 * error_s)


def test_what_the_fit_saw_is_counted_and_stays_the_only_one():
    seen = Accepted("timing_jitter", PLATFORM, (TERM,), 50.0)
    fit = measured(0.0002, accepted=(seen,))
    assert fit.accepted == (seen,)
    assert 0.0 < fit.state.value("timing_jitter.std_s")[0] < 0.0004


@pytest.mark.parametrize(
    "otherwise",
    [{"std_s": 0.0003}, {"left": 0.5}, {"is_of_many": False}, {"excluded": ("timing_jitter",)}, {"steps": np.ones(2000)}],
    ids=["too little", "something else", "the fit would see it", "left out", "a shifted log"],
)
def test_no_cause_is_made_of_counts_that_may_be_something_else(otherwise):
    assert measured(**otherwise).accepted == ()
