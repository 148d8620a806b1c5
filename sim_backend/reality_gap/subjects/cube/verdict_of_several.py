"""What is wrong with cube and tracker of a robot that differs everywhere: several causes, each with its own numbers."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from sim_backend.reality_gap.knowledge.cube import KINDS, Kind
from sim_backend.reality_gap.subjects.cube.gates import MISFIT_OF_MANY_P, MOST_LEFT, is_beyond_chance
from sim_backend.reality_gap.subjects.cube.healthy import CubesOfMany, HealthyCubes, misfit_of_pushes
from sim_backend.reality_gap.subjects.cube.hypotheses import Judged, Null, farthest_names, judge, sentence
from sim_backend.reality_gap.subjects.cube.several import Several
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind


def verdict_of_several(found: Several, of_many: CubesOfMany, calibration: HealthyCubes, shared: dict[str, Any]) -> Verdict:
    """All causes by name if together they leave little.

    Args:
        found: what pushes show.
        of_many: sessions of such robots with nothing wrong with the cube.
        calibration: healthy sessions.
        shared: what the verdict says whatever it is.
    """
    reported = _of_reports(found, of_many.null, calibration)
    by_reports, by_pushes = [cause for row in reported for cause in row.causes()], [row.cause() for row in found.estimates]
    usual = float(np.median(of_many.misfits))
    before, after = (misfit_of_pushes(each, each.vector) for each in (found.first, found.session))
    left = (after - usual) / max(before - usual, 1e-9)
    if of_many.misfit_p(after) <= MISFIT_OF_MANY_P and left > MOST_LEFT:
        explained = sum((found.session.vector - row.left for row in reported), np.zeros(len(found.session.vector)))
        far = farthest_names(found.session, found.session.vector - explained)
        follows = tuple(f"{name} ({off:.1f} standard deviations)" for name, off in far)
        what = f"{_told(by_pushes)} leave {left:.0%} of it" if by_pushes else "no cause of the catalogue explains it"
        beside = f" Its reports show {_told(by_reports)}." if by_reports else ""
        text = f"Pushes do not move the cube as they should, and {what}.{beside}"
        return Verdict(VerdictKind.UNEXPLAINED, text, tuple(by_reports), follows=follows, **shared)
    causes = (*by_pushes, *by_reports)
    if not causes:
        return Verdict(VerdictKind.NOTHING_WRONG, "Cube and tracker are as those of a healthy robot.", **shared)
    return Verdict(VerdictKind.NAMED, f"Cube and tracker: {_told(causes)}.", causes, **shared)


def _of_reports(found: Several, null: Null, calibration: HealthyCubes) -> list[Judged]:
    """Hypotheses about reports alone: each moves numbers of its own, so that none can pass for another."""
    kinds = {effect: kind for kind in (Kind.TRACKER, Kind.COUNTS) for effect in KINDS[kind]}
    ranking = [row for row in judge(found.summary, null) if row.effect in kinds]
    return [row for row in ranking if is_beyond_chance(calibration, kinds[row.effect], row.gain)]


def _told(causes: Sequence[Cause]) -> str:
    groups = groupby(causes, key=lambda cause: cause.effect)
    return "; ".join(f"{effect.replace('_', ' ')} ({sentence(own)})" for effect, own in groups)
