"""How far off windows may end up: what healthy robots leave that were drawn for them, or what is enough for anybody."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots, Enough, Healthy
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, FAR_WINDOWS, RolloutFit, RolloutProblem

_AS_GOOD_AS_RIGHT, _AS_GOOD_AS_RIGID = 0.004, 0.01
"""Of a window's motion: no model is exact, and no integrator; more where bearings are simulated as if they did not give.

The passive pendulum of docs/studies leaves 0.33 % at joint1 in far windows, a third of what is counted, once its bearings rub.
"""
_FEW = 3.0
"""Times as far as drawn robots' windows or motions lie apart that far windows are from usual ones where few windows are off.

Where a model is not exact it is so in all windows. Of 90 healthy arms (seeds 46 and 47 of the second generator) one was so 3.0
times, and 3.0 times as far off as those drawn for it; the others that were that far off, up to 3.6 times, were so 1.6 times. A
loose mass, a belt that remembers, a cable and an encoder's dropouts that had been within what is enough were so 3.7 times and
more, and 5.2 to 14 times as far off.
"""
_MARGIN_OF_FEW = 5.0
"""Times what drawn robots are off in far windows that few windows may be off."""


@dataclass(frozen=True)
class HealthyLimits:
    """How far off windows of a robot may end up that nothing else is wrong with; shapes (k,), rad.

    Attributes:
        usual_rad: half of the windows.
        far_rad: nine of ten.
        drawn_rad: what usual windows of the robots are off that were drawn, without any margin.
    """

    usual_rad: np.ndarray
    far_rad: np.ndarray
    drawn_rad: np.ndarray

    def hold(self, fit: RolloutFit) -> bool:
        """Whether windows end up no further off at any joint."""
        return bool((fit.usual_rad <= self.usual_rad).all() and (fit.far_rad <= self.far_rad).all())


def limits_of(
    robots: DrawnRobots, fit: RolloutFit, enough: Enough, progress: Callable[[str, float], None] = lambda *_: None
) -> HealthyLimits:
    """Limits by drawn robots, as close as it takes to say on which side of them a model's windows end up.

    Args:
        robots: drawn for the same windows.
        fit: whose windows.
        enough: below what nothing is off whatever robots are.
        progress: told what is done, and which share.
    """
    coarse = limits_by(robots.coarse, enough, fit)
    least = replace(enough, far_rad=np.where(_is_few(robots.coarse, enough, fit), enough.usual_rad, enough.far_rad))
    is_open = (fit.usual_rad > least.usual_rad) & (fit.usual_rad <= coarse.usual_rad)
    is_far_open = (fit.far_rad > least.far_rad) & (fit.far_rad <= coarse.far_rad)
    if not (is_open | is_far_open).any():
        return coarse
    margin = robots.coarse.margin
    asked = (np.where(is_open, fit.usual_rad, 0.0) / margin, np.where(is_far_open, fit.far_rad, 0.0) / margin)
    return limits_by(robots.closely(least, *asked, progress), enough, fit)


def enough_of(problem: RolloutProblem) -> Enough:
    """Below what windows are not off whatever healthy robots are: encoders' noise, or a share of how far windows move.

    A robot that swings out moves far in its first windows and little in most.
    """
    share = _AS_GOOD_AS_RIGHT if problem.forward.has_bearings else _AS_GOOD_AS_RIGID
    usual_rad, far_rad = (
        np.maximum(FAR_OFF * problem.noise_rad, share * motion_rad) for motion_rad in (problem.motion_rad, problem.far_motion_rad)
    )
    return Enough(usual_rad, FAR_WINDOWS * far_rad, problem.far_motion_rad / problem.motion_rad)


def limits_by(healthy: Healthy, enough: Enough, fit: RolloutFit) -> HealthyLimits:
    """What windows of a robot that nothing else is wrong with may be off.

    Args:
        healthy: what drawn robots are off.
        enough: what is near enough for anybody, in far windows only if usual ones are as far off for what they move.
        fit: of the robot.
    """
    usual_rad = np.maximum(enough.usual_rad, healthy.margin * healthy.fitted_rad)
    far_rad = np.maximum(np.maximum(enough.far_rad, FAR_WINDOWS * usual_rad), healthy.margin * healthy.fitted_far_rad)
    few_rad = np.maximum(enough.usual_rad, _MARGIN_OF_FEW * healthy.fitted_far_rad)
    far_rad = np.where(_is_few(healthy, enough, fit), np.minimum(far_rad, few_rad), far_rad)
    return HealthyLimits(usual_rad, far_rad, healthy.fitted_rad)


def _is_few(healthy: Healthy, enough: Enough, fit: RolloutFit) -> np.ndarray:
    """Joints at which a model that is exact for most windows is not for few of them, shape (k,).

    Windows that are nearer than those of drawn robots count as they do: what is below noise says nothing.
    """
    apart = np.maximum(enough.far_to_usual, healthy.fitted_far_rad / healthy.fitted_rad)
    return fit.far_rad > _FEW * apart * np.maximum(fit.usual_rad, healthy.fitted_rad)
