"""Four kinds of evidence that tosses give, each as one residual per toss: motion, flight up and sideways, and rest.

Tosses of one data set share errors that no number of them averages away (air, a contact that gives way, a model's own
simplifications). Each kind therefore states a systematic error, and its log densities are weighted so that the mean of n
tosses never counts for more than one observation with that error: each toss has variance scatter^2 + s^2 and the weight
w = (scatter^2 + s^2) / (scatter^2 + n s^2).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.reality_gap.quantiles import MEDIAN_LENGTH_OF_TWO, MEDIAN_SIZE
from sim_backend.reality_gap.subjects.tosses.geometry import gaps_m
from sim_backend.reality_gap.subjects.tosses.models import DAMPING, HEIGHT, SCALE, SIZE, TIME_CONSTANT, upward
from sim_backend.reality_gap.subjects.tosses.replay import Replayer, replayed, settled
from sim_backend.reality_gap.subjects.tosses.stretches import Flight, Toss

_AIR_KG_M3, _DRAG_COEFFICIENT = 1.2, 1.0  # air at 20 degrees C; bluff bodies (Hoerner, Fluid-Dynamic Drag, chapter 3: 0.5 to 1.2)
_SHAPE_KNOWN_TO = 1e-3
_FEWEST = 3  # tosses that make a kind of evidence
_CONTACT_KEYS = (SIZE, TIME_CONSTANT, DAMPING)  # what the height at rest depends on
MOTION, FLIGHT, SIDEWAYS, REST = "motion", "flight", "sideways", "rest"


@dataclass(frozen=True)
class EvidenceKind:
    """A kind of evidence: unit, dimensions of one residual, scatter between tosses, error that all share, and what it is."""

    name: str
    unit: str
    dimensions: int
    scatter: float
    systematic: float
    about: str

    @property
    def scale(self) -> float:
        """Standard deviation of one toss with its part of the common error."""
        return float(np.hypot(self.scatter, self.systematic))


@dataclass(frozen=True)
class TossEvidence:
    """All tosses of a study, their kinds of evidence, and what was computed of them so far.

    ``heights_m`` keeps heights at rest by the values that they depend on; it is this object's own memory.
    """

    replayer: Replayer
    tosses: tuple[Toss, ...]
    kinds: tuple[EvidenceKind, ...]
    heights_m: dict[tuple, dict[int, float]] = field(default_factory=dict)

    @property
    def episodes(self) -> np.ndarray:
        """Index of the recording of each toss, shape (n,)."""
        return np.array([toss.episode for toss in self.tosses])

    def residuals(self, values: Mapping[str, float], rows: Sequence[int]) -> dict[str, np.ndarray]:
        """Residual of each kind for the given tosses, NaN where a toss has no such evidence.

        Motion is the mean distance between measured and replayed position over a toss, in widths; flight is measured minus
        predicted acceleration along gravity's opposite, sideways its size across, both m/s^2, as if each flight lasted as long
        as the median one; rest is the measured minus the settled height, m.
        """
        flight, sideways = self._accelerations(values, rows)
        found = {FLIGHT: flight, SIDEWAYS: sideways, REST: self.rest(values, rows), MOTION: self.motion(values, rows)}
        return {kind.name: found[kind.name] for kind in self.kinds}

    def motion(self, values: Mapping[str, float], rows: Sequence[int]) -> np.ndarray:
        """Mean distance between measured and replayed position of each toss, in widths."""
        out = np.full(len(rows), np.nan)
        places = [place for place, row in enumerate(rows) if self.tosses[row].moves]
        tosses = [self.tosses[rows[place]] for place in places]
        for place, toss, (position_m, _) in zip(places, tosses, replayed(self.replayer, tosses, values), strict=True):
            distance = np.linalg.norm(position_m - toss.position_m, axis=1).mean()
            out[place] = distance / self.replayer.geometry.width_m
        return out

    def _accelerations(self, values: Mapping[str, float], rows: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        gravity = self.replayer.model(values).opt.gravity * (1.0 + values.get(SCALE, 0.0))
        up = upward(self.replayer.geometry.model)
        usual_s = float(np.median([_longest(toss).duration_s for toss in self.tosses if toss.flights] or [1.0]))
        flight, sideways = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
        for place, row in enumerate(rows):
            if self.tosses[row].flights:
                longest = _longest(self.tosses[row])
                off = (longest.acceleration_m_s2 - gravity) * (longest.duration_s / usual_s) ** 2
                flight[place], sideways[place] = off @ up, np.linalg.norm(off - (off @ up) * up)
        return flight, sideways

    def rest(self, values: Mapping[str, float], rows: Sequence[int]) -> np.ndarray:
        """Measured minus settled height of each toss, m."""
        key = tuple(values.get(name) for name in _CONTACT_KEYS)
        known = self.heights_m.setdefault(key, {})
        missing = [row for row in rows if row not in known and len(self.tosses[row].rest[0])]
        up = upward(self.replayer.geometry.model)
        if missing:
            poses = _poses([self.tosses[row] for row in missing])
            body = {name: values[name] for name in _CONTACT_KEYS if name in values}
            known.update(zip(missing, settled(self.replayer, poses, body)[0] @ up, strict=True))
        scale, offset = 1.0 + values.get(SCALE, 0.0), values.get(HEIGHT, 0.0)
        return np.array(
            [float(self.tosses[row].rest[0][0] @ up - scale * known[row] - offset) if row in known else np.nan for row in rows]
        )


def evidence_of(replayer: Replayer, tosses: Sequence[Toss], nominal: Mapping[str, float]) -> TossEvidence:
    """The kinds of evidence that at least three tosses give, with their scatter and their systematic errors."""
    up, (up_error, side_error) = upward(replayer.geometry.model), _air_m_s2(replayer, tosses)
    bare = TossEvidence(replayer, tuple(tosses), ())
    flights = np.array([_longest(toss).acceleration_m_s2 for toss in tosses if toss.flights] or np.zeros((0, 3)))
    rest = bare.rest(nominal, range(len(tosses)))
    rest = rest[np.isfinite(rest)]
    along = np.outer(flights @ up, up)
    found = (
        (sum(toss.moves for toss in tosses), EvidenceKind(MOTION, "widths", 3, 0.0, 0.0, "motion through contacts")),
        (len(flights), EvidenceKind(FLIGHT, "m/s^2", 1, _scatter(flights @ up), up_error, "acceleration in free flight")),
        (
            len(flights),
            EvidenceKind(SIDEWAYS, "m/s^2", 2, _scatter(flights - along), side_error, "sideways acceleration in free flight"),
        ),
        (len(rest), EvidenceKind(REST, "m", 1, _scatter(rest), _sag_m(replayer, tosses, nominal), "height at rest")),
    )
    return TossEvidence(replayer, tuple(tosses), tuple(kind for count, kind in found if count >= _FEWEST), bare.heights_m)


def _scatter(values: np.ndarray) -> float:
    """Standard deviation about the median, of vectors its size, from the median deviation."""
    if len(values) < _FEWEST:
        return 1.0
    off = values - np.median(values, axis=0)
    if off.ndim == 1:
        return max(float(np.median(np.abs(off))) / MEDIAN_SIZE, 1e-12)
    return max(float(np.median(np.linalg.norm(off, axis=1))) / MEDIAN_LENGTH_OF_TWO, 1e-12)


def _poses(tosses: Sequence[Toss]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([toss.rest[0] for toss in tosses]), np.concatenate([toss.rest[1] for toss in tosses])


def _longest(toss: Toss) -> Flight:
    return max(toss.flights, key=lambda stretch: stretch.duration_s)


def _air_m_s2(replayer: Replayer, tosses: Sequence[Toss]) -> tuple[float, float]:
    """What air does to the mean acceleration: buoyancy and drag along gravity, and drag across."""
    geometry = replayer.geometry
    model, up = geometry.model, upward(geometry.model)
    mass_kg = float(model.body_subtreemass[model.geom_bodyid[geometry.geoms[0]]])
    velocities = np.array([toss.velocity_m_s for toss in tosses if toss.flights] or [np.zeros(3)])
    drag = 0.5 * _AIR_KG_M3 * _DRAG_COEFFICIENT * geometry.width_m**2 / mass_kg
    drag_m_s2 = np.mean(np.linalg.norm(velocities, axis=1)[:, None] * velocities, axis=0) * drag
    buoyancy_m_s2 = float(np.linalg.norm(model.opt.gravity)) * _AIR_KG_M3 * geometry.volume_m3 / mass_kg
    return buoyancy_m_s2 + abs(float(drag_m_s2 @ up)), float(np.linalg.norm(drag_m_s2 - (drag_m_s2 @ up) * up))


def _sag_m(replayer: Replayer, tosses: Sequence[Toss], nominal: Mapping[str, float]) -> float:
    """How far the object sinks into what it rests on, because contacts of the model give way.

    No less than a thousandth of its radius: neither an object nor a table is known better without a coordinate machine.
    """
    least = _SHAPE_KNOWN_TO * replayer.geometry.radius_m
    resting = [toss for toss in tosses if len(toss.rest[0])][:20]
    if not resting:
        return least
    poses = _poses(resting)
    model = replayer.model(nominal)
    return max(float(-np.median(gaps_m(model, replayer.geometry, *settled(replayer, poses, nominal)))), least)
