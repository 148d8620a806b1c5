"""A study: from measured data to a verdict, an extended model, what it gained, and a report.

The process is :func:`run_study`; each step is a module of its own.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.extended.files import write_models
from sim_backend.reality_gap.extended.model import load_extended_model, provenance_of
from sim_backend.reality_gap.farm_logs import FarmLogs, find_logs, read_farm_logs
from sim_backend.reality_gap.foreign.episodes import read_recordings
from sim_backend.reality_gap.foreign.study_file import StudyFile, load_study_file
from sim_backend.reality_gap.joints.calibrating import METHODS, calibrate
from sim_backend.reality_gap.joints.gain import held_out, held_out_of_hits
from sim_backend.reality_gap.joints.judged import not_judged
from sim_backend.reality_gap.joints.motor_law import LIMIT
from sim_backend.reality_gap.joints.sections import joint_sections
from sim_backend.reality_gap.joints.study import JointStudy, ShowsNothingError, study_joints
from sim_backend.reality_gap.joints.verdict import judge
from sim_backend.reality_gap.knowledge.robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.recording import Recording, RecordingError
from sim_backend.reality_gap.report.report import write_html
from sim_backend.reality_gap.success.prediction import Question, Trials, read_question, success_of
from sim_backend.reality_gap.tosses.study import makes_worse, study_object
from sim_backend.reality_gap.verdict import Verdict, VerdictKind, joined
from sim_backend.trifinger.scene import compile_scene

Progress = Callable[[str, float], None]
CUBE_EXCITATION = "slide_cube"


@dataclass(frozen=True)
class Material:
    """What a study works on: recordings, the model they are compared with, and where both come from.

    ``trials`` are logs of the farm beside those of excitations, which no joint is judged from. ``robot`` is its
    name, if it is one of the farm's. Without a ``study_file`` the recordings are a TriFinger's.
    """

    title: str
    recordings: tuple[Recording, ...]
    files: tuple[Path, ...]
    study_file: StudyFile | None
    robot: str | None = None
    trials: tuple[Path, ...] = ()


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
        RecordingError: data that cannot be used; the message says why.
    """
    rng = np.random.default_rng(seed)
    logs = find_logs(source) if source.is_dir() else None
    question = _question(logs, trials)
    _make_folder(out)  # now, so that no result of long work is lost
    material = recordings_of(logs or source, data_root, _part(progress, 0.0, 0.1))  # 1 recording
    named = 0.95 if question is None else 0.6
    # 2 replay, 3 residual, 4 fit, 5 verdict, 7 gain
    verdict, sections = verdict_of(material, method, rng, _part(progress, 0.1, named))
    foreign = None if material.study_file is None else material.study_file.model
    files = write_models(verdict, material.title, material.files, out, model=foreign)  # 6 extended model
    if question is not None:
        toml = next((load_extended_model(file) for file in files if file.suffix == ".toml"), None)
        extended = Physics.nominal() if toml is None else toml.physics
        sections = {**sections, "success": success_of(question, extended, rng, _part(progress, named, 0.95)).document()}
    document = _document(material, verdict, sections, out)
    (out / "study.json").write_text(json.dumps(document, indent=1))
    progress("writing the report", 0.95)
    write_html(document, out / "report.html")  # 8 report
    return StudyResult(verdict, document, (out / "study.json", out / "report.html", *files))


def _part(progress: Progress, begin: float, end: float) -> Progress:
    """Progress of a part that takes its own share, 0 to 1, of the range: there is one counter."""
    return lambda what, share: progress(what, begin + (end - begin) * share)


def recordings_of(source: FarmLogs | Path, data_root: Path | None, progress: Progress) -> Material:
    """Step 1: the farm's logs, or anyone's data by a study.toml."""
    if isinstance(source, FarmLogs):
        recordings = read_farm_logs(source.judged, progress)
        title = f"Logs in {source.judged[0].parent.resolve().name}"
        return Material(title, tuple(recordings), source.judged, None, source.robot, source.trials)
    study_file = load_study_file(source, data_root)
    recordings = read_recordings(study_file, lambda what: progress(f"reading {what}", 0.0))
    files = (source, study_file.model, *dict.fromkeys(entry.file for entry in study_file.recordings))
    return Material(study_file.title, tuple(recordings), files, study_file)


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


def verdict_of(material: Material, method: str, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, dict[str, Any]]:
    """Steps 2 to 5 and 7 for joints, and for objects that were seen."""
    of_joints = tuple(r for r in material.recordings if r.joints is not None and r.regime != CUBE_EXCITATION)
    of_cube = tuple(r for r in material.recordings if r.regime == CUBE_EXCITATION)
    of_objects = tuple(r for r in material.recordings if r.joints is None and r.objects)
    found: list[tuple[Verdict, dict[str, Any]]] = []
    after = 0.8 if of_cube or of_objects else 1.0
    if of_joints:
        found.append(_joint_verdict(material, of_joints, method, rng, _part(progress, 0.0, after)))
    if of_cube and material.study_file is None:
        from sim_backend.reality_gap.cube.study import study_cube  # with its replay, which most studies do without

        study = study_cube(of_cube, rng, lambda what: progress(what, after))
        found.append((study.verdict, {}))
    if of_objects and material.study_file is not None:
        found.append(_object_verdict(material.study_file, of_objects, rng, _part(progress, after if of_joints else 0.0, 1.0)))
    if not found:
        raise RecordingError("the recordings have neither joints nor objects that could be compared with a model")
    verdict, sections = found[0] if len(found) == 1 else _together(found)
    if material.trials:
        unread = f"anything from logs of trials ({len(material.trials)}): fingers may touch the cube and the table there"
        verdict = replace(verdict, cannot_tell=(*verdict.cannot_tell, unread))
    return verdict, sections


