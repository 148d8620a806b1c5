"""A study: from measured data to a verdict, an extended model, what it gained, and a report.

The process is :func:`run_study`; each step is a module of its own.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.cube import REPLAYED
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.measured.farm_logs import FarmLogs, find_logs, read_farm_logs
from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.measured.foreign.study_file import StudyFile, load_study_file
from sim_backend.reality_gap.measured.foreign.study_model import NominalValue
from sim_backend.reality_gap.model.files import writable, write_models
from sim_backend.reality_gap.model.model import load_extended_model, physics_of, provenance_of
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.report.report import write_html
from sim_backend.reality_gap.subjects.cube import subject as cube
from sim_backend.reality_gap.subjects.joints import subject as joints
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.torques.calibrating import METHODS
from sim_backend.reality_gap.subjects.subject import Material, Progress, Sections, Subject, part
from sim_backend.reality_gap.subjects.tosses import subject as tosses
from sim_backend.reality_gap.success.prediction import Question, Trials, read_question, success_of
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind, joined

MANY_EFFECTS = 4
"""Of a TriFinger's mechanics; more than one or two faults have. With as many, cube and tracker may have several, too."""
SUBJECTS: tuple[Subject, ...] = (joints, cube, tosses)


@dataclass(frozen=True)
class StudyResult:
    """What a study found: its verdict, the document that its report is made of, and the files that it wrote."""

    verdict: Verdict
    document: dict[str, Any]
    files: tuple[Path, ...]


def run_study(
    source: Path,
    out: Path,
    *,
    data_root: Path | None = None,
    method: str = "naming",
    seed: int = 0,
    trials: Trials | None = None,
    progress: Progress = lambda *_: None,
) -> StudyResult:
    """Study recordings and write ``study.json``, ``report.html`` and the extended model to ``out``.

    ``trials`` of a policy on the same robot are predicted with both models, where it is one of the farm's.

    Raises:
        RecordingError: data that cannot be used, or an unknown method; the message says why.
    """
    if method not in METHODS:
        raise RecordingError(f"unknown method {method!r}{nearest(method, METHODS)}; choose from {', '.join(METHODS)}")
    rng = np.random.default_rng(seed)
    logs = find_logs(source) if source.is_dir() else None
    question = _question(logs, trials)
    _make_folder(out)  # now, so that no result of long work is lost
    named = 0.95 if question is None else 0.6
    material = material_of(logs or source, data_root, part(progress, 0.0, 0.1), method)  # 1 recording
    verdict, sections = verdict_of(material, rng, part(progress, 0.1, named))  # 2 replay, 3 residual, 4 fit, 5 verdict, 7 gain
    models = _extended(verdict, material, out)  # 6 extended model
    sections |= _success(question, models, rng, part(progress, named, 0.95))  # 7 gain in success
    document = _document(material, verdict, sections, out)
    (out / "study.json").write_text(json.dumps(document, indent=1))
    progress("writing the report", 0.95)
    write_html(document, out / "report.html")  # 8 report
    return StudyResult(verdict, document, (out / "study.json", out / "report.html", *models))


def material_of(source: FarmLogs | Path, data_root: Path | None, progress: Progress, method: str = "naming") -> Material:
    """Step 1: the farm's logs, or anyone's data by a study.toml."""
    if isinstance(source, FarmLogs):
        recordings = read_farm_logs(source.judged, progress)
        title = f"Logs in {source.judged[0].parent.resolve().name}"
        return Material(title, tuple(recordings), source.judged, None, source.robot, source.trials, method)
    study_file = load_study_file(source, data_root)
    recordings = read_recordings(study_file, lambda what: progress(f"reading {what}", 0.0))
    files = (source, study_file.model, *dict.fromkeys(entry.file for entry in study_file.recordings))
    return Material(study_file.title, tuple(recordings), files, study_file, method=method)


def verdict_of(material: Material, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, Sections]:
    """Steps 2 to 5 and 7 of every subject that the recordings show, and all verdicts as one."""
    asked = [subject for subject in SUBJECTS if subject.seen_in(material)]
    if not asked:
        raise RecordingError("the recordings have neither joints nor objects that could be compared with a model")
    if material.study_file is not None:
        known = UnknownRobot(material.study_file.tolerance)
    else:
        known = KnownTriFinger.seen_in(joints.seen_in(material))
    found: list[tuple[Verdict, Sections]] = []
    for subject, own in zip(asked, _shares(asked, progress), strict=True):
        found.append(subject.study(material, known, rng, own))
        known = knowing(known, found[-1][0])
    verdict, sections = joined([verdict for verdict, _ in found]), {}
    for _, own in reversed(found):
        sections |= own
    if material.study_file is not None and material.study_file.kept_only:
        unjudged = f"anything from {listed(material.study_file.kept_only)}, by which no cause is judged"
        verdict = replace(verdict, cannot_tell=(*verdict.cannot_tell, unjudged))
    if material.trials:
        unread = f"anything from logs of trials ({len(material.trials)}): fingers may touch the cube and the table there"
        verdict = replace(verdict, cannot_tell=(*verdict.cannot_tell, unread))
    return verdict, sections


