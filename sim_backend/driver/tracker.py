"""What reports the object's pose: 10 Hz and 90 ms late, as on the real robot; without error on nominal robots.

As the real driver does, one process takes an image of each camera, looks for the object in it and appends the result to a time
series (TOT tricamera_object_tracking_driver.cpp). Reports therefore never overtake each other: one that took long holds up
those behind it. A frame that is lost leaves no report and does not touch the filter.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sim_backend.driver.detection import Detector, Values, detect, read, values_of
from sim_backend.driver.driver import Measurement, Segment
from sim_backend.effects.physics import Physics
from sim_backend.effects.tracking import frame_period_s
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape

CONFIDENCE_THRESHOLD = 0.75
CONFIDENCE_DECAY = 0.9
"""Below the threshold the previous pose is repeated with its confidence times this (TOT, same file)."""
_NEVER = 2**62  # steps
_WORST_JITTER = 4.0  # standard deviations that the frames before the start allow for


class TrackedPose(NamedTuple):
    """The newest report of the tracker for each of n robots.

    ``capture_step`` and ``delivery_step`` (n,) say when the image was taken and when the pose arrived, in physics steps since
    the start. ``cube_position_world_m`` (n, 3), ``cube_quat_wxyz`` (n, 4) and ``confidence`` (n,), from 0 to 1, are what the
    filter reports; the raw ones are those of the image. ``visible_faces`` (n, 3 cameras, 6 faces) are in the order of
    ``constants.CAMERAS`` and ``CUBE_FACE_COLOURS``.
    """

    capture_step: np.ndarray
    delivery_step: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    confidence: np.ndarray
    raw_position_world_m: np.ndarray
    raw_quat_wxyz: np.ndarray
    raw_confidence: np.ndarray
    visible_faces: np.ndarray


@dataclass
class _UnderWay:
    """Reports of one instant for some of the robots; ``waiting`` says whose has neither arrived nor been lost.

    ``next_step`` is the driver's step at which the next of them arrives.
    """

    rows: np.ndarray
    report: TrackedPose
    waiting: np.ndarray
    next_step: int


@dataclass(frozen=True)
class _Group:
    """Robots whose cameras take their images at the same steps: ``phase_steps``, then every ``period_steps``."""

    period_steps: int
    phase_steps: int
    rows: np.ndarray
    values: Values


class Tracker:
    """Turns true poses into late reports. Owner of the reports under way and of the filter's last poses.

    Each robot's clock begins with its own trial: frames and times in its reports count from there. Steps of segments and of
    :meth:`deliver` are the driver's.

    Args:
        physics_step_s: of the driver, s.
        physics: the robots' effects; nominal if None.
        shape: the object in the arena.
        detector: what finds the object in a frame; the formula by default.
    """

    def __init__(
        self,
        *,
        physics_step_s: float = c.PHYSICS_STEP_S,
        physics: Physics | None = None,
        shape: Shape = CUBE,
        detector: Detector = detect,
    ) -> None:
        self._physics_step_s, self._shape, self._detect = physics_step_s, shape, detector
        self._physics, self._groups = physics, list[_Group]()
        self._under_way: list[_UnderWay] = []
        self._latest: TrackedPose | None = None

    def set_physics(self, physics: Physics) -> None:
        """Give the robots other effects from the next frame on; reports under way stay as they are."""
        self._physics, self._groups = physics, []
        if self._latest is not None:
            self._group()

    def reset(self, measurement: Measurement, noise_seed: np.ndarray | None = None) -> TrackedPose:
        """Forget everything; robot and object have rested as they are since long, and the newest report of that is returned.

        Args:
            measurement: the true state at the start.
            noise_seed: whole numbers from 0 to 2**53 - 1, shape (n,); zeros if None.
        """
        n = len(measurement.cube_quat_wxyz)
        self._seed = np.zeros(n, dtype=np.int64) if noise_seed is None else np.asarray(noise_seed).astype(np.int64)
        self._begun = np.zeros(n, dtype=np.int64)
        self._under_way, self._groups = [], []
        self._previous = _unknown(n)  # for the filter: the newest report, delivered or not
        self._latest = _unknown(n)
        self._begin(np.ones(n, dtype=bool), measurement, 0)
        return self.latest

    def restart(self, robots: np.ndarray, measurement: Measurement, noise_seed: np.ndarray | None, step: int) -> None:
        """Begin anew for some of the robots, whose objects have rested as they are since long; the others go on.

        Args:
            robots: their indices.
            measurement: the true state of all robots now.
            noise_seed: seeds for these robots; zeros if None.
            step: the driver's step now.
        """
        begins = np.zeros(len(self._seed), dtype=bool)
        begins[robots] = True
        self._seed, self._begun = self._seed.copy(), self._begun.copy()
        self._seed[robots] = 0 if noise_seed is None else np.asarray(noise_seed).astype(np.int64)
        self._begun[robots] = step
        for flight in self._under_way:
            flight.waiting &= ~begins[flight.rows]
            flight.next_step = self._first(flight.rows, flight.report.delivery_step, flight.waiting)
        everything, nothing = np.arange(len(begins)), _unknown(len(begins))
        self._previous = _with_rows(self._previous, everything, nothing, begins)
        self._latest = _with_rows(self.latest, everything, nothing, begins)
        self._groups = []
        self._begin(begins, measurement, step)

    def _begin(self, begins: np.ndarray, measurement: Measurement, step: int) -> None:
        self._group()
        truth = measurement.true_joint_position_rad, measurement.cube_position_world_m, measurement.cube_quat_wxyz
        for group in self._groups:
            self._capture_before_start(group, np.flatnonzero(begins[group.rows]), truth, step)
        self.deliver(step)

    def capture(self, segment: Segment) -> None:
        """Take the images that fall into a segment."""
        first, steps = segment.first_step, segment.cube_position_world_m.shape[1]
        images = []
        for group in self._groups:
            begin = first + (group.phase_steps - first) % group.period_steps
            if begin < first + steps:
                images += [(step, group) for step in range(begin, first + steps, group.period_steps)]
        for step, group in sorted(images, key=lambda image: image[0]):
            row = step - first
            truth = (segment.true_joint_position_rad, segment.cube_position_world_m, segment.cube_quat_wxyz)
            self._capture(step, group, group.rows, tuple(array[:, row] for array in truth))

    def deliver(self, step: int) -> list[TrackedPose]:
        """The reports that have arrived by ``step`` and were not delivered before, oldest first.

        Each is the newest report of every robot after one more has arrived for at least one of them.
        """
        arrived = []
        for flight in self._under_way:
            if flight.next_step <= step:
                due = flight.waiting & (flight.report.delivery_step + _rows_of(self._begun, flight.rows) <= step)
                flight.waiting &= ~due
                flight.next_step = self._first(flight.rows, flight.report.delivery_step, flight.waiting)
                self._latest = _with_rows(self.latest, flight.rows, flight.report, due)
                arrived.append(self._latest)
        if arrived:
            self._under_way = [flight for flight in self._under_way if flight.next_step < _NEVER]
        return arrived

    @property
    def latest(self) -> TrackedPose:
        """The newest report that has been delivered."""
        assert self._latest is not None, "reset the tracker first"
        return self._latest

    def reading(self, step: int | np.ndarray) -> TrackedPose:
        """The newest report as a policy reads it at this step of the trial: with the noise of the reading, if there is any."""
        latest = self.latest
        if not self._reads_noise:
            return latest
        position_m, quat_wxyz = read(self._all_values, self._seed, step, latest.cube_position_world_m, latest.cube_quat_wxyz)
        return latest._replace(cube_position_world_m=position_m, cube_quat_wxyz=quat_wxyz)

    def state(self) -> dict[str, Any]:
        """What :meth:`restore` needs to go on from here: numbers and arrays."""
        under_way = [{**vars(flight), "report": flight.report._asdict()} for flight in self._under_way]
        return {
            "seed": self._seed,
            "begun": self._begun,
            "previous": self._previous._asdict(),
            "latest": self.latest._asdict(),
            "under_way": [{**flight, "waiting": flight["waiting"].copy()} for flight in under_way],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` gave; robots have the effects that :meth:`set_physics` was given last."""
        self._seed, self._begun = state["seed"], state["begun"]
        self._previous, self._latest = TrackedPose(**state["previous"]), TrackedPose(**state["latest"])
        self._under_way = [
            _UnderWay(each["rows"], TrackedPose(**each["report"]), each["waiting"].copy(), each["next_step"])
            for each in state["under_way"]
        ]
        self._groups = []
        self._group()

    def _group(self) -> None:
        """Sort the robots by the steps at which their cameras take images."""
        n = len(self._seed)
        self._physics = Physics.nominal(n) if self._physics is None else self._physics
        if self._physics.n != n:
            raise ValueError(f"the tracker has the physics of {self._physics.n} robots, but there are {n}")
        self._reads_noise = self._physics.has("observation_noise")
        self._all_values = values_of(self._physics, self._shape.size_m)
        period_s = frame_period_s(self._physics.value("tracking_rate.rate_hz"))
        period_steps = np.maximum(np.rint(period_s / self._physics_step_s).astype(np.int64), 1)
        phase_steps = self._begun % period_steps
        for period, phase in sorted(set(zip(period_steps.tolist(), phase_steps.tolist(), strict=True))):
            rows = np.flatnonzero((period_steps == period) & (phase_steps == phase))
            self._groups.append(_Group(period, phase, rows, self._all_values.rows(rows)))

    def _capture_before_start(self, group: _Group, begin: np.ndarray, truth: tuple[np.ndarray, ...], step: int) -> None:
        """Take the images of the resting object whose reports arrive at the start at the latest, and all after them.

        ``begin`` are the places in the group of the robots that begin at ``step``.
        """
        if not len(begin):
            return
        rows, values = group.rows[begin], group.values
        worst_s = c.CAMERA_DELAY_S + values.extra_s[begin] + _WORST_JITTER * values.jitter_s[begin]
        frames = np.maximum(np.ceil(worst_s / (group.period_steps * self._physics_step_s) - 1e-9).astype(int), 1)
        for back in range(frames.max(), 0, -1):
            present = frames >= back
            oldest = frames[present] == back
            self._capture(step - back * group.period_steps, group, rows[present], truth, oldest)

    def _capture(
        self,
        step: int,
        group: _Group,
        rows: np.ndarray,
        truth: tuple[np.ndarray, ...],
        oldest: np.ndarray | None = None,
    ) -> None:
        """Take one image for some robots of a group; the oldest ones are there at the start whatever happens."""
        values = group.values if len(rows) == len(group.rows) else self._all_values.rows(rows)
        capture_step = step - _rows_of(self._begun, rows)
        frame = capture_step // group.period_steps
        seed, *truth_of_rows = (_rows_of(array, rows) for array in (self._seed, *truth))
        visible, confidence, position_m, quat_wxyz, delay_s, lost = self._detect(values, seed, frame, *truth_of_rows)
        delivery_step = capture_step + np.rint(delay_s / self._physics_step_s).astype(np.int64)
        if oldest is not None:
            lost, delivery_step = lost & ~oldest, np.where(oldest, np.minimum(delivery_step, 0), delivery_step)
        delivery_step = np.maximum(delivery_step, _rows_of(self._previous.delivery_step, rows))
        raw = position_m, quat_wxyz, confidence
        pose = filtered(*raw, *(_rows_of(array, rows) for array in _pose(self._previous)))
        report, kept = TrackedPose(capture_step, delivery_step, *pose, *raw, visible), ~lost
        first = self._first(rows, delivery_step, kept)
        if first < _NEVER:
            self._previous = _with_rows(self._previous, rows, report, kept)
            self._under_way.append(_UnderWay(rows, report, kept, first))

    def _first(self, rows: np.ndarray, delivery_step: np.ndarray, waiting: np.ndarray) -> int:
        """The driver's step of the first report that is waited for; never if none is."""
        return int((delivery_step + _rows_of(self._begun, rows))[waiting].min(initial=_NEVER))


