"""From measured errors of the tracker on images to ranges of the formula's effects: the preset ``real-2``.

What stays the same for a robot becomes its offset, what differs from look to look of one scene its noise, and what is left, the
error that goes with a scene, its episode noise. How often the formula does not see is matched to the images in the same scenes.
"""

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sim_backend.driver.detection import Values, detect
from sim_backend.vision.image_tracker import SURE

JUMPED_RAD = np.deg2rad(45.0)
"""From here on an orientation is another of the cube's 24 and no error of the same one."""
HIDDEN_BOUNDS = (0.0, 0.1, 0.3, 0.5, 1.01)
STRENGTHS, MISSED = np.round(np.arange(0.0, 1.51, 0.1), 2), (0.0, 0.01, 0.02, 0.04, 0.06)
"""What is tried of ``occlusion_by_fingers.strength`` and ``colour_segmentation.missed``."""
LOW, HIGH = 10, 90
"""Percentiles over robots that bound a range which is drawn evenly."""


@dataclass(frozen=True)
class Measured:
    """A range found for a parameter: its bounds as the ranges' files have them, and how it was found."""

    key: str
    distribution: str
    low: float
    high: float
    each: bool
    source: str


def ranges_of(rows: Sequence[Mapping[str, Any]], occlusion: tuple[float, float]) -> list[Measured]:
    """Ranges of the formula's effects from rows of ``tracker_errors.py``.

    Args:
        rows: of at least two robots with at least two scenes each.
        occlusion: strength of the fingers and mean share of missed pixels, as :func:`matched_occlusion` finds them.

    Raises:
        ValueError: there are too few rows.
    """
    robots = _by_robot(rows)
    if len(robots) < 2:
        raise ValueError(f"the rows are of {len(robots)} robots with two scenes that were seen; at least 2 are needed")
    parts = {unit: _parts(robots, unit) for unit in ("position_mm", "rotation_rad")}
    (offset_mm, noise_mm, scene_mm), (offset_rad, noise_rad, scene_rad) = parts["position_mm"], parts["rotation_rad"]
    looks = f"{len(rows)} scenes of {len(robots)} robots, three looks each (results/tracker-errors.jsonl)"
    jumps, seen = _jumps(rows)
    strength, missed = occlusion
    most = _upper(jumps, seen)

    def even(key: str, values: np.ndarray, what: str) -> Measured:
        low, high = np.percentile(values, [LOW, HIGH])
        return Measured(key, "uniform", float(low), float(high), False, f"{what}: 10th to 90th percentile over robots; {looks}")

    return [
        _about_zero("tracking_offset.position_m", offset_mm / 1000, f"what is the same in all scenes of a robot; {looks}"),
        _about_zero("tracking_offset.rotation_rad", offset_rad, f"likewise, of orientations; {looks}"),
        even("tracking_noise.position_m", noise_mm / 1000, "difference of two looks at one scene"),
        even("tracking_noise.rotation_rad", noise_rad, "likewise, of orientations"),
        even("tracking_episode_noise.position_m", scene_mm / 1000, "what is left: an error that goes with the scene"),
        even("tracking_episode_noise.rotation_rad", scene_rad, "likewise, of orientations"),
        Measured("orientation_jumps.probability", "uniform", 0.0, most, False, f"{jumps} jumps in {seen} looks; {looks}"),
        Measured("tracking_scale.factor_error", "uniform", *_scale(robots), False, f"errors away from the middle; {looks}"),
        Measured(
            "colour_segmentation.missed",
            "uniform",
            0.0,
            2 * missed,
            False,
            f"matched to how often images do not show it; {looks}",
        ),
        Measured("occlusion_by_fingers.strength", "fixed", strength, strength, False, f"likewise; {looks}"),
    ]


def _about_zero(key: str, deviation: float, source: str) -> Measured:
    return Measured(key, "gaussian", -deviation, deviation, True, source)


