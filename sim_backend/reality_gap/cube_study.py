"""Which cause of the tracker or the cube is at work in logs of one robot: pushes of a cube and a cube at rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.cube_calibration import Calibration, load_calibration
from sim_backend.reality_gap.cube_contact import contact_summary
from sim_backend.reality_gap.cube_hypotheses import Z_90, Judged, judge, misfit
from sim_backend.reality_gap.cube_replay import PushReplay, Replayed
from sim_backend.reality_gap.cube_summary import NAMES, CubeSummary, summary_of
from sim_backend.reality_gap.cube_tracker import TrackerStatistics, tracker_statistics
from sim_backend.reality_gap.cube_windows import all_push_windows
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.verdict import Cause, Rival, Verdict, VerdictKind

GATE_P = 0.02
"""A gain that so many healthy sessions reach is chance."""
MISFIT_P = 0.01
"""As much for the misfit of the whole vector, whatever causes it."""
MARGIN = 2.0
"""Nats by which the best hypothesis must lead, or the next ones may be the cause as well."""
EXPLAINED = 0.7
"""Share of what is beyond a healthy session's misfit that a cause must explain; otherwise something else is at work."""
LEAST_PUSHES = 4
"""With fewer the excitation is to be recorded again."""
MAX_CONFUSABLE = 3
_RESAMPLES, _SOLID = 40, 0.8

_SEPARATED_BY = {
    frozenset({"cube_mass", "table_friction"}): "fast pushes, after which the cube slides freely: that takes friction alone",
    frozenset(
        {"table_friction", "fingertip_friction"}
    ): "pushes against a side far off its middle, where the tip slides along it",
    frozenset({"cube_mass", "fingertip_friction"}): "a lift: it takes the mass alone",
    frozenset(
        {"cube_size", "tracking_scale"}
    ): "a cube at rest far from the arena's centre: scale grows with distance, size does not",
    frozenset({"cube_size", "tracking_offset"}): "pushes from opposite sides: a cube's size changes sides, an offset does not",
    frozenset({"tracking_offset", "tracking_scale"}): "a cube at rest at opposite ends of the arena",
}


@dataclass(frozen=True)
class Evidence:
    """What a session leaves to judge: statistics of the tracker, None with too few reports, and replayed pushes."""

    tracker: TrackerStatistics | None
    replayed: tuple[Replayed, ...]


@dataclass(frozen=True)
class CubeStudy:
    """What came out.

    Attributes:
        verdict: as of any study; its ``causes`` are those named, or the members of a confusable set.
        ranking: every hypothesis with its gain, nats, and its estimates, the best first.
        pushes: windows that were replayed.
        chosen: share of resamples of the pushes in which the best hypothesis was the best, too.
    """

    verdict: Verdict
    ranking: tuple[Judged, ...]
    pushes: int
    chosen: float


def study_cube(
    recordings: Sequence[Recording],
    rng: np.random.Generator,
    progress: Callable[[str], None] = lambda _: None,
    *,
    calibration: Calibration | None = None,
    replay: PushReplay | None = None,
) -> CubeStudy:
    """Name the cause, or say that there is none, or that it cannot be told.

    Args:
        recordings: of one robot and one object; regimes ``rest`` and ``slide_cube`` are what the healthy scatter was measured on.
        rng: for resamples of the pushes.
        progress: told what is done.
        calibration: scatter of healthy sessions; the package's if None.
        replay: to be used again from study to study; made if None.
    """
    calibration = calibration or load_calibration()
    windows = all_push_windows(recordings)
    progress(f"replaying {len(windows)} pushes")
    replayed = (replay or PushReplay()).replay(windows) if windows else []
    return study_evidence(Evidence(tracker_statistics(recordings), tuple(replayed)), rng, calibration)


def study_evidence(evidence: Evidence, rng: np.random.Generator, calibration: Calibration) -> CubeStudy:
    """As :func:`study_cube`, when the pushes have been replayed."""
    replayed = evidence.replayed
    summary = summary_of(evidence.tracker, contact_summary(replayed))
    if evidence.tracker is None:
        text = "there are too few reports of a tracked object to say anything about cube or tracker"
        verdict = Verdict(VerdictKind.NOT_IDENTIFIABLE, text, cannot_tell=("every cause of tracker and cube",))
        return CubeStudy(verdict, (), 0, 0.0)
    ranking = tuple(judge(summary, calibration.null))
    chosen = _chosen(ranking, summary, replayed, rng, calibration)
    verdict = _verdict(ranking, summary, calibration, chosen, len(replayed))
    return CubeStudy(verdict, ranking, len(replayed), chosen)


