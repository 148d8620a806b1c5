"""What the safety pipeline makes of commands, and what it would have made of those before."""

import numpy as np

from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import SentTorque
from sim_backend.trifinger import constants as c

STEPS, STEP_S = 60, 1e-3
JITTER = Term("timing_jitter.std_s", 0, 1e-3)
NOMINAL = JointState(9, {})


def sent_with(target: np.ndarray) -> SentTorque:
    """Nine joints at rest, whose targets are given, shape (s, 9)."""
    rest = np.zeros((STEPS, 9))
    return SentTorque(JointSignals(c.JOINT_NAMES, rest, rest, rest, position_target_rad=target), rest, STEP_S)


def test_a_command_that_is_never_replaced_cannot_be_late():
    for target in (np.zeros((STEPS, 9)), np.full((STEPS, 9), np.nan)):
        sent = sent_with(target)
        assert sent.images(NOMINAL, [JITTER]) == []
        assert sent.late_commands(NOMINAL).steps.size == 0


def test_a_command_may_be_late_from_its_begin_on():
    target = np.repeat([[0.0], [0.1], [-0.1]], STEPS // 3, axis=0) * np.ones(9)
    images = sent_with(target).images(NOMINAL, [JITTER])
    assert {joint for _, joint, _ in images} == set(range(9))
    for _, _, image in images:
        assert np.flatnonzero(image)[0] == STEPS // 3
        assert image[STEPS // 3] < 0.0 < image[2 * STEPS // 3]
