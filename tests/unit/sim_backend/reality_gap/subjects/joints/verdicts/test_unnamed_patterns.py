"""A law that the catalogue lacks is seen in what causes leave: at a place, along the way since a joint turned, with time."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.unnamed_patterns import UnnamedPattern, followed, way_since_reversal_rad
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import (
    NAMES,
    NO_LIMIT,
    STEP_S,
    drive,
    foreign_problem,
    joints_model,
)

SECONDS, TORQUE_NM = 12.0, 0.15


def test_the_way_since_a_joint_turned_round_begins_anew_at_each_turn_but_not_at_noise():
    there, back = np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.4, 61)[1:]
    way = way_since_reversal_rad(np.concatenate([there, back]), 0.05)
    assert way[100] == pytest.approx(1.0) and way[-1] == pytest.approx(-0.6)
    noisy = there + 0.01 * (-1.0) ** np.arange(101)
    assert (way_since_reversal_rad(noisy, 0.05)[5:] > 0.0).all()


class Resisted:
    """A torque that the second joint loses, by a law with a memory of its own."""

    def __init__(self, law: str) -> None:
        self.law, self.step, self.bend, self.before = law, 0, 0.0, 0.0

    def __call__(self, velocity: np.ndarray) -> np.ndarray:
        self.step += 1
        speed, lost = float(velocity[1]), np.zeros(3)
        self.before += STEP_S * speed  # where it is
        if self.law == "tight spot":
            lost[1] = TORQUE_NM * np.tanh(speed / 0.02) * np.exp(-(((self.before - 0.1) / 0.15) ** 4))
        elif self.law == "hysteresis":
            side = np.sign(speed)
            self.bend = side + (self.bend - side) * np.exp(-abs(speed) * STEP_S / 0.3)
            lost[1] = TORQUE_NM * self.bend
        elif self.law == "friction":
            lost[1] = TORQUE_NM * np.tanh(speed / 0.02)
        return lost


def left_of(law: str) -> UnnamedPattern | None:
    """What the second joint's torque follows with a model that has the best Coulomb friction for it."""
    position, torque = drive(joints_model(), SECONDS, Resisted(law))
    position += 3e-5 * np.random.default_rng(0).standard_normal(position.shape)
    problem = foreign_problem(position, torque)
    (episode,) = problem.episodes
    assert isinstance(episode, EpisodeEquations)

    def rubbing(friction_nm: float) -> JointState:
        friction = {"coulomb_friction.torque_nm": np.array([0.0, friction_nm, 0.0])}
        return replace(NO_LIMIT, given={**NO_LIMIT.given, **friction})

    def off(friction_nm: float) -> float:
        return float((episode.torque_error(rubbing(friction_nm))[episode.valid_mechanics[:, 1], 1] ** 2).mean())

    return followed(problem.episodes, rubbing(min(np.linspace(0.0, TORQUE_NM, 16), key=off)), 1, NAMES)


@pytest.mark.parametrize(
    ("law", "variables"),
    [
        ("hysteresis", {"the way that it came, as friction with a memory"}),
        ("tight spot", {"its position, there and back"}),
    ],
)
def test_what_friction_leaves_of_a_law_that_no_catalogue_has_follows_what_that_law_does(law, variables):
    found = left_of(law)
    assert found is not None and found.joint == "second" and found.variable in variables and found.share > 0.6


def test_what_friction_leaves_of_friction_is_no_law():
    assert left_of("friction") is None
