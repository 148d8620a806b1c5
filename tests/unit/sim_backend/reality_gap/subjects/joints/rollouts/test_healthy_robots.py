"""What robots that nothing is wrong with stay below, at all of their joints together."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.rollouts import healthy_robots
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import (
    _MARGIN,
    _MARGIN_OF_RIGID,
    DrawnRobots,
    Enough,
    Healthy,
    _below,
)
from sim_backend.reality_gap.subjects.joints.rollouts.limits import enough_of, limits_by
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_WINDOWS, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.tolerated import _bearings
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import PENDULUM, problem_of, recorded, targets

_NOTHING = Enough(np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))


@pytest.mark.parametrize("joints", [1, 7])
def test_of_healthy_robots_one_in_twenty_is_further_off_at_any_of_its_joints(joints: int):
    off_rad = np.abs(np.random.default_rng(2).standard_normal((400, joints))) * 1e-3
    below_rad = _below(off_rad)
    assert below_rad.shape == (joints,)
    assert np.mean((off_rad > below_rad).any(axis=1)) == pytest.approx(0.05, abs=0.011)


def test_healthy_robots_are_further_off_where_more_is_tolerated():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='frictionloss="0.08"'))
    study = study_joints(model, [recorded(model, targets(8.0, 3))], lambda *_: None, robot=UnknownRobot(), gate=np.inf)

    def off(friction: float) -> float:
        tolerance = Tolerance(mass=1e-4, inertia=1e-4, centre=1e-4, friction=friction, zero=0.0, give_rad=0.0, creep_rad_s=0.0)
        problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, tolerance)
        return float(DrawnRobots(problem, np.random.default_rng(1)).coarse.as_it_is_rad[0])

    little, much = off(0.02), off(0.08)
    assert much == pytest.approx(4.0 * little, rel=0.2)


def test_a_fitted_model_is_nearer_to_a_healthy_robot_unless_its_torques_are_noisy():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='frictionloss="0.02"'))
    recording = recorded(model, targets(8.0, 3))
    assert recording.joints is not None

    def healthy(noise_nm: float) -> tuple[RolloutProblem, Healthy]:
        joints = recording.joints
        assert joints is not None and joints.commanded_torque_nm is not None
        felt = joints.commanded_torque_nm + noise_nm * np.random.default_rng(5).standard_normal(joints.commanded_torque_nm.shape)
        measured = replace(recording, joints=replace(joints, commanded_torque_nm=None, measured_torque_nm=felt))
        study = study_joints(model, [measured], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
        problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, Tolerance())
        return problem, DrawnRobots(problem, np.random.default_rng(1), 100).coarse

    problem, noisy = healthy(0.05)
    assert problem.torque_noise_nm[0] == pytest.approx(0.05, rel=0.15)
    _, quiet = healthy(0.0)
    assert 2.0 * quiet.fitted_rad[0] < quiet.as_it_is_rad[0]
    assert noisy.fitted_rad[0] > 3.0 * quiet.fitted_rad[0]
    assert noisy.fitted_far_rad[0] > noisy.fitted_rad[0], "nine windows of ten are further off than half of them"


def test_bearings_that_give_before_they_slip_are_healthy():
    """They leave much more where dry friction is told to hold still, and are fitted where it is not."""
    friction_nm, give_rad = 0.08, 5e-4
    nominal, without = (mujoco.MjModel.from_xml_string(PENDULUM.format(more=m)) for m in (f'frictionloss="{friction_nm}"', ""))
    recordings = [
        replace(
            recorded(without, targets(6.0, s), seed=s, noise_rad=2e-5, bristles_nm=friction_nm, give_rad=give_rad), name=f"{s}"
        )
        for s in (1, 2)
    ]
    study = study_joints(nominal, recordings, lambda *_: None, robot=UnknownRobot(), gate=np.inf)

    def fitted(tolerance: Tolerance):
        problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, tolerance)
        return problem.fitted(problem.start, ())

    stiff, gives = fitted(Tolerance(give_rad=0.0, creep_rad_s=0.0)), fitted(Tolerance())
    assert gives.usual_rad[0] < 0.4 * stiff.usual_rad[0] and gives.far_rad[0] < 0.4 * stiff.far_rad[0]
    assert 0.5 * give_rad < gives.state.value("bearing.give_rad")[0] <= Tolerance().give_rad


def test_bearings_are_drawn_and_fitted_within_what_is_tolerated_whatever_the_model_s_give(monkeypatch):
    problem, drawn, went = problem_of(hidden='frictionloss="0.08"'), list[np.ndarray](), healthy_robots._Model.went
    friction, give = Term("coulomb_friction.torque_nm", 0, 1e-3), Term("bearing.give_rad", 0, 1e-4)
    rubs = problem.start.moved(friction, 0.08, with_shape=False)
    monkeypatch.setattr(healthy_robots._Model, "went", lambda model, off, *rng: drawn.append(off) or went(model, off, *rng))
    for given_rad in (0.0, 8e-4):
        around = problem.begun(rubs.moved(give, given_rad, with_shape=False))
        robots = DrawnRobots(problem, np.random.default_rng(1), 60, around=around)
        (at,) = [i for i, term in enumerate(robots._terms) if term.key == give.key]
        for give_rad in (given_rad + drawn[0][:, at], given_rad + robots._off[:, at]):
            assert give_rad.min() > -1e-12 and 0.7e-3 < give_rad.max() < Tolerance().give_rad + 1e-12
        drawn.clear()


def test_bearings_of_a_slide_give_by_what_it_rolls_on():
    """Slides are counted in decimetres: 20 um are 0.2 mrad."""
    episode = SimpleNamespace(plant=SimpleNamespace(is_slide=np.array([False, True])))
    scales = {(term.key, term.index): scale for term, scale in _bearings([episode], Tolerance(give_rad=1e-3, creep_rad_s=0.02))}
    assert scales == pytest.approx(
        {
            ("bearing.give_rad", 0): 5e-4,
            ("bearing.give_rad", 1): 1e-4,
            ("bearing.creep_rad_s", 0): 0.01,
            ("bearing.creep_rad_s", 1): 0.002,
        }
    )


def test_bearings_are_asked_only_where_there_is_friction():
    problem = problem_of()
    friction = Term("coulomb_friction.torque_nm", 0, 1e-3)

    def bears(beside: list[tuple[Term, float]]) -> list[str]:
        return [term.key for term, _ in beside if term.key.startswith("bearing.")]

    assert bears(problem.beside(problem.start, ())) == []
    assert bears(problem.beside(problem.start, (friction,))) == ["bearing.give_rad", "bearing.creep_rad_s"]
    assert bears(problem.beside(problem.start.moved(friction, 0.1, with_shape=False), ())) == bears(problem.loose_terms(()))


def test_limits_are_wider_where_bearings_are_simulated_as_if_they_did_not_give(monkeypatch):
    problem = problem_of()
    narrow, enough = DrawnRobots(problem, np.random.default_rng(1), 20).coarse, enough_of(problem)
    monkeypatch.setattr(type(problem.forward), "has_bearings", False)
    wide = DrawnRobots(problem, np.random.default_rng(1), 20).coarse
    assert (wide.fitted_rad == narrow.fitted_rad).all() and (enough_of(problem).usual_rad > enough.usual_rad).all()
    limits_rad = [limits_by(healthy, _NOTHING, np.ones(1)).usual_rad for healthy in (narrow, wide)]
    assert limits_rad[1] == pytest.approx(_MARGIN_OF_RIGID / _MARGIN * limits_rad[0])


def test_robots_with_a_cause_are_drawn_about_the_model_that_has_it():
    problem = problem_of(hidden='frictionloss="0.08"')
    friction = next(term for term in problem.catalogue.terms if term.key == "coulomb_friction.torque_nm")
    with_friction, without = problem.fitted(problem.start, (friction,)), problem.fitted(problem.start, ())
    about_it = DrawnRobots(problem, np.random.default_rng(1), 60, around=with_friction).coarse
    assert limits_by(about_it, enough_of(problem), np.ones(1)).hold(with_friction), "nothing else is wrong"
    assert (without.usual_rad > 5.0 * about_it.fitted_rad).all()
    assert (about_it.fitted_rad <= about_it.as_it_is_rad).all()


def test_what_a_straight_line_leaves_of_a_healthy_robot_is_fitted_on(monkeypatch):
    problem = problem_of()
    loose = DrawnRobots(problem, np.random.default_rng(1), 60).coarse
    monkeypatch.setattr(healthy_robots, "_STEPS", 0)
    plain = DrawnRobots(problem, np.random.default_rng(1), 60).coarse
    assert (loose.fitted_rad < 0.5 * plain.fitted_rad).all(), "no step at all leaves a healthy robot as far off as it is"
    assert (plain.fitted_rad == plain.as_it_is_rad).all() and (plain.as_it_is_rad == loose.as_it_is_rad).all()


def test_robots_are_fitted_as_closely_as_the_recorded_one_where_they_are_not_near_enough(monkeypatch):
    problem, told, never = problem_of(), list[float](), np.array([np.inf])
    monkeypatch.setattr(healthy_robots, "_STEPS", 0)
    monkeypatch.setattr(healthy_robots, "_CLOSELY", 12)
    robots = DrawnRobots(problem, np.random.default_rng(1), 60)
    coarse, noise = robots.coarse, problem.noise_rad

    def closely(enough_rad: np.ndarray, asked_rad: np.ndarray, asked_far_rad: np.ndarray) -> Healthy:
        told.clear()
        return robots.closely(
            Enough(enough_rad, FAR_WINDOWS * enough_rad, FAR_WINDOWS * enough_rad, np.ones(1)),
            asked_rad,
            asked_far_rad,
            lambda _, share: told.append(share),
        )

    all_of_them = closely(2.0 * noise, never, never)
    assert (all_of_them.fitted_rad < np.minimum(3.0 * noise, 0.2 * coarse.fitted_rad)).all()
    assert (all_of_them.fitted_far_rad < 0.2 * coarse.fitted_far_rad).all()
    assert len(told) > 6 and told[0] == 0.0 and 0.8 < told[-1] < 1.0
    assert (closely(np.ones(1), never, never).fitted_rad > 0.5 * coarse.fitted_rad).all() and not told, "a radian is enough"
    decided = closely(2.0 * noise, 0.5 * noise, np.zeros(1))
    assert len(told) == 2 and (decided.fitted_rad > 0.5 * noise).all(), "two robots are as far off as is asked"


def test_of_two_fits_to_a_healthy_robot_the_nearer_one_counts(monkeypatch):
    problem, never = problem_of(), np.array([np.inf])
    robots = DrawnRobots(problem, np.random.default_rng(1), 20)
    led_away = SimpleNamespace(usual_rad=10.0 * robots._usual_rad[0], far_rad=10.0 * robots._far_rad[0])
    monkeypatch.setattr(robots, "_closely_fitted", lambda _: led_away)
    assert (robots.closely(_NOTHING, never, never).fitted_rad == robots.coarse.fitted_rad).all()
