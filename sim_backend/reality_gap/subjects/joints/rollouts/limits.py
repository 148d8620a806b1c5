"""How far off windows may end up: what healthy robots leave that were drawn for them, or what is enough for anybody."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots, Enough, Healthy
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, FAR_WINDOWS, RolloutFit, RolloutProblem

_AS_GOOD_AS_RIGHT, _AS_GOOD_AS_RIGID = 0.004, 0.01
"""Of a window's motion: no model is exact, and no integrator; more where bearings are simulated as if they did not give.

The passive pendulum of docs/studies leaves 0.33 % at joint1 in far windows, a third of what is counted, once its bearings rub.
"""
_FEW = 3.0
"""Times as far as windows lie apart in drawn robots, or in how far they move: few windows are off where far ones are further.

Where a model is not exact it is so in all windows, more in those that move more. Of 90 healthy arms (seeds 46 and 47 of the
second generator) one was 3.0 times and 3.0 times as far off as those drawn for it.
"""
_MARGIN_OF_FEW = 5.0
"""Times what drawn robots are off in far windows that few windows may be off."""


@dataclass(frozen=True)
class HealthyLimits:
    """How far off windows of a robot may end up that nothing else is wrong with; shapes (k,).

    Attributes:
        usual_rad: half of the windows.
        far_rad: nine of ten, where all windows are off alike.
        few_rad: nine of ten, where most are much nearer.
        apart: times as far as usual windows that far ones are in drawn robots, or move.
        drawn_rad: what usual windows of the robots are off that were drawn, without any margin.
    """

    usual_rad: np.ndarray
    far_rad: np.ndarray
    few_rad: np.ndarray
    apart: np.ndarray
    drawn_rad: np.ndarray

    def far_for(self, fit: RolloutFit) -> np.ndarray:
        """What nine windows of ten may be off beside a fit's usual ones, shape (k,), rad.

        Usual windows nearer than those of drawn robots count as they do: what is below noise says nothing. Few windows in all
        do not tell what is usual.
        """
        if len(fit.squares) < LEAST_WINDOWS:
            return self.far_rad
        alike_rad = _FEW * self.apart * np.maximum(fit.usual_rad, self.drawn_rad)
        return np.minimum(self.far_rad, np.maximum(self.few_rad, alike_rad))

    def hold(self, fit: RolloutFit) -> bool:
        """Whether windows end up no further off at any joint."""
        return bool((fit.usual_rad <= self.usual_rad).all() and (fit.far_rad <= self.far_for(fit)).all())

    def hold_but_for_few(self, fit: RolloutFit) -> bool:
        """Whether they would if it did not matter that most windows are much nearer than the far ones."""
        return bool((fit.usual_rad <= self.usual_rad).all() and (fit.far_rad <= self.far_rad).all())


def limits_of(
    robots: DrawnRobots, fit: RolloutFit, enough: Enough, progress: Callable[[str, float], None] = lambda *_: None
) -> HealthyLimits:
    """Limits by drawn robots, as close as it takes to say on which side of them a model's windows end up.

    Args:
        robots: drawn for the same windows.
        fit: whose windows.
        enough: what is near enough whatever robots are.
        progress: told what is done, and which share.
    """
    apart = np.maximum(enough.apart, robots.coarse.fitted_far_rad / robots.coarse.fitted_rad)
    coarse = limits_by(robots.coarse, enough, apart)
    least = replace(enough, far_rad=np.minimum(enough.far_rad, np.maximum(enough.few_rad, _FEW * apart * fit.usual_rad)))
    is_open = (fit.usual_rad > least.usual_rad) & (fit.usual_rad <= coarse.usual_rad)
    is_far_open = (fit.far_rad > least.far_rad) & (fit.far_rad <= coarse.far_for(fit))
    if not (is_open | is_far_open).any():
        return coarse
    margin = robots.coarse.margin
    asked = (np.where(is_open, fit.usual_rad, 0.0) / margin, np.where(is_far_open, fit.far_rad, 0.0) / margin)
    return limits_by(robots.closely(least, *asked, progress), enough, apart)


def enough_of(problem: RolloutProblem) -> Enough:
    """What is near enough whatever healthy robots are: encoders' noise, or a share of how far windows move.

    A robot that swings out moves far in its first windows and little in most. Where bearings are simulated as if they did not
    give, windows in which a joint sticks are off and others are not.
    """
    has_bearings = problem.forward.has_bearings
    share, near_rad = _AS_GOOD_AS_RIGHT if has_bearings else _AS_GOOD_AS_RIGID, FAR_OFF * problem.noise_rad
    of_motion_rad = share * problem.far_motion_rad
    far_rad = FAR_WINDOWS * np.maximum(near_rad, of_motion_rad)
    few_rad = np.maximum(FAR_WINDOWS * near_rad, of_motion_rad) if has_bearings else far_rad
    usual_rad = np.maximum(near_rad, share * problem.motion_rad)
    return Enough(usual_rad, far_rad, few_rad, problem.far_motion_rad / problem.motion_rad)


def limits_by(healthy: Healthy, enough: Enough, apart: np.ndarray) -> HealthyLimits:
    """Limits by what drawn robots are off; ``apart`` is how many times further far windows are than usual ones, shape (k,)."""
    usual_rad = np.maximum(enough.usual_rad, healthy.margin * healthy.fitted_rad)
    far_rad = np.maximum(np.maximum(enough.far_rad, FAR_WINDOWS * usual_rad), healthy.margin * healthy.fitted_far_rad)
    few_rad = np.maximum(enough.few_rad, _MARGIN_OF_FEW * healthy.fitted_far_rad)
    return HealthyLimits(usual_rad, far_rad, few_rad, apart, healthy.fitted_rad)