def filtered(
    position_m: np.ndarray,
    quat_wxyz: np.ndarray,
    confidence: np.ndarray,
    previous_position_m: np.ndarray,
    previous_quat_wxyz: np.ndarray,
    previous_confidence: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the driver's filter makes of poses: those it is not sure of give way to the ones it reported before.

    Args:
        position_m: shape (n, 3).
        quat_wxyz: shape (n, 4).
        confidence: shape (n,).
        previous_position_m: shape (n, 3), as reported before.
        previous_quat_wxyz: shape (n, 4), likewise.
        previous_confidence: shape (n,), likewise; 0 where there is no previous pose.

    Returns:
        Position, orientation and confidence, shapes as above.
    """
    repeat = (previous_confidence > 0.0) & (confidence < CONFIDENCE_THRESHOLD)
    if not repeat.any():
        return position_m, quat_wxyz, confidence
    return (
        np.where(repeat[:, None], previous_position_m, position_m),
        np.where(repeat[:, None], previous_quat_wxyz, quat_wxyz),
        np.where(repeat, CONFIDENCE_DECAY * previous_confidence, confidence),
    )


def _pose(report: TrackedPose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return report.cube_position_world_m, report.cube_quat_wxyz, report.confidence


def _unknown(n: int) -> TrackedPose:
    """Reports of trackers that have seen nothing yet."""
    never, position, quat, confidence = np.full(n, -_NEVER), np.zeros((n, 3)), np.tile([1.0, 0, 0, 0], (n, 1)), np.zeros(n)
    return TrackedPose(never, never, position, quat, confidence, position, quat, confidence, np.zeros((n, 3, 6), dtype=bool))


def _rows_of(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Some rows, or the array itself where they are all of them: indexing would cost a trial as much as the detection does."""
    return values if len(rows) == len(values) else values[rows]


def _with_rows(report: TrackedPose, rows: np.ndarray, changed: TrackedPose, where: np.ndarray) -> TrackedPose:
    """A report with that of others for some robots: those of ``rows`` that are marked in ``where``."""
    if len(rows) == len(report.confidence) and where.all():
        return changed
    merged = TrackedPose(*(values.copy() for values in report))
    for values, new in zip(merged, changed, strict=True):
        values[rows[where]] = new[where]
    return merged
