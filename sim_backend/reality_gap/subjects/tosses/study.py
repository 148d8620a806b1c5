"""What tosses of an object say about friction, contacts, size, gravity and the measurement's scale: the study as a process."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.recording import Recording, RecordingError
from sim_backend.reality_gap.subjects.tosses.confirmation import Confirmation, confirmed
from sim_backend.reality_gap.subjects.tosses.evidence import REST, TossEvidence, evidence_of
from sim_backend.reality_gap.subjects.tosses.findings import (
    Lost,
    Profile,
    causes_of,
    lost_of,
    members_of,
    profiles_of,
    record_next,
    undecided,
)
from sim_backend.reality_gap.subjects.tosses.geometry import geometry_of
from sim_backend.reality_gap.subjects.tosses.likelihood import folds_of, sign_flip_p
from sim_backend.reality_gap.subjects.tosses.models import HEIGHT, SCALE, nominal_values
from sim_backend.reality_gap.subjects.tosses.replay import Replayer, replay_step_s
from sim_backend.reality_gap.subjects.tosses.search import TossSearch, bounds_of, hypotheses_of
from sim_backend.reality_gap.subjects.tosses.selection import Selection, selected
from sim_backend.reality_gap.subjects.tosses.stretches import tosses_of
from sim_backend.reality_gap.verdict import Cause, HeldOut, Rival, VerdictKind

_STUDIED, _CONFIRMED = 96, 192  # tosses to fit and compare, and to confirm with
_FIRST_SHARE, _FIRST_LEAST = 0.4, 8  # of them, for a first look
_FAR = 3.0
"""Times the noise floor: what a replay's start is not known by grows at contacts, and not alike in each set of tosses."""
_ALMOST = 0.7
"""Where so much of the error is gone, what is left is the shape of a contact law and not another cause, as for joints."""
_FEW = 40  # episodes below which all are studied, and folds alone are held out


@dataclass(frozen=True)
class ObjectStudy:
    """What the tosses of one object say.

    Attributes:
        kind: how the study ended.
        causes: named, with intervals; members of a confusable set, if that is the kind.
        confirmation: errors before and after on tosses that the study never saw (or on its own, if there are few).
        selection: all stages with every hypothesis and its gain.
        lost: hypotheses that a cause made needless, closest first.
        profiles: of each named parameter.
        null_p: how often chance signs would give a largest gain like the measured one.
        cannot_tell: sentences.
        record_next: sentences.
        sections: parts of ``study.json``.
    """

    kind: VerdictKind
    causes: tuple[Cause, ...]
    confirmation: Confirmation | None
    selection: Selection
    lost: tuple[Lost, ...]
    profiles: tuple[Profile, ...]
    null_p: float
    cannot_tell: tuple[str, ...]
    record_next: tuple[str, ...]
    sections: Mapping[str, Any]

    @property
    def runner_up(self) -> Rival | None:
        """The closest of what lost, with what separates it."""
        return self.lost[0].rival if self.lost else None


def study_object(
    spec: mujoco.MjSpec,
    recordings: Sequence[Recording],
    nominal: Mapping[str, float],
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
    threads: int = 2,
) -> ObjectStudy:
    """Find what explains how recorded tosses differ from a model.

    Args:
        spec: MJCF with the object as a free body, and what it can touch; its friction cone and solver are kept.
        recordings: one an episode, with poses of the object; the first one's object is studied.
        nominal: values to start from by catalogue key (``table_friction.coefficient``), what is missing is the model's own.
        rng: for splits and bootstraps.
        progress: told what is done now, and the share that is done.
        threads: of the replays.

    Raises:
        RecordingError: if the recordings hold no object, or none that can be studied with this model.
        ValueError: if a nominal value is unknown or out of bounds.
    """
    progress("stretches", 0.0)
    evidence, start = _evidence(spec, recordings, nominal, threads)
    study, unseen = _split(evidence, rng)
    hypotheses, folds = hypotheses_of(evidence.replayer.geometry.body), folds_of(evidence.episodes[study.rows], rng)
    selection = selected(study, hypotheses, start, folds, rng, lambda text, share: progress(text, 0.02 + 0.75 * share))
    progress("profiles", 0.78)
    profiles = tuple(one for cause in selection.causes for one in profiles_of(study, cause, selection.final, rng))
    lost = lost_of(study, selection, start)
    progress("confirmation", 0.9)
    confirmation = confirmed(
        evidence, unseen if len(unseen) else study.rows.tolist(), _steps(selection, start), len(unseen) > 0, rng
    )
    null_p = sign_flip_p([candidate.sums for candidate in selection.stages[0].candidates], rng)
    progress("what cannot be told", 0.95)
    cannot_tell = (*(_lost_sentence(one) for one in lost if one.confusable), *undecided(study, selection, hypotheses))
    causes, kind = causes_of(selection.causes, selection.final, profiles), _kind(evidence, selection, lost, confirmation)
    causes += members_of(study, lost, rng)
    if kind is VerdictKind.UNEXPLAINED and makes_worse(confirmation.held_out):
        causes = ()  # nothing that an extended model should have
    sections = _sections(selection, profiles, confirmation)
    advice = record_next(evidence, lost, selection)
    progress("done", 1.0)
    return ObjectStudy(kind, causes, confirmation, selection, lost, profiles, null_p, cannot_tell, advice, sections)


