"""One trial as it runs: whether it goes on, what befalls the robot meanwhile, and what the trial leaves behind."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from api_schemas.bus import LiveState
from api_schemas.robot import Lease
from api_schemas.trial import OutcomeKind
from robot_farm.faults import Change
from robot_farm.link.lease_keeper import TrialStoppedError
from robot_farm.prepared import Prepared
from sim_backend.driver.driver import Measurement, Segment
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import TrackedPose
from sim_backend.trifinger import constants as c
from trial_logs import trial_log
from trial_logs.trial_log import TrialLogWriter

if TYPE_CHECKING:
    from robot_farm.exposures import Exposures

Failure = tuple[OutcomeKind, str]
"""How a trial ended other than by its time being over, and why."""


@dataclass
class Progress:
    """What others may see of a running trial; written by the trial, read by the bus link."""

    simulated_s: float = 0.0
    duration_s: float = 0.0
    measurement: Measurement | None = None
    tracked: TrackedPose | None = None
    goal: tuple[float, ...] | None = None
    """Of the object, 7 numbers, or of the fingertips, 9."""


def live_state(lease: Lease, progress: Progress) -> LiveState | None:
    """What the bus shows of a leased trial; None before it has begun to move."""
    measurement, tracked = progress.measurement, progress.tracked
    if measurement is None or tracked is None:
        return None
    return LiveState(
        robot=lease.robot,
        trial_id=lease.trial_id,
        fence=lease.fence,
        simulated_s=progress.simulated_s,
        duration_s=progress.duration_s,
        joint_position_rad=tuple(measurement.joint_position_rad[0].tolist()),
        tracked_cube_position_world_m=tuple(tracked.cube_position_world_m[0].tolist()),
        tracked_cube_quat_wxyz=tuple(tracked.cube_quat_wxyz[0].tolist()),
        goal=progress.goal,
    )


@dataclass
class Run:
    """A trial under way (n = 1). Owner of what it leaves behind: true states after each control period, inference times."""

    lease: Lease
    ready: Prepared
    driver: SimulatedDriver
    stop_reason: Callable[[], str | None]
    progress: Progress
    truth: TrialLogWriter | None = None
    exposures: "Exposures | None" = None
    states: list[Measurement] = field(default_factory=list)
    inference_ns: list[int] = field(default_factory=list)
    changed: list[tuple[int, Change]] = field(default_factory=list)

    def go_on(self, step: int) -> None:
        """Before each control period: end if there is a reason to, and let the faults come that are due.

        Raises:
            TrialStoppedError: there was a reason to stop.
        """
        reason = self.stop_reason()
        if reason is not None:
            raise TrialStoppedError(reason)
        while self._next_change is not None and step * c.PHYSICS_STEP_S >= self._next_change.at_s:
            self._change(step, self._next_change)

    def after(self, segment: Segment, tracked: list[TrackedPose], state: Measurement, simulated_s: float) -> str | None:
        """After each control period: show it to others; returns what the robot notices about itself."""
        self.states.append(state)
        self.progress.simulated_s, self.progress.measurement = simulated_s, state
        self.progress.tracked = tracked[-1] if tracked else self.progress.tracked
        return None if self.ready.alarm is None else self.ready.alarm.notice(segment)

    @property
    def temperature_rise_k(self) -> np.ndarray | None:
        """Temperatures of the motors above ambient, shape (9,), where they are recorded."""
        return None if self.truth is None else self.driver.motor_temperature_rise_k[0]

    @property
    def _next_change(self) -> Change | None:
        return self.ready.changes[len(self.changed)] if len(self.changed) < len(self.ready.changes) else None

    def _change(self, step: int, change: Change) -> None:
        self.changed.append((step, change))
        self.driver.set_physics(change.physics)
        self.ready.tracker.set_physics(change.physics)
        if self.exposures is not None:
            self.exposures.set_physics(change.physics)
        if self.truth is not None:
            self.truth.event(step, "the robot's physics change: a fault comes or goes", topic=trial_log.TRUE_EVENTS)
