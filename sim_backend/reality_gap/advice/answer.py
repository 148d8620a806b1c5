"""What to record next: ``python -m sim_backend.reality_gap excite [STUDY_OR_REPORT] [--robot NAME] [--csv FILE] [--json]``.

After a study it says which excitations settle its verdict, without one what tells most causes apart; with the command that has a
robot of the farm run them, and in numbers or as a table of position targets for robots elsewhere.
Exit codes: 0 said; 2 usage, a study that cannot be read, or a table that cannot be written.
"""

import argparse
import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.reality_gap.advice.advice import Advice, Advised, advice_after, first_advice
from sim_backend.reality_gap.advice.course import NoFixedCourseError, targets, targets_for, write_csv
from sim_backend.refusal import refused

FOLDER = "logs-next"
_PLACEHOLDER, _ANY = "ROBOT", "any"
_EMBEDDED = re.compile(r'<script type="application/json" id="study">(.*?)</script>', re.DOTALL)


class StudyUnreadableError(ValueError):
    """What was given is no study."""


@dataclass(frozen=True)
class EarlierStudy:
    """An earlier study: its document, and the file it was read from."""

    file: Path
    document: Mapping[str, Any]

    @property
    def model(self) -> Path | None:
        """The MJCF that it compared data with; None of a TriFinger of a farm."""
        return self.file.parent / str(self.document["model"]) if self.document.get("model") else None


def read_study(path: Path) -> EarlierStudy:
    """A study from its study.json, its report.html, or the folder of both.

    Raises:
        StudyUnreadableError: the message says what is missing.
    """
    file = path / "study.json" if path.is_dir() else path
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StudyUnreadableError(
            f"{file} cannot be read ({error}); give a study's study.json, report.html or folder"
        ) from error
    found = _EMBEDDED.search(text) if file.suffix == ".html" else None
    try:
        document = json.loads(found[1] if found else text)
    except json.JSONDecodeError as error:
        raise StudyUnreadableError(f"{file} is no study of 'trifarm gap study': {error}") from error
    if not isinstance(document, dict) or not isinstance(document.get("verdict"), dict):
        raise StudyUnreadableError(f"{file} is no study of 'trifarm gap study': it has no verdict")
    return EarlierStudy(file, document)


def advice_for(study: EarlierStudy | None) -> Advice:
    """What to record after a study, or first of all.

    Raises:
        StudyUnreadableError: a verdict that cannot be understood.
    """
    if study is None:
        return first_advice()
    recordings = study.document.get("recordings") or ()
    recorded = [str(one["regime"]) for one in recordings if isinstance(one, Mapping) and one.get("regime")]
    try:
        return advice_after(study.document["verdict"], recorded)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise StudyUnreadableError(f"{study.file} is no study of 'trifarm gap study': {error}") from error


def identify_command(advice: Advice, robot: str) -> str:
    """What has a robot of the farm run all of it."""
    named = " ".join(f"--excitation {advised.name}" for advised in advice.excitations)
    return f"trifarm identify --robot {robot} {named} --repeats {advice.repeats} --to {FOLDER}"


def targets_command(study: EarlierStudy, advice: Advice) -> str:
    """What writes position targets for a robot that is none of the farm's, one table an excitation; empty where none can be."""
    fixed = [advised.name for advised in advice.excitations if advised.name != "slide_cube"]
    one = f"trifarm gap excite {shlex.quote(str(study.file))}"
    return " && ".join(f"{one} --excitation {name} --csv next-{name}.csv" for name in fixed)


def document(study: EarlierStudy | None, advice: Advice, robot: str, csv: Path | None) -> dict[str, Any]:
    """All of it as plain values."""
    verdict = None if study is None else study.document["verdict"]
    return {
        "after": None if study is None or verdict is None else {"file": str(study.file), "verdict": verdict["verdict"]},
        "why": advice.why,
        "excitations": [_excitation(advised) for advised in advice.excitations],
        "repeats": advice.repeats,
        "command": identify_command(advice, robot) if study is None or study.model is None else targets_command(study, advice),
        "model": None if study is None or study.model is None else str(study.model),
        "by_hand": list(advice.by_hand),
        "said_by_study": list(advice.said_by_study),
        "csv": None if csv is None else str(csv),
    }