def _by_robot(rows: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """Rows of each robot whose every look saw the cube the right way round; robots with two such rows at least."""
    robots: dict[int, list[Mapping[str, Any]]] = {}
    for row in rows:
        looks = row["images"].values()
        if all(each["confidence"] >= SURE and np.linalg.norm(each["rotation_rad"]) < JUMPED_RAD for each in looks):
            robots.setdefault(row["robot"], []).append(row)
    return [each for each in robots.values() if len(each) > 1]


def _parts(robots: Sequence[Sequence[Mapping[str, Any]]], unit: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Standard deviations of one coordinate: of robots' offsets, and for each robot of noise and of what goes with a scene."""
    noise, scene, means, uncertain = [], [], [], []
    for rows in robots:
        one, other = (np.array([row["images"][look][unit] for row in rows]) for look in ("at_rest", "again"))
        white = float(np.mean(np.square(one - other)) / 2)
        within = float(np.mean(np.var(one, axis=0, ddof=1)))
        noise.append(np.sqrt(white))
        scene.append(np.sqrt(max(within - white, 0.0)))
        means.append(one.mean(axis=0))
        uncertain.append(within / len(rows))
    between = float(np.mean(np.square(means)) - np.mean(uncertain))
    return float(np.sqrt(max(between, 0.0))), np.array(noise), np.array(scene)


def _scale(robots: Sequence[Sequence[Mapping[str, Any]]]) -> tuple[float, float]:
    """By how much distances from the world's origin are seen too large: the least and the most, one standard deviation off."""
    slopes = []
    for rows in robots:
        at = np.array([row["position_m"] for row in rows])
        off = np.array([row["images"]["at_rest"]["position_mm"] for row in rows]) / 1000
        slopes.append(float((at * off).sum() / np.square(at).sum()))
    middle, spread = float(np.mean(slopes)), float(np.std(slopes) / np.sqrt(len(slopes)))
    return middle - spread, middle + spread


def _jumps(rows: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    seen = [each for row in rows for each in row["images"].values() if each["confidence"] >= SURE]
    return sum(bool(np.linalg.norm(each["rotation_rad"]) >= JUMPED_RAD) for each in seen), len(seen)


def _upper(count: int, of: int) -> float:
    """The upper end of Wilson's 80 % interval of a rate."""
    z, rate = 1.2816, count / max(of, 1)
    return float((rate + z * z / 2 / of + z * np.sqrt(rate * (1 - rate) / of + z * z / 4 / of**2)) / (1 + z * z / of))


def unseen(rows: Sequence[Mapping[str, Any]], confidence: np.ndarray) -> np.ndarray:
    """Share of rows that count as not seen, by the share that fingers hide (``HIDDEN_BOUNDS``); NaN where there are none."""
    hidden = np.array([row["hidden"] for row in rows])
    parts = [(low <= hidden) & (hidden < high) for low, high in pairwise(HIDDEN_BOUNDS)]
    return np.array([np.mean(confidence[part] < SURE) if part.any() else np.nan for part in parts])


def matched_occlusion(rows: Sequence[Mapping[str, Any]], values: Callable[[float, float], Values]) -> tuple[float, float]:
    """Strength of the fingers and mean share of missed pixels with which the formula sees as often as images do.

    Args:
        rows: of ``tracker_errors.py``.
        values: gives the formula's values for one robot of that strength and share.
    """
    wanted = unseen(rows, np.array([row["images"]["at_rest"]["confidence"] for row in rows]))
    weight = unseen(rows, np.full(len(rows), -1.0)) * _counts(rows)
    tried = [(strength, missed) for strength in STRENGTHS.tolist() for missed in MISSED]

    def apart(given: tuple[float, float]) -> float:
        found = unseen(rows, confidences(rows, values(*given)))
        return float(np.nansum(weight * np.square(found - wanted)))

    return min(tried, key=lambda given: (round(apart(given), 6), abs(given[0] - 1.0), given[1]))


def _counts(rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    return np.histogram([row["hidden"] for row in rows], HIDDEN_BOUNDS)[0].astype(float)


def confidences(rows: Sequence[Mapping[str, Any]], values: Values) -> np.ndarray:
    """The formula's confidence in each row's scene, shape (rows,), for one robot's values."""
    n = len(rows)
    state = (np.array([row[name] for row in rows]) for name in ("joint_position_rad", "position_m", "quat_wxyz"))
    alike = Values(*(np.repeat(each, n, axis=0) for each in values))
    return detect(alike, np.arange(n), np.arange(n), *state)[1]


def preset_text(found: Sequence[Measured], about: str, dated: datetime.date) -> str:
    """A file of ranges that extends ``real`` with what was found."""
    parts = [f'about = "{about}"\nextends = "real"\n']
    for row in found:
        numbers = f"value = {row.low:.4g}" if row.distribution == "fixed" else f"low = {row.low:.4g}\nhigh = {row.high:.4g}"
        each = "\neach = true" if row.each else ""
        text = f'[[range]]\nkey = "{row.key}"\ndistribution = "{row.distribution}"\n{numbers}\nper = "robot"{each}\n'
        parts.append(f'{text}source = "measured by trifarm calibrate-tracker: {row.source}"\ndated = {dated}\n')
    return "\n".join(parts)