def _evidence(
    spec: mujoco.MjSpec, recordings: Sequence[Recording], nominal: Mapping[str, float], threads: int
) -> tuple[TossEvidence, dict[str, float]]:
    bodies = [signals.body for recording in recordings for signals in recording.objects]
    if not bodies:
        raise RecordingError("no recording has poses of an object; name one under [objects] in study.toml")
    geometry = geometry_of(spec.copy().compile(), bodies[0])
    tosses = tosses_of(geometry, recordings)
    if len({toss.episode for toss in tosses}) < 2:
        raise RecordingError(f"{len(tosses)} stretches of {bodies[0]!r} can be used; at least two episodes are needed")
    start = {**nominal_values(geometry), SCALE: 0.0, HEIGHT: 0.0}
    for key, value in nominal.items():
        if key in start:
            lower, upper = bounds_of(key)
            if not lower <= value <= upper:
                raise RecordingError(
                    f"[nominal]: {key} is {value:g}; it must be between {lower:g} and {upper:g} {PARAMETERS[key].unit}"
                )
            start[key] = float(value)
    replayer = Replayer(spec, geometry, replay_step_s(tosses), threads)
    evidence = evidence_of(replayer, tosses, start)
    if not evidence.kinds:
        raise RecordingError(
            f"fewer than three of {len(tosses)} stretches of {bodies[0]!r} show flight, contact or rest; toss more"
        )
    return evidence, start


def _split(evidence: TossEvidence, rng: np.random.Generator) -> tuple[TossSearch, list[int]]:
    """Tosses to study and tosses that no fit sees, whole episodes each; none of the latter if there are few."""
    episodes = rng.permutation(np.unique(evidence.episodes))
    count = len(episodes) if len(episodes) < _FEW else min(_STUDIED, int(0.6 * len(episodes)))
    rows = np.flatnonzero(np.isin(evidence.episodes, episodes[:count]))
    first = np.flatnonzero(np.isin(evidence.episodes, episodes[: max(int(_FIRST_SHARE * count), _FIRST_LEAST)]))
    unseen = np.flatnonzero(np.isin(evidence.episodes, episodes[count : count + _CONFIRMED]))
    return TossSearch(evidence, rows, first), unseen.tolist()


def _steps(selection: Selection, start: Mapping[str, float]) -> Sequence[tuple[str, Mapping[str, float]]]:
    """Nominal, then with each cause more at its final values."""
    steps, values = [("nominal", dict(start))], dict(start)
    for cause in selection.causes:
        values = {**values, **{key: selection.final.values[key] for key in cause.keys}}
        steps.append((f"{cause.effect}, {cause.where}", values))
    return steps


def is_unexplained(held_out: HeldOut) -> bool:
    """Whether much more is left than the noise floor, and the causes, if any, took too little of it away."""
    return makes_worse(held_out) or (held_out.after > _FAR * held_out.noise_floor and held_out.reduction < _ALMOST)


def makes_worse(held_out: HeldOut) -> bool:
    """Whether what explains the tosses that were studied puts others further off, beyond chance."""
    return held_out.is_unseen and held_out.reduction_interval_95[1] < 0.0


def _kind(evidence: TossEvidence, selection: Selection, lost: Sequence[Lost], confirmation: Confirmation) -> VerdictKind:
    if confirmation.is_of_motion and is_unexplained(confirmation.held_out):
        return VerdictKind.UNEXPLAINED
    if selection.causes:
        return VerdictKind.CONFUSABLE if any(one.confusable for one in lost) else VerdictKind.NAMED
    if {kind.name for kind in evidence.kinds} == {REST}:
        return VerdictKind.NOT_IDENTIFIABLE
    return VerdictKind.NOTHING_WRONG


def _lost_sentence(one: Lost) -> str:
    return f"{one.cause} or {one.rival.effect}: {one.rival.behind:.1f} nats (standard error {one.behind_std:.1f}) apart"


def _sections(selection: Selection, profiles: Sequence[Profile], confirmation: Confirmation) -> dict[str, Any]:
    """Parts of ``study.json`` in plain values."""
    rows = [
        {
            "label": f"{one.hypothesis.effect}, {one.hypothesis.where}" + (f" (stage {number + 1})" if number else ""),
            "gain": one.gain,
            "interval_90": list(one.interval_90),
        }
        for number, stage in enumerate(selection.stages)
        for one in sorted(stage.candidates, key=lambda one: -one.gain)
    ]
    sections: dict[str, Any] = {
        "ranking": {
            "unit": "nats",
            "line": selection.stages[0].gate,
            "line_is_null_99": False,
            "noise_floor": None,
            "rows": rows,
        },
        "ladder": list(confirmation.ladder),
        "profiles": [
            {
                "label": one.key,
                "unit": PARAMETERS[one.key].unit,
                "value": one.value.tolist(),
                "log_likelihood": one.log_likelihood.tolist(),
                "interval_90": list(one.interval_90),
            }
            for one in profiles
        ],
    }
    if confirmation.horizon is not None:
        sections |= {"horizon": confirmation.horizon, "worst_window": confirmation.worst_window}
    return sections
