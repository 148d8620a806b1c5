"""What is known of a robot."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS, STANDARD, healthy_sessions
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.recording import Recording


def recorded(regime: str) -> Recording:
    return Recording(regime, regime, 1e-3, np.arange(3) * 1e-3, regime=regime)


def test_a_trifinger_is_compared_with_sessions_of_what_it_was_recorded_under():
    assert KnownTriFinger.seen_in([recorded(STANDARD)]).healthy is healthy_sessions((STANDARD,))
    assert KnownTriFinger.seen_in([recorded("chirps"), recorded("chirps")]).healthy.gates != healthy_sessions((STANDARD,)).gates


def test_of_any_other_robot_no_healthy_session_is_known():
    assert UnknownRobot.healthy is NO_SESSIONS
    assert UnknownRobot.healthy.null_p(100.0) == 1.0


@pytest.mark.parametrize(("counted_s", "share"), [(5.0, 1.0), (20.0, 1.0), (80.0, 0.5)])
def test_priors_of_an_unknown_robot_shrink_where_rows_would_swamp_them(counted_s, share):
    assert UnknownRobot.prior_share(counted_s, 20.0) == pytest.approx(share)
    assert KnownTriFinger.prior_share(counted_s, 20.0) == 1.0


def test_less_is_granted_to_what_nobody_knows():
    assert UnknownRobot.granted < KnownTriFinger.granted
    assert UnknownRobot.cutoff_hz < KnownTriFinger.cutoff_hz
    assert set(KnownTriFinger.load_shares) < set(UnknownRobot.load_shares)