def _chosen(
    ranking: Sequence[Judged],
    summary: CubeSummary,
    replayed: Sequence[Replayed],
    rng: np.random.Generator,
    calibration: Calibration,
) -> float:
    if len(replayed) < 2:
        return 1.0
    same = 0
    for _ in range(_RESAMPLES):
        picked = [replayed[i] for i in rng.integers(len(replayed), size=len(replayed))]
        again = judge(summary_of(summary.tracker, contact_summary(picked)), calibration.null)
        same += again[0].effect == ranking[0].effect
    return same / _RESAMPLES


def _verdict(ranking: Sequence[Judged], summary: CubeSummary, calibration: Calibration, chosen: float, pushes: int) -> Verdict:
    best = ranking[0]
    p = calibration.gain_p(best.gain)
    squares, numbers = misfit(summary, calibration.null)
    far = calibration.misfit_p(squares / numbers) <= MISFIT_P
    cannot, record = _limits_of_log(pushes)
    shared = {"null_p": p, "cannot_tell": cannot, "record_next": record}
    if p > GATE_P and not far:
        text = f"cube and tracker are as those of a healthy robot (p {p:.2g})"
        return Verdict(VerdictKind.NOTHING_WRONG, text, **shared)
    beyond = squares - float(np.median(calibration.misfits)) * numbers
    counted = best.effect in ("tracking_dropout", "orientation_jumps")
    if far and not counted and 2.0 * best.gain < EXPLAINED * beyond:
        text = f"something is wrong, but {best.effect} explains only {2.0 * best.gain / max(beyond, 1e-9):.0%} of it"
        return Verdict(VerdictKind.UNEXPLAINED, text, follows=_follows(summary, calibration), **shared)
    close = [row for row in ranking[1:] if row.gain > best.gain - MARGIN]
    if not close and chosen < _SOLID:
        close = [ranking[1]] if best.gain - ranking[1].gain < 2.0 * MARGIN else []
    members = (best, *close[: MAX_CONFUSABLE - 1])
    runner = ranking[1] if len(ranking) > 1 else best
    rival = Rival(runner.effect, runner.estimates[0].where, best.gain - runner.gain, _separated(best, runner))
    causes = tuple(cause for row in members for cause in _causes(row))
    if close:
        record = (*record, *(_separated(best, row) for row in members[1:]))
        text = "one of " + ", ".join(row.effect for row in members) + f" (p {p:.2g}); these logs do not say which"
        return Verdict(VerdictKind.CONFUSABLE, text, causes, runner_up=rival, **{**shared, "record_next": record})
    text = f"{best.effect}, {_sentence(best)} (p {p:.2g}); next is {runner.effect}, {rival.behind:.0f} nats behind"
    return Verdict(VerdictKind.NAMED, text, causes, runner_up=rival, **shared)


def _causes(judged: Judged) -> tuple[Cause, ...]:
    return tuple(
        Cause(e.effect, e.parameter, e.where, e.value, e.unit, (e.value - Z_90 * e.std, e.value + Z_90 * e.std))
        for e in judged.estimates
    )


def _sentence(judged: Judged) -> str:
    return ", ".join(f"{e.parameter} {e.value:.4g} ± {Z_90 * e.std:.2g} {e.unit}".strip() for e in judged.estimates)


def _separated(best: Judged, other: Judged) -> str:
    pair = frozenset({best.effect, other.effect})
    return _SEPARATED_BY.get(pair, f"more sessions: {best.effect} and {other.effect} show in different numbers")


def _follows(summary: CubeSummary, calibration: Calibration) -> tuple[str, ...]:
    """The numbers that lie farthest off, each for itself."""
    far = np.abs(summary.vector - calibration.null.mean) / np.sqrt(np.diag(calibration.null.covariance))
    order = np.argsort(-np.nan_to_num(far))[:3]
    return tuple(f"{NAMES[k]} ({far[k]:.1f} standard deviations)" for k in order)


def _limits_of_log(pushes: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    always = ("a delay that the tracker's own time stamps do not hold", "motions of the cube off the table")
    if pushes >= LEAST_PUSHES:
        return always, ()
    if pushes:
        return always, (f"the excitation slide_cube again, with the cube placed near the centre: only {pushes} pushes met it",)
    without = ("mass and friction of the cube, and where it lies across the table: no finger pushed it",)
    return (*always, *without), ("the excitation slide_cube",)