def _excitation(advised: Advised) -> dict[str, Any]:
    kept = EXCITATIONS[advised.name]
    separates = [{"effects": [first, second], "by": by} for first, second, by in advised.separates]
    return asdict(advised) | {"duration_s": kept.duration_s, "about": kept.about, "separates": separates, **_sizes(advised.name)}


def _sizes(name: str) -> dict[str, float | None]:
    """How far and how fast the joints go, for those who make the motion themselves; None where the cube decides."""
    try:
        table = targets(name, np.random.default_rng(0))
    except NoFixedCourseError:
        return {"amplitude_rad": None, "speed_rad_s": None, "push_nm": None}
    sizes = {"amplitude_rad": table.amplitude_rad, "speed_rad_s": table.speed_rad_s, "push_nm": table.push_nm}
    return {key: float(f"{value:.2g}") for key, value in sizes.items()}


def sentences(said: Mapping[str, Any]) -> list[str]:
    """The document for people."""
    lines = [said["why"]]
    for number, one in enumerate(said["excitations"], 1):
        lines += [
            "",
            f"{number}. {one['name']} ({one['duration_s']:.0f} s, {one['about']})",
            f"   {one['why']}",
            f"   {_elsewhere(one)}",
        ]
    if not said["model"]:
        lines += ["", "On a robot of the farm:", f"  {said['command']}"]
    elif said["command"]:
        lines += ["", "Position targets for your own robot, if it has joints:"]
        lines += [f"  {each}" for each in said["command"].split(" && ")]
    if _PLACEHOLDER in said["command"].split():
        lines.append(f"  where {_PLACEHOLDER} is the robot that the study is about")
    for heading, key in (("What no excitation gives:", "by_hand"), ("The study itself asked for:", "said_by_study")):
        if said[key]:
            lines += ["", heading, *(f"  - {item}" for item in said[key])]
    if said["csv"]:
        lines += ["", f"Position targets are in {said['csv']}."]
    return lines


def _elsewhere(one: Mapping[str, Any]) -> str:
    if one["amplitude_rad"] is None:
        return "elsewhere: push the object ten times or so by some centimetres at 0.1 to 0.5 m/s and let it slide out"
    pushed = f", torque pushes of up to {one['push_nm']:g} N m" if one["push_nm"] else ""
    return f"elsewhere: up to {one['amplitude_rad']:g} rad to either side and {one['speed_rad_s']:g} rad/s{pushed}"


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="trifarm gap excite", description="Say what to record next, and why.")
    parser.add_argument("study", nargs="?", type=Path, metavar="STUDY_OR_REPORT", help="study.json, report.html or their folder")
    parser.add_argument("--robot", metavar="ROBOT", help="the farm's robot, for the command to run")
    parser.add_argument(
        "--excitation", choices=list(EXCITATIONS), metavar="NAME", help="which one --csv writes (the first advised)"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write an excitation's position targets")
    parser.add_argument("--model", type=Path, metavar="MJCF", help="whose joints and ranges --csv is made for (the study's)")
    parser.add_argument("--seed", type=int, default=0, help="draws what --csv writes (%(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    if options.csv is None and (options.model is not None or options.excitation is not None):
        parser.error("--model and --excitation say what --csv writes; give --csv FILE, too")
    try:
        study = None if options.study is None else read_study(options.study)
        advice = advice_for(study)
        if options.csv is not None:
            _write(options, advice, options.model or (None if study is None else study.model))
    except (ValueError, OSError) as error:
        return refused(error, options.json)
    robot = options.robot or (_ANY if study is None else str(study.document.get("robot") or _PLACEHOLDER))
    said = document(study, advice, robot, options.csv)
    print(json.dumps(said) if options.json else "\n".join(sentences(said)))
    return 0


def _write(options: argparse.Namespace, advice: Advice, model: Path | None) -> None:
    fixed = [advised.name for advised in advice.excitations if advised.name != "slide_cube"]
    name = options.excitation or (fixed[0] if fixed else "slide_cube")
    rng = np.random.default_rng(options.seed)
    table = targets(name, rng) if model is None else targets_for(_model(model), name, rng)
    write_csv(table, options.csv)


def _model(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        raise ValueError(f"there is no model {path}; say with --model for whose joints the table is to be")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(f"{path} is no MJCF that MuJoCo loads: {error}") from error
