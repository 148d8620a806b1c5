"""How far off a healthy robot's windows may end up."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import Enough, Healthy
from sim_backend.reality_gap.subjects.joints.rollouts.limits import limits_by, limits_of
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints import pendulum
from tests.unit.sim_backend.reality_gap.subjects.joints.ends_of_windows import fit_of
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import study_of

DRAWN = Healthy(*(1e-3 * np.array([mrad, mrad]) for mrad in (1.0, 1.0, 2.0)))
ENOUGH = Enough(*(1e-3 * np.array([mrad, mrad]) for mrad in (5.0, 30.0, 4.0)), np.array([2.0, 2.0]))


def few_off(usual_mrad: float, far_mrad: float, windows: int = 20) -> RolloutFit:
    """Of windows of two joints four fifths are as usual, one far off at the second joint."""
    off_rad = 1e-3 * np.full((windows, 2), usual_mrad)
    off_rad[: windows // 5, 1] = 1e-3 * far_mrad
    return fit_of(off_rad)


@pytest.mark.parametrize(
    ("usual_mrad", "far_mrad", "apart", "is_healthy"),
    [
        (1.0, 11.0, 2.0, False),
        (1.0, 9.0, 2.0, True),
        (2.0, 11.0, 2.0, True),
        (1.0, 11.0, 4.0, True),
        (0.5, 11.0, 4.0, True),
        (6.0, 29.0, 2.0, True),
        (6.0, 31.0, 2.0, False),
    ],
    ids=[
        "few windows",
        "few, as drawn ones",
        "all windows",
        "those that move",
        "nearer than drawn ones",
        "all of them, enough",
        "more than is enough",
    ],
)
def test_what_is_enough_is_so_in_all_windows_alike(usual_mrad, far_mrad, apart, is_healthy):
    """Drawn robots leave 1 mrad and 2 mrad; beside 1 mrad far windows may be 3 times as far apart off, or 10 mrad."""
    wide = Enough(1e-3 * np.full(2, 10.0), *(1e-3 * np.full(2, mrad) for mrad in (30.0, 4.0)), ENOUGH.apart)
    limits, fit = limits_by(DRAWN, wide, np.full(2, apart)), few_off(usual_mrad, far_mrad)
    assert limits.hold(fit) == is_healthy
    assert limits.hold_but_for_few(fit) == (far_mrad < 30.0)


def test_few_windows_in_all_do_not_tell_which_of_them_are_few():
    limits = limits_by(DRAWN, ENOUGH, ENOUGH.apart)
    assert not limits.hold(few_off(1.0, 11.0, 20)) and limits.hold(few_off(1.0, 11.0, 19))


@pytest.mark.parametrize(
    ("far_mrad", "asked"), [(9.0, True), (3.9, False), (11.0, False)], ids=["open", "near enough", "far off"]
)
def test_drawn_robots_are_looked_at_closely_where_few_windows_may_be_too_far_off(far_mrad, asked):
    """By coarse limits ten milliradians are usual; closely it is five."""
    close, calls = Healthy(*(1e-3 * np.array([mrad, mrad]) for mrad in (0.5, 0.5, 1.0))), []
    robots = SimpleNamespace(coarse=DRAWN, closely=lambda *given: calls.append(given) or close)
    fit = few_off(0.5, far_mrad)
    limits = limits_of(robots, fit, ENOUGH)  # pyrefly: ignore[bad-argument-type]
    assert bool(calls) == asked and limits.hold(fit) == (far_mrad < 5.0)


def test_a_robot_that_is_pushed_now_and_then_is_not_healthy():
    """One window of ten ends up less than is enough off, but much further than drawn robots, the others as right as can be."""
    verdict = study_of("", seconds=12.0, pushed_nm=0.06)
    assert verdict.verdict is VerdictKind.UNEXPLAINED and not verdict.causes, verdict.summary
    (look,) = verdict.record_next
    assert "swing 1 from " in look and "swing 2 from " in look, "it says when"


def test_what_happened_in_fewer_windows_than_one_of_ten_is_told_beside_a_model_that_is_right(monkeypatch):
    """Once in each recording somebody pushes hard, or the joint hits a stop that its model lacks."""
    monkeypatch.setattr(pendulum, "PUSHED_EVERY", 2300)
    verdict = study_of("", seconds=13.0, pushed_nm=0.3)
    assert verdict.verdict is VerdictKind.NOTHING_WRONG
    (few,) = [said for said in verdict.cannot_tell if said.startswith("what happened in ")]
    assert few.startswith("what happened in 2 of ")
    (look,) = verdict.record_next
    assert look.startswith("look at what happened at hinge in swing 1 from ") and ", swing 2 from " in look
    assert study_of("", seconds=6.0).record_next == ()


def test_what_is_another_in_one_of_two_recordings_is_told(monkeypatch):
    """The second one was made with a payload that swings behind the arm, of which nothing was said."""
    loaded = mujoco.MjModel.from_xml_string(pendulum.PENDULUM.format(more="").replace('pos="0 0 -0.15"', 'pos="0.06 0 -0.1"'))
    plain = pendulum.recorded
    monkeypatch.setattr(
        pendulum, "recorded", lambda model, target, *, seed: plain(loaded if seed == 2 else model, target, seed=seed)
    )
    verdict = study_of("", seconds=8.0)
    assert verdict.verdict is VerdictKind.UNEXPLAINED, verdict.summary
    told = "what is another in swing 2, such as a load or the rig: in swing 1 the model goes where the robot went"
    assert told in verdict.cannot_tell
