"""Which cause of the tracker or the cube is at work in logs of one robot: pushes of a cube and a cube at rest."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sim_backend.reality_gap.knowledge.cube import COUNTED, KINDS, UNTOLD_BESIDE_OTHERS, Kind
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.cube.contact import contact_summary
from sim_backend.reality_gap.subjects.cube.counts import count_p
from sim_backend.reality_gap.subjects.cube.gates import (
    COUNT_P,
    MARGIN,
    MISFIT_P,
    MOST_LEFT,
    PEAK_P,
    PUSH_GATE_P,
    REMAINDER_P,
    REMAINDER_PEAK_P,
    is_beyond_chance,
)
from sim_backend.reality_gap.subjects.cube.healthy import HealthyCubes, cubes_of_many, load_calibration
from sim_backend.reality_gap.subjects.cube.hypotheses import Judged, Null, judge, seen_count, sentence, without_worst
from sim_backend.reality_gap.subjects.cube.replay import PushReplay, Replayed
from sim_backend.reality_gap.subjects.cube.replayed_robot import ReplayedRobot
from sim_backend.reality_gap.subjects.cube.several import Scatter, Several, one_after_the_other
from sim_backend.reality_gap.subjects.cube.summary import NAMES, CubeEvidence, CubeSummary, summary_of, summary_of_evidence
from sim_backend.reality_gap.subjects.cube.support import Supported, supported
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics, tracker_statistics
from sim_backend.reality_gap.subjects.cube.verdict_of_several import verdict_of_several
from sim_backend.reality_gap.subjects.cube.windows import LEAST_PUSHES, all_push_windows
from sim_backend.reality_gap.subjects.subject import Progress
from sim_backend.reality_gap.verdict import Rival, Verdict, VerdictKind

MAX_CONFUSABLE = 3
_LEAST_TOLD = 0.1
"""What explains a smaller share is not spoken of."""
_RESAMPLES, _SOLID = 40, 0.8


@dataclass(frozen=True)
class CubeStudy:
    """What came out.

    Attributes:
        verdict: as of any study; its ``causes`` are those named, or the members of a confusable set.
        ranking: every hypothesis with its gain, nats, and its estimates, the best first; where several causes were looked for,
            what each would gain beside them, its numbers about theirs.
        pushes: windows that were replayed.
        chosen: share of resamples of the pushes in which the best hypothesis was the best, too; 1 where several were looked for.
    """

    verdict: Verdict
    ranking: tuple[Judged, ...]
    pushes: int
    chosen: float


def study_cube(
    recordings: Sequence[Recording],
    rng: np.random.Generator,
    progress: Progress = lambda *_: None,
    *,
    calibration: HealthyCubes | None = None,
    replay: PushReplay | None = None,
    robot: KnownTriFinger | None = None,
) -> CubeStudy:
    """Name the cause, or say that there is none, or that it cannot be told.

    Args:
        recordings: of one robot and one object; regimes ``rest`` and ``slide_cube`` are what the healthy scatter was measured on.
        rng: for resamples of the pushes.
        progress: told what is done, and which share.
        calibration: scatter of healthy sessions; the package's if None.
        replay: of nominal robots, to be used again from study to study; made if None.
        robot: with what was found of its joints; nothing if None.
    """
    calibration = calibration or load_calibration()
    base = ReplayedRobot() if robot is None else ReplayedRobot.of(robot.found)
    windows, tracker = all_push_windows(base.as_it_was(recordings)), tracker_statistics(recordings)

    def evidence_with(known: ReplayedRobot) -> CubeEvidence:
        own = replay if replay is not None and known.is_nominal else PushReplay(base=known)
        return CubeEvidence(tracker, tuple(own.replay(windows)), known.rest_height_m)

    progress(f"replaying {len(windows)} pushes", 0.0)
    if robot is not None and robot.differs_everywhere and tracker is not None:
        return _study_of_several(evidence_with, base, len(windows), calibration, progress)
    evidence = evidence_with(base) if windows else CubeEvidence(tracker, ())
    return study_evidence(evidence, rng, calibration)


def _study_of_several(
    evidence_with: Callable[[ReplayedRobot], CubeEvidence],
    base: ReplayedRobot,
    pushes: int,
    calibration: HealthyCubes,
    progress: Progress,
) -> CubeStudy:
    """The study of a robot whose joints differ in many ways, so that cube and tracker are expected to, too."""
    of_many = cubes_of_many(calibration.null)
    if pushes >= LEAST_PUSHES:
        is_enough = partial(is_beyond_chance, calibration, Kind.PUSHES)
        found = one_after_the_other(evidence_with, base, Scatter(calibration.null, of_many.null), is_enough, progress)
    else:
        found = Several.without_pushes(replace(evidence_with(base), replayed=()), of_many.null)
    cannot, record = _limits_of_log(pushes)
    shared = {"cannot_tell": (*cannot, *UNTOLD_BESIDE_OTHERS.values()), "record_next": record}
    verdict = verdict_of_several(found, of_many, calibration, shared)
    return CubeStudy(verdict, tuple(judge(found.summary, of_many.null)), pushes, 1.0)


def study_evidence(
    evidence: CubeEvidence, rng: np.random.Generator, calibration: HealthyCubes, without: Collection[str] = ()
) -> CubeStudy:
    """As :func:`study_cube`, when the pushes have been replayed; hypotheses in ``without`` are left out."""
    if evidence.tracker is None:
        text = "there are too few reports of a tracked object to say anything about cube or tracker"
        verdict = Verdict(VerdictKind.NOT_IDENTIFIABLE, text, cannot_tell=("every cause of tracker and cube",))
        return CubeStudy(verdict, (), 0, 0.0)
    kept = without_worst(evidence, calibration.null)
    summary, pushes = summary_of_evidence(kept), len(evidence.replayed)
    seen = supported(kept, calibration.null, without)
    beyond_chance = _beyond_chance(seen, calibration)
    ranking = _ranked(seen.ranking, beyond_chance)
    chosen = _chosen(ranking[0].effect, summary.tracker, kept.replayed, beyond_chance, rng, calibration.null, without)
    return CubeStudy(_verdict(ranking, summary, seen, calibration, chosen, pushes), ranking, pushes, chosen)


def _beyond_chance(seen: Supported, calibration: HealthyCubes) -> frozenset[str]:
    """Effects of the kinds that gain more than chance."""
    kinds = {kind for kind, gain in seen.gains().items() if is_beyond_chance(calibration, kind, gain)}
    if calibration.push_gain_p(seen.push_gain()) <= PUSH_GATE_P:
        kinds.add(Kind.PUSHES)
    return frozenset(effect for kind in kinds for effect in KINDS[kind])


def _ranked(by_gain: Sequence[Judged], beyond_chance: Collection[str]) -> tuple[Judged, ...]:
    """Hypotheses, those of kinds that gain more than chance before the others, within each by their gain."""
    return tuple(sorted(by_gain, key=lambda row: (row.effect not in beyond_chance, -row.gain)))


def _chosen(
    best: str,
    tracker: TrackerStatistics | None,
    replayed: Sequence[Replayed],
    beyond_chance: Collection[str],
    rng: np.random.Generator,
    null: Null,
    without: Collection[str],
) -> float:
    """Share of resamples of the pushes in which the best hypothesis is the best, too."""
    if len(replayed) < 2:
        return 1.0
    same = 0
    for _ in range(_RESAMPLES):
        picked = [replayed[i] for i in rng.integers(len(replayed), size=len(replayed))]
        again = judge(summary_of(tracker, contact_summary(picked)), null, without)
        same += _ranked(again, beyond_chance)[0].effect == best
    return same / _RESAMPLES


def _verdict(
    ranking: Sequence[Judged], summary: CubeSummary, seen: Supported, calibration: HealthyCubes, chosen: float, pushes: int
) -> Verdict:
    best, beyond_chance = ranking[0], _beyond_chance(seen, calibration)
    p = min(calibration.push_gain_p(seen.push_gain()), *(calibration.gain_p(kind, gain) for kind, gain in seen.gains().items()))
    cannot, record = _limits_of_log(pushes)
    shared = {"null_p": 1.0 - (1.0 - p) ** (len(KINDS) + 1), "cannot_tell": cannot, "record_next": record}
    is_far = calibration.misfit_p(seen.misfit()) <= MISFIT_P
    if not (beyond_chance or is_far or _is_odd(seen.peaks(), calibration, PEAK_P) or _many(summary, calibration)):
        text = f"cube and tracker are as those of a healthy robot (p {shared['null_p']:.2g})"
        return Verdict(VerdictKind.NOTHING_WRONG, text, **shared)
    usual = float(np.median(calibration.misfits))
    left = (seen.misfit(best.effect) - usual) / max(seen.misfit() - usual, 1e-9)
    is_partly = is_far and left > MOST_LEFT and calibration.misfit_p(seen.misfit(best.effect)) <= REMAINDER_P
    if is_partly or _is_odd(seen.peaks(best.effect), calibration, REMAINDER_PEAK_P) or best.effect not in beyond_chance:
        text = _partly(best.effect, 1.0 - left, is_chance=best.effect not in beyond_chance)
        return Verdict(VerdictKind.UNEXPLAINED, text, follows=_follows(summary, calibration), **shared)
    return _naming(ranking, beyond_chance, chosen, shared)


def _partly(effect: str, explained: float, *, is_chance: bool) -> str:
    """What a hypothesis that is no name comes to."""
    share = f"{min(explained, 1.0):.0%} of it"
    if explained < _LEAST_TOLD:
        return "something is wrong that no cause of the catalogue explains"
    if is_chance:
        return f"something is wrong; {effect} would explain {share}, which is no more than chance or a single push may"
    return f"something is wrong, but {effect} explains only {share}"


def _is_odd(peaks: Mapping[Kind, float], calibration: HealthyCubes, least_p: float) -> bool:
    """Whether a number for itself is farther off than those of healthy sessions."""
    return any(calibration.peak_p(kind, peak) <= least_p for kind, peak in peaks.items())


def _many(summary: CubeSummary, calibration: HealthyCubes) -> tuple[str, ...]:
    """Counts that are beyond those of healthy sessions."""
    assert summary.tracker is not None
    seen = {row.count: seen_count(row.count, summary.tracker, calibration.null) for row in COUNTED}
    return tuple(name for name, each in seen.items() if count_p(each.count, each.frames, each.usual, each.spread) <= COUNT_P)


def _naming(ranking: Sequence[Judged], able: Collection[str], chosen: float, shared: dict[str, Any]) -> Verdict:
    """The best hypothesis by name, or as one of a set where others of those ``able`` come close."""
    best = ranking[0]
    close = [row for row in ranking[1:] if row.gain > best.gain - MARGIN and row.effect in able]
    if not close and chosen < _SOLID:
        close = [ranking[1]] if best.gain - ranking[1].gain < 2.0 * MARGIN else []
    members = (best, *close[: MAX_CONFUSABLE - 1])
    runner = ranking[1] if len(ranking) > 1 else best
    rival = Rival(runner.effect, runner.estimates[0].where, best.gain - runner.gain, _separated(best, runner))
    causes = tuple(cause for row in members for cause in row.causes())
    if close:
        without = {name: value for name, value in shared.items() if name != "record_next"}
        record = (*shared["record_next"], *(_separated(best, row) for row in members[1:]))
        text = "one of " + ", ".join(row.effect for row in members) + f" (p {shared['null_p']:.2g}); these logs do not say which"
        return Verdict(VerdictKind.CONFUSABLE, text, causes, runner_up=rival, **without, record_next=record)
    said = f"{best.effect}, {sentence(best.causes())} (p {shared['null_p']:.2g})"
    text = f"{said}; next is {runner.effect}, {rival.behind:.0f} nats behind"
    return Verdict(VerdictKind.NAMED, text, causes, runner_up=rival, **shared)


def _separated(best: Judged, other: Judged) -> str:
    otherwise = f"more sessions: {best.effect} and {other.effect} show in different numbers"
    return separated_by(best.effect, other.effect, otherwise)


def _follows(summary: CubeSummary, calibration: HealthyCubes) -> tuple[str, ...]:
    """The numbers that lie farthest off, each for itself."""
    far = np.abs(summary.vector - calibration.null.mean) / np.sqrt(np.diag(calibration.null.covariance))
    order = np.argsort(-np.nan_to_num(far))[:3]
    return (*_many(summary, calibration), *(f"{NAMES[k]} ({far[k]:.1f} standard deviations)" for k in order))


def _limits_of_log(pushes: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    always = (
        "a delay that the tracker's own time stamps do not hold",
        "motions of the cube off the table",
        "a camera that moves within a session, where the cube's centre of mass is, and what its edges are like",
    )
    if pushes >= LEAST_PUSHES:
        return always, ()
    if pushes:
        return always, (f"the excitation slide_cube again, with the cube placed near the centre: only {pushes} pushes met it",)
    without = ("mass and friction of the cube, and where it lies across the table: no finger pushed it",)
    return (*always, *without), ("the excitation slide_cube",)
