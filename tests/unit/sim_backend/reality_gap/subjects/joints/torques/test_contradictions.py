"""What was measured rules values out: a limit below a torque that acted, and numbers that run into their bounds."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.motor_law import LIMIT
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.torques.contradictions import (
    contradicts,
    pushes,
    runs_into_bounds,
    torque_that_acted_nm,
)
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import motion, recorded, recording, study_of, torques_nm

DAMPING = "viscous_friction.damping_nm_s_rad"


@pytest.fixture(scope="module")
def study():
    return study_of([recorded(1, (0.2, 0.1)), recorded(2, (0.2, 0.1))])


def limited(study, limit_nm):
    return replace(study.start, given={**study.start.given, LIMIT: np.array(limit_nm)})


def test_a_motor_gave_what_the_motion_took(study):
    acted = torque_that_acted_nm(study.problem)
    needed = np.abs(np.concatenate([torques_nm(motion(seed))[0] for seed in (1, 2)])).max(axis=0)
    assert np.all(acted > 0.6 * needed) and np.all(acted < needed)
    assert contradicts(study.problem, limited(study, [0.9 * acted[0], 100.0]))
    assert not contradicts(study.problem, limited(study, [1.1 * acted[0], 100.0]))
    assert not contradicts(study.problem, study.fit.state)


def test_friction_that_would_drive_a_joint_in_one_direction_is_none(study):
    def directed(difference_nm):
        values = {"coulomb_friction.torque_nm": [0.1, 0.2], "directional_friction.difference_nm": [0.0, difference_nm]}
        return replace(study.start, given={**study.start.given, **{key: np.array(value) for key, value in values.items()}})

    assert not pushes(directed(0.21)) and not pushes(directed(-0.21))
    assert pushes(directed(0.26)) and pushes(directed(-0.26))


def test_a_number_at_the_end_of_what_the_catalogue_allows_is_no_cause(study):
    term = Term(DAMPING, 0, 1e-3)
    upper = study.start.bounds(DAMPING)[1]
    accepted = [Accepted("viscous_friction", "shoulder", (term,), 100.0)]
    for value, at_end in ((upper, True), (0.5 * upper, False)):
        state = study.start.moved(term, value - float(study.start.value(DAMPING)[0]))
        assert runs_into_bounds(state, study.start, accepted) is at_end
    assert not runs_into_bounds(study.start, study.start, accepted), "absent is where it began"


def test_friction_that_grows_with_load_is_not_taken_for_a_limit_that_the_motion_exceeds():
    recordings = []
    for seed in (3, 4, 5):
        position = motion(seed)
        torque, velocity = torques_nm(position)
        recordings.append(recording(position, torque + 0.3 * np.abs(torque) * np.tanh(velocity / 0.01), seed))
    found = study_of(recordings)
    effects = {a.effect for a in found.fit.accepted}
    assert "load_friction" in effects and "torque_saturation" not in effects
