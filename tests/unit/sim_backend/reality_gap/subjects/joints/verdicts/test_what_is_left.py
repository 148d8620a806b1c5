"""When what is left, or what no joint has clearly, makes a TriFinger's verdict unexplained."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.joint_effects import Channel, Sign
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.subjects.joints.signs.checks import Finding
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import Pattern
from sim_backend.reality_gap.subjects.joints.verdicts import verdict_of_torques
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import _filtered_noise, _is_shown, _kind
from sim_backend.reality_gap.verdict import Cause, VerdictKind

RUBS = Cause("coulomb_friction", "torque_nm", "elbow", 0.05, "N m", (0.04, 0.06))


@pytest.fixture
def kind(monkeypatch):
    """A verdict's kind: what was taken with how much it gained, what causes it left, and what is left at the elbow, nats."""

    def of(gain, causes, left, *, is_almost_explained=False, expects_many=False):
        monkeypatch.setattr(verdict_of_torques, "_almost_explained", lambda _: {1} if is_almost_explained else set())
        monkeypatch.setattr(verdict_of_torques, "_beyond_bounds", lambda _: 0.0)
        accepted = [Accepted("coulomb_friction", "all joints", (), gain)] if gain else []
        path = SimpleNamespace(step_s=0.001, velocity=np.zeros((10_000, 2)))
        study = SimpleNamespace(
            robot=KnownTriFinger(NO_SESSIONS),
            fit=SimpleNamespace(accepted=accepted),
            findings=(),
            odd=(),
            problem=SimpleNamespace(
                expects_many=expects_many, names=("shoulder", "elbow"), episodes=[SimpleNamespace(path=path)]
            ),
            is_of_many=False,
            problem_start=lambda *_: 0.0,
        )
        return _kind(study, causes, [Pattern(Channel.MECHANICS, 1, "velocity", left)], is_tie=False)[0]

    return of


def test_a_cause_of_all_joints_that_none_has_clearly_is_no_nothing(kind):
    assert kind(46.0, [], 0.0) is VerdictKind.UNEXPLAINED
    assert kind(0.0, [], 0.0) is VerdictKind.NOTHING_WRONG


def test_what_follows_a_variable_by_thrice_what_the_causes_gained_is_more_than_the_shape_of_a_law(kind):
    assert kind(83.0, [RUBS], 120.0, is_almost_explained=True) is VerdictKind.NAMED
    assert kind(83.0, [RUBS], 250.0, is_almost_explained=True) is VerdictKind.UNEXPLAINED


@pytest.mark.parametrize(("left", "found"), [(20.0, VerdictKind.NAMED), (114.0, VerdictKind.UNEXPLAINED)])
def test_a_pattern_beside_a_cause_that_gained_little_is_not_the_shape_of_its_law(kind, left, found):
    assert kind(11.0, [RUBS], left, is_almost_explained=True) is found


@pytest.mark.parametrize(("expects_many", "found"), [(False, VerdictKind.UNEXPLAINED), (True, VerdictKind.NAMED)])
def test_few_causes_leave_less_than_many(kind, expects_many, found):
    assert kind(1000.0, [RUBS], 120.0, expects_many=expects_many) is found
    assert kind(5000.0, [RUBS], 120.0, expects_many=expects_many) is VerdictKind.NAMED


def test_an_error_that_is_almost_gone_is_the_shape_of_a_law(kind):
    assert kind(1000.0, [RUBS], 120.0, is_almost_explained=True) is VerdictKind.NAMED


@pytest.mark.parametrize(("gain", "kept"), [(8.0, []), (90.0, ["velocity_filter"])])
def test_a_noisy_velocity_looks_filtered_and_no_filter_makes_noise(gain, kept):
    late = Accepted("velocity_filter", "elbow", (), gain)
    noise = Finding(Sign.VELOCITY_NOISE, 1, 0.12, (0.1, 0.14), 3.0)
    study = SimpleNamespace(
        fit=SimpleNamespace(accepted=[late], state=None, errors={("velocity_filter", "elbow"): np.zeros(0)}),
        start=None,
        is_of_many=False,
        findings=[noise],
        problem=SimpleNamespace(names=("shoulder", "elbow")),
        robot=KnownTriFinger(NO_SESSIONS),
    )
    causes = [Cause("velocity_filter", "time_constant_s", "elbow", 3e-4, "s", (2e-4, 4e-4))]
    assert [cause.effect for cause in causes if cause not in _filtered_noise(causes, study)] == kept
    assert _is_shown(noise, study) is not bool(kept)
