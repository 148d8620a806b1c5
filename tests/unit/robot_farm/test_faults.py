"""Faults as they are written, scheduled and drawn."""

import numpy as np
import pytest

from robot_farm.faults import KINDS, RESTART_S, Fault, changed, draw_fault, parse_fault, timeline
from sim_backend.effects.physics import Physics

JOINT = "finger0_base_to_upper"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (f"robot-1:stuck_joint:{JOINT}@2+3.5", Fault("robot-1", "stuck_joint", JOINT, 1.0, 2, 3.5)),
        (f"robot-1:stuck_joint:{JOINT}:0.2", Fault("robot-1", "stuck_joint", JOINT, 0.2)),
        ("robot-0:dead_camera:camera180@4", Fault("robot-0", "dead_camera", "camera180", 1.0, 4)),
        (f"robot-1:encoder_jump:{JOINT}:-0.3", Fault("robot-1", "encoder_jump", JOINT, -0.3)),
        ("robot-1:controller_restart@0+1", Fault("robot-1", "controller_restart", None, 1.0, 0, 1.0)),
    ],
)
def test_written_faults_are_read(text, fault):
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("robot-1", "ROBOT:KIND"),
        ("robot-1:broken:x", "stuck_joint, dead_camera"),
        ("robot-1:stuck_joint", "finger0_base_to_upper"),
        ("robot-1:dead_camera:camera7", "camera60, camera180, camera300"),
        ("robot-1:dead_camera:camera60:2", "has no size"),
        ("robot-1:controller_restart:camera60", "leave out 'camera60'"),
        (f"robot-1:encoder_jump:{JOINT}:99", "must be between"),
    ],
)
def test_what_cannot_be_is_refused_with_what_could(text, names):
    with pytest.raises(ValueError, match=names):
        parse_fault(text)


def test_a_fault_without_seconds_is_there_before_its_trial_and_stays():
    faults = (parse_fault("robot-0:dead_camera:camera60@1"),)
    there = [timeline(Physics.nominal(), faults, trial) for trial in range(3)]
    assert [physics.has("dead_camera") for physics, _ in there] == [False, True, True]
    assert not any(changes for _, changes in there)


def test_a_fault_with_seconds_comes_within_its_trial_and_stays():
    faults = (parse_fault(f"robot-0:stuck_joint:{JOINT}@1+3.5"),)
    (_, none), (before, changes), (after, none_more) = (timeline(Physics.nominal(), faults, trial) for trial in range(3))
    assert not none
    assert not none_more
    assert before.is_nominal
    assert [change.at_s for change in changes] == [3.5]
    assert changes[0].physics.value("stuck_joint.holding_torque_nm")[0].tolist() == [1.0] + [0.0] * 8
    assert after.document() == changes[0].physics.document()


def test_a_controller_restarts_and_is_back():
    faults = (parse_fault("robot-0:controller_restart@1+2"), parse_fault("robot-0:dead_camera:camera60@1+2.2"))
    physics, changes = timeline(Physics.nominal(), faults, 1)
    assert physics.is_nominal
    assert [change.at_s for change in changes] == [2.0, 2.2, 2.0 + RESTART_S]
    assert [change.physics.has("controller_restart") for change in changes] == [True, True, False]
    assert [change.physics.has("dead_camera") for change in changes] == [False, True, True]
    assert not timeline(Physics.nominal(), faults, 2)[0].has("controller_restart")


def test_every_kind_is_drawn_and_can_be_applied():
    rng = np.random.default_rng(3)
    drawn = [draw_fault(rng, "robot-0", 7) for _ in range(60)]
    assert {fault.kind for fault in drawn} == set(KINDS)
    for fault in drawn:
        assert fault.comes_within(7)
        assert not changed(Physics.nominal(), (fault,)).is_nominal
