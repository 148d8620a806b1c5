"""A study of tosses refuses what it cannot use, and says of an object at rest that nothing can be told."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.subjects.tosses.study import is_unexplained, makes_worse, study_object
from sim_backend.reality_gap.verdict import HeldOut, VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec, tosses


def _study(recordings, nominal=None):
    return study_object(toss_spec(), recordings, nominal or {}, np.random.default_rng(0), lambda *_: None)


def test_an_object_at_rest_tells_nothing_and_says_what_to_record():
    still = []
    for recording in tosses(toss_spec(), 4, 4):
        signals = recording.objects[0]
        rest = replace(signals, position_m=signals.position_m[[-1] * 40], quat_wxyz=signals.quat_wxyz[[-1] * 40])
        still.append(replace(recording, objects=(replace(rest, time_s=signals.time_s[:40]),)))
    study = _study(still)
    assert study.kind is VerdictKind.NOT_IDENTIFIABLE
    assert study.causes == ()
    assert any("free flight" in advice for advice in study.record_next)
    assert any("friction" in sentence for sentence in study.cannot_tell)


def test_refusals_say_why():
    found = tosses(toss_spec(), 2, 4)
    with pytest.raises(RecordingError, match="at least two episodes"):
        _study(found[:1])
    with pytest.raises(RecordingError, match="no recording has poses"):
        _study([replace(one, objects=()) for one in found])
    with pytest.raises(ValueError, match=r"table_friction.coefficient is 9; it must be between 0.05 and 3"):
        _study(found, {"table_friction.coefficient": 9.0})


@pytest.mark.parametrize(
    ("before", "after", "unexplained"),
    [(90.0, 12.0, False), (90.0, 33.0, True), (24.0, 24.7, True), (2.4, 2.4, False)],
)
def test_what_is_left_far_above_the_noise_is_unexplained(before, after, unexplained):
    held_out = HeldOut("position error", "% of the width", before, after, 1.0, 1.0 - after / before, (0.0, 1.0), 40)
    assert is_unexplained(held_out) is unexplained


@pytest.mark.parametrize(
    ("interval", "is_unseen", "worse"),
    [((-0.5, -0.1), True, True), ((-0.5, 0.1), True, False), ((-0.5, -0.1), False, False), ((0.0, 0.0), True, False)],
)
def test_causes_that_put_unseen_tosses_further_off_are_none(interval, is_unseen, worse):
    held_out = HeldOut("position error", "% of the width", 2.0, 2.5, 1.0, -0.25, interval, 40, is_unseen)
    assert makes_worse(held_out) is is_unexplained(held_out) is worse


def test_tosses_that_are_mirrored_are_unexplained_and_few_of_them_are_not_held_out():
    def mirrored(recording):
        signals = recording.objects[0]
        return replace(recording, objects=(replace(signals, position_m=signals.position_m * [-1.0, 1.0, 1.0]),))

    study = _study([mirrored(recording) for recording in tosses(toss_spec(), 8, 5)])
    assert study.kind is VerdictKind.UNEXPLAINED
    assert study.confirmation is not None
    assert not study.confirmation.held_out.is_unseen