def known_of(material: Material, recordings: Sequence[Recording]) -> Robot:
    """What is known of the robot: whoever describes data by a study file has another robot than the farm's."""
    return KnownTriFinger.seen_in(recordings) if material.study_file is None else UnknownRobot()


def _joint_verdict(
    material: Material, recordings: Sequence[Recording], method: str, rng: np.random.Generator, progress: Progress
) -> tuple[Verdict, dict[str, Any]]:
    model = compile_scene() if material.study_file is None else material.study_file.compile_model()
    try:
        study = study_joints(
            model,
            recordings,
            progress,
            robot=known_of(material, recordings),
            nominal=_nominal(material, recordings),
            gate=None if method == METHODS[0] else np.inf,
        )
    except ShowsNothingError as error:
        return not_identifiable(error, known_of(material, recordings)), {}
    if method != METHODS[0]:
        return _calibrated(study, method, rng), {}
    judged = judge(study)
    when = "while they move and no rotor hits" if study.rattling else "while they move"
    verdict = replace(
        judged.verdict,
        cannot_tell=(*judged.verdict.cannot_tell, *not_judged(study.problem.episodes, study.problem.names)),
        held_out=held_out(study.problem, study.fit.final, study.start, rng, when=when),
        held_out_there=tuple(held_out_of_hits(each.errors, study.problem.names[each.joint], rng) for each in study.rattling),
    )
    progress("drawing what is left", 0.9)
    return verdict, joint_sections(study, judged.patterns, rng)


def _calibrated(study: JointStudy, method: str, rng: np.random.Generator) -> Verdict:
    """All numbers at once, by a method that names nothing."""
    result = calibrate(study.problem, study.start, method, rng)
    look = study.problem.look(result.state, ())
    return Verdict(
        verdict=VerdictKind.NAMED if result.causes else VerdictKind.NOTHING_WRONG,
        summary=f"Calibrated {len(result.causes)} numbers by {method}; reproducing data makes none of them a cause.",
        causes=result.causes,
        held_out=held_out(study.problem, look, study.start, rng),
        cannot_tell=("which of these numbers is a cause: this method changes whatever helps",),
    )


def not_identifiable(error: ShowsNothingError, robot: Robot) -> Verdict:
    """Nothing about joints can be told."""
    what = (
        "run 'trifarm identify --excitation standard' on the robot"
        if isinstance(robot, KnownTriFinger)
        else "move every joint slowly and fast over its range"
    )
    return Verdict(
        verdict=VerdictKind.NOT_IDENTIFIABLE,
        summary=f"These data cannot tell anything: {error}.",
        cannot_tell=(f"every effect of joints: {error.because}",),
        record_next=(f"{what}; 'trifarm gap excite' says how",),
    )


def _nominal(material: Material, recordings: Sequence[Recording]) -> Mapping[str, np.ndarray]:
    """Values to start from that a study file states for joints' effects; NaN for the limits of motors that it does not name."""
    if material.study_file is None:
        return {}
    names, found = recordings[0].joints.names if recordings[0].joints is not None else (), {}
    for key, value in material.study_file.nominal.items():
        parameter = PARAMETERS[key]
        if parameter.scope is Scope.JOINT:
            by_joint = value if isinstance(value, Mapping) else dict.fromkeys(names, value)
            absent = np.nan if key == LIMIT else parameter.absent  # a TriFinger's limit is no other robot's
            found[key] = np.array([float(by_joint.get(name, absent)) for name in names])  # pyright: ignore[reportArgumentType]
        else:
            found[key] = np.atleast_1d(np.asarray(value, dtype=float))
    return found


def _object_verdict(
    study_file: StudyFile, recordings: Sequence[Recording], rng: np.random.Generator, progress: Progress
) -> tuple[Verdict, dict[str, Any]]:
    nominal = {key: float(value) for key, value in study_file.nominal.items() if isinstance(value, int | float)}
    study = study_object(mujoco.MjSpec.from_file(str(study_file.model)), recordings, nominal, rng, progress)
    named = ", ".join(dict.fromkeys(cause.effect.replace("_", " ") for cause in study.causes))
    summary = {
        VerdictKind.NAMED: f"The data disagree with the model because of {named}.",
        VerdictKind.CONFUSABLE: f"The data cannot tell apart: {named}.",
        VerdictKind.UNEXPLAINED: "The data disagree with the model far beyond the noise; no cause of the catalogue explains it.",
    }.get(study.kind, "The data agree with the model as well as they can tell.")
    if study.kind is VerdictKind.UNEXPLAINED and study.confirmation is not None and makes_worse(study.confirmation.held_out):
        summary = "What explains the tosses that were studied puts others further off: no cause of the catalogue does."
    verdict = Verdict(
        verdict=study.kind,
        summary=summary,
        causes=study.causes,
        held_out=study.confirmation.held_out if study.confirmation is not None else None,
        null_p=study.null_p,
        runner_up=study.runner_up,
        rejected=tuple(one.rival for one in study.lost if not one.confusable),
        cannot_tell=study.cannot_tell,
        record_next=study.record_next,
    )
    return verdict, dict(study.sections)


def _together(found: Sequence[tuple[Verdict, dict[str, Any]]]) -> tuple[Verdict, dict[str, Any]]:
    """The verdicts on joints and on objects as one, and the sections of both."""
    sections: dict[str, Any] = {}
    for _, own in reversed(found):
        sections |= own
    return joined([verdict for verdict, _ in found]), sections


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
