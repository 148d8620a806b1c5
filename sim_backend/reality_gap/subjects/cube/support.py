"""What a session shows without any one of its pushes.

A cause is at work in every push. Whether a cube tips or slips hangs, in some pushes, on a tenth of a millimetre, and one such
push can pass for a cause: of 400 healthy sessions those with the largest gains had nearly all of it from a single one.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.cube import KINDS, Kind
from sim_backend.reality_gap.subjects.cube.hypotheses import (
    Judged,
    Null,
    WhitenedSession,
    farthest,
    judge,
    largest_gains,
    whitened,
)
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence, CubeSummary, summary_of_evidence


@dataclass(frozen=True)
class Supported:
    """A session, and the same without each push where it has two or more.

    Attributes:
        ranking: of all its hypotheses, the best first.
        sessions: those without a push, or the whole one alone.
        judged: of each of them, by effect.
    """

    ranking: tuple[Judged, ...]
    sessions: tuple[WhitenedSession, ...]
    judged: tuple[Mapping[str, Judged], ...]

    def gains(self) -> dict[Kind, float]:
        """By kind the largest gain, nats."""
        return largest_gains(self.ranking)

    def push_gain(self) -> float:
        """What the best hypothesis about pushes gains at least, nats; 0 without one."""
        best = next((row.effect for row in self.ranking if row.effect in KINDS[Kind.PUSHES]), None)
        return min((rows[best].gain for rows in self.judged if best in rows), default=0.0)

    def misfit(self, effect: str | None = None) -> float:
        """Misfit for each number at least, of the session or of what an effect leaves of it; 1 were healthy ones Gaussian."""
        return min(_misfit(session, judged, effect) for session, judged in zip(self.sessions, self.judged, strict=True))

    def peaks(self, effect: str | None = None) -> dict[Kind, float]:
        """By kind how far off its farthest number is at least, of the session or of what an effect leaves of it."""
        found = [_peaks(session, judged, effect) for session, judged in zip(self.sessions, self.judged, strict=True)]
        return {kind: min(peaks[kind] for peaks in found) for kind in found[0]}


def supported(evidence: CubeEvidence, null: Null, without: Collection[str] = ()) -> Supported:
    """A session judged as a whole and without each push; hypotheses in ``without`` are left out."""
    pushes = evidence.replayed
    fewer = [replace(evidence, replayed=pushes[:k] + pushes[k + 1 :]) for k in range(len(pushes))] if len(pushes) > 1 else []
    summaries = [summary_of_evidence(each) for each in fewer or [evidence]]
    return Supported(
        tuple(judge(summary_of_evidence(evidence), null, without)),
        tuple(whitened(summary, null) for summary in summaries),
        tuple(_by_effect(summary, null, without) for summary in summaries),
    )


def _by_effect(summary: CubeSummary, null: Null, without: Collection[str]) -> dict[str, Judged]:
    return {row.effect: row for row in judge(summary, null, without)}


def _misfit(session: WhitenedSession, judged: Mapping[str, Judged], effect: str | None) -> float:
    left = _left(session, judged, effect)
    return float(left @ left) / len(session.kept)


def _peaks(session: WhitenedSession, judged: Mapping[str, Judged], effect: str | None) -> dict[Kind, float]:
    return farthest(session, _left(session, judged, effect))


def _left(session: WhitenedSession, judged: Mapping[str, Judged], effect: str | None) -> np.ndarray:
    """What an effect leaves of a session; all of it where that says nothing of the effect, or none is asked for."""
    return judged[effect].left if effect in judged else session.vector