def knowing(known: Robot, verdict: Verdict) -> Robot:
    """What is known of a TriFinger after one of its subjects was studied."""
    if not isinstance(known, KnownTriFinger) or verdict.verdict is not VerdictKind.NAMED:
        return known
    clear = {cause.effect for cause in verdict.causes if not _may_be_absent(cause)}
    found = physics_of(writable(verdict.extended or verdict.causes), known.found)
    return replace(known, found=found, differs_everywhere=len(clear & REPLAYED) >= MANY_EFFECTS)


def _may_be_absent(cause: Cause) -> bool:
    low, high = cause.interval_90
    return low <= PARAMETERS[f"{cause.effect}.{cause.parameter}"].absent <= high


def _shares(asked: list[Subject], progress: Progress) -> list[Progress]:
    """Of the time: what comes first takes nearly all of it."""
    first = 1.0 if len(asked) == 1 else 0.8
    begins = [0.0, *(first + (1.0 - first) * i / max(len(asked) - 1, 1) for i in range(len(asked)))]
    return [part(progress, begin, end) for begin, end in pairwise(begins)]


def _extended(verdict: Verdict, material: Material, out: Path) -> list[Path]:
    file = material.study_file
    if file is None:
        return write_models(verdict, material.title, material.files, out, model=None)
    stated = [cause for key, value in file.nominal.items() for cause in stated_causes(key, value, file)]
    return write_models(verdict, material.title, material.files, out, model=file.model, stated=stated, on_board=file.on_board)


def stated_causes(key: str, value: NominalValue, file: StudyFile) -> list[Cause]:
    """A value of a study file as causes, one for each place, added to what the model itself says of its joints."""
    parameter = PARAMETERS[key]
    if isinstance(value, Mapping):
        places = value
    elif parameter.scope is Scope.JOINT:
        places = {joint.name: value for joint in file.joints}
    elif parameter.scope is Scope.VECTOR:
        places = dict(zip("xyz", np.broadcast_to(np.asarray(value, dtype=float), 3), strict=True))
    else:
        places = {"platform": value}
    own = Plant(file.compile_model(), tuple(places)).own_values if parameter.scope is Scope.JOINT else {}
    found = np.array([float(each) for each in places.values()]) + own.get(key, 0.0)  # pyrefly: ignore[bad-argument-type]
    effect = key.partition(".")[0]
    return [
        Cause(effect, parameter.name, where, float(each), parameter.unit, (float(each), float(each)))
        for where, each in zip(places, found, strict=True)
    ]


def _success(question: Question | None, models: list[Path], rng: np.random.Generator, progress: Progress) -> Sections:
    """What the extended model gains in a policy's success, where trials of one were given."""
    if question is None:
        return {}
    toml = next((load_extended_model(file) for file in models if file.suffix == ".toml"), None)
    extended = Physics.nominal() if toml is None else toml.physics
    return {"success": success_of(question, extended, rng, progress).document()}


def _question(logs: FarmLogs | None, trials: Trials | None) -> Question | None:
    if trials is None:
        return None
    if logs is None:
        raise RecordingError("success can only be predicted for a robot of the farm: give a folder of its logs")
    return read_question(trials, logs.robot)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"cannot make the folder {out} ({error.strerror}); name another with --out") from error
    if not os.access(out, os.W_OK):
        raise RecordingError(f"nothing can be written to the folder {out}; name another with --out")


def _document(material: Material, verdict: Verdict, sections: Mapping[str, Any], out: Path) -> dict[str, Any]:
    data = provenance_of(material.title, verdict.verdict, material.files).data
    parts = "episodes" if len(material.recordings) >= 5 else "stretches of 0.8 s"
    is_unseen = verdict.held_out is None or verdict.held_out.is_unseen
    used_for = f"fit and held out by {parts}" if is_unseen else "fit"
    return {
        "format": 1,
        "title": material.title,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "robot": material.robot,
        "model": None if material.study_file is None else os.path.relpath(material.study_file.model, out),
        "provenance": {"code": version("trifarm"), "data": [{"file": d.file, "sha256": d.sha256} for d in data]},
        "verdict": verdict.document(),
        "recordings": [
            {
                "name": r.name,
                "duration_s": r.duration_s,
                "samples": len(r.time_s),
                "regime": r.regime,
                "used_for": used_for,
            }
            for r in material.recordings
        ],
        **sections,
    }
