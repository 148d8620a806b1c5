"""How healthy sessions with a cube scatter, and what chance gives: the table that studies compare a session with."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from sim_backend.reality_gap.knowledge.cube import KINDS, Kind
from sim_backend.reality_gap.knowledge.healthy import CUBES_FILE, CUBES_OF_MANY_FILE
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES
from sim_backend.reality_gap.subjects.cube.hypotheses import Null, WhitenedSession
from sim_backend.reality_gap.subjects.cube.summary import NAMES, PLACED_NAMES

FORMAT = 3
PACKAGED = CUBES_FILE.with_suffix(".json")


@dataclass(frozen=True)
class HealthyCubes:
    """What a study of a cube compares a session with.

    Attributes:
        null: scatter over healthy sessions.
        gains: by kind of hypotheses the largest gain of each healthy session by a scatter measured without it, increasing.
        push_gains: of each healthy session, of the best hypothesis about pushes without the push that it gains most by, likewise.
        misfits: misfit per number of each healthy session, likewise.
        peaks: by kind how far off the farthest of its numbers is in each healthy session, likewise.
        limits: detection limits by effect and side, in the parameter's unit.
        seeds: first seed and number of sessions of each group.
    """

    null: Null
    gains: Mapping[Kind, np.ndarray]
    push_gains: np.ndarray
    misfits: np.ndarray
    peaks: Mapping[Kind, np.ndarray]
    limits: dict[str, float]
    seeds: tuple[tuple[int, int], ...]

    def gain_p(self, kind: Kind, gain: float) -> float:
        """Probability that hypotheses of this kind gain so much by chance.

        The share of healthy sessions that do, but at least what Gaussian numbers and as many hypotheses would give.
        """
        share = _share(self.gains[kind], gain)
        return max(share, min(1.0, len(KINDS[kind]) * float(stats.chi2.sf(2.0 * max(gain, 0.0), 1))))

    def misfit_p(self, per_number: float) -> float:
        """Share of healthy sessions that lie at least so far off."""
        return _share(self.misfits, per_number)

    def push_gain_p(self, gain: float) -> float:
        """Share of healthy sessions in which a hypothesis gains so much without any one push."""
        return _share(self.push_gains, gain)

    def peak_p(self, kind: Kind, peak: float) -> float:
        """Share of healthy sessions in which some number of this kind lies at least so far off."""
        return _share(self.peaks[kind], peak)

    def document(self) -> dict[str, Any]:
        """Plain values for JSON."""
        null = {name: np.asarray(value).round(10).tolist() for name, value in asdict(self.null).items()}
        by_kind = {
            name: {kind: np.round(values, 4).tolist() for kind, values in kinds.items()}
            for name, kinds in (("gains", self.gains), ("peaks", self.peaks))
        }
        arrays = by_kind | {name: np.round(getattr(self, name), 4).tolist() for name in ("push_gains", "misfits")}
        return {"format": FORMAT, "names": NAMES, "seeds": self.seeds, "limits": self.limits, **arrays, "null": null}


def load_calibration(path: Path = PACKAGED) -> HealthyCubes:
    """A table that the calibration program wrote.

    Raises:
        ValueError: it was made for other numbers than this version looks at.
    """
    document = json.loads(path.read_text(encoding="utf-8"))
    if document["format"] != FORMAT or tuple(document["names"]) != NAMES:
        raise ValueError(f"{path} was made for other numbers; run python -m sim_backend.reality_gap.bench.cube_calibration again")
    null = document["null"]
    null |= {"mean": np.array(null["mean"]), "covariance": np.array(null["covariance"])}
    gains, peaks = ({Kind(kind): np.array(values) for kind, values in document[name].items()} for name in ("gains", "peaks"))
    seeds = tuple(map(tuple, document["seeds"]))
    push_gains, misfits = np.array(document["push_gains"]), np.array(document["misfits"])
    return HealthyCubes(Null(**null), gains, push_gains, misfits, peaks, document["limits"], seeds)


@dataclass(frozen=True)
class CubesOfMany:
    """What a session is compared with whose robot differs everywhere: what its joints are still off by forces pushes, too.

    Attributes:
        null: scatter over such robots where no more is wrong with the cube than is known.
        misfits: misfit for each number that pushes show, of each of them, increasing.
    """

    null: Null
    misfits: np.ndarray

    def misfit_p(self, per_number: float) -> float:
        """Share of such robots that lie at least so far off."""
        return _share(self.misfits, per_number)


def cubes_of_many(healthy: Null, path: Path = CUBES_OF_MANY_FILE) -> CubesOfMany:
    """The table that ``bench/cube_of_many.py`` wrote, which is in standard deviations of healthy sessions.

    Raises:
        ValueError: it was made for other numbers than this version looks at.
    """
    kept = json.loads(path.read_text(encoding="utf-8"))
    if set(kept["middle"]) != set(PLACED_NAMES):
        raise ValueError(f"{path} was made for other numbers; run python -m sim_backend.reality_gap.bench.cube_of_many again")
    return CubesOfMany(scattered(healthy, kept["middle"], kept["spread"]), np.array(kept["misfits"]))


def scattered(healthy: Null, middle: Mapping[str, float], spread: Mapping[str, float]) -> Null:
    """A scatter with other middles and spreads of some numbers, by name, in standard deviations of healthy sessions."""
    std = np.sqrt(np.diag(healthy.covariance))
    factors, middles = (np.array([given.get(name, usual) for name in NAMES]) for given, usual in ((spread, 1.0), (middle, 0.0)))
    return replace(healthy, mean=healthy.mean + middles * std, covariance=healthy.covariance * np.outer(factors, factors))


def misfit_of_pushes(seen: WhitenedSession, left: np.ndarray) -> float:
    """Mean square of the numbers that pushes show; 0 without pushes.

    Args:
        seen: a session.
        left: its vector, or what hypotheses leave of it, shape (kept,).
    """
    of_pushes = left[np.isin(np.array(NAMES)[seen.kept], CONTACT_NAMES)]
    return float(of_pushes @ of_pushes) / max(len(of_pushes), 1)


def _share(healthy: np.ndarray, value: float) -> float:
    """Of healthy sessions with so much, counted with the one that is asked."""
    return float((1 + (healthy >= value).sum()) / (1 + len(healthy)))
