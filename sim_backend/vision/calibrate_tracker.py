"""``trifarm calibrate-tracker``: measures the tracker on images, and gives the effects of the formula their ranges from it.

Rows of errors are kept as they come, and a file of them is gone on with. Out come a file of ranges that extends ``real``, a
table of the errors of images, of the formula as ``real`` and as found, in the same scenes, and a figure where one is asked for.
Exit codes: 0 written, 1 this machine cannot render, 2 the rows cannot be used, 130 interrupted.
"""

import argparse
import datetime
import json
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.driver.detection import Values, values_of
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.refusal import refused
from sim_backend.trifinger.objects import CUBE
from sim_backend.vision.cameras import CamerasMissingError
from sim_backend.vision.image_tracker import SURE
from sim_backend.vision.scenes import Scene
from sim_backend.vision.tracker_errors import FIRST_ROBOT, errors_of_robot, formula_error
from sim_backend.vision.tracker_ranges import HIDDEN_BOUNDS, matched_occlusion, preset_text, ranges_of

OK, CANNOT, USAGE, INTERRUPTED = 0, 1, 2, 130
ROBOTS, SCENES = 24, 8
ABOUT = "The robots of `real`, and the formula's errors as measured of the tracker on images."
KINDS = ("images", "real", "found")
FASTEST = (0.0, 0.1, 0.25, 0.51)
"""Bounds of the speeds that are told apart, m/s."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    options = _parser().parse_args(arguments)
    try:
        _measure(options.rows, options.robots, options.scenes)
        rows = [json.loads(line) for line in options.rows.read_text().splitlines()]
        found = ranges_of(rows, matched_occlusion(rows, _values))
    except KeyboardInterrupt:
        print("stopped; called again with the same rows it goes on", file=sys.stderr)
        return INTERRUPTED
    except CamerasMissingError as error:
        return refused(error, options.json, CANNOT)
    except (ValueError, KeyError, OSError) as error:
        return refused(f"{options.rows}: {error}", options.json, USAGE)
    options.out.write_text(preset_text(found, ABOUT, datetime.datetime.now(datetime.UTC).date()))
    errors = by_kind(rows, options.out)
    said = {"ranges": str(options.out), "rows": len(rows), "table": table(errors)}
    if options.figure is not None:
        draw(errors, options.figure)
        said["figure"] = str(options.figure)
    print(json.dumps(said) if options.json else f"{markdown(said['table'])}\n\n{options.out}: {len(found)} ranges")
    return OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm calibrate-tracker", description="Measure the tracker on images.")
    parser.add_argument("--rows", type=Path, default=Path("tracker-errors.jsonl"))
    parser.add_argument("--out", type=Path, default=Path("real-2.toml"))
    parser.add_argument("--robots", type=int, default=ROBOTS)
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", action="store_true")
    return parser


def _measure(path: Path, robots: int, scenes: int) -> None:
    """Rows of robots that the file does not have yet."""
    done = {json.loads(line)["robot"] for line in path.read_text().splitlines()} if path.exists() else set()
    for seed in range(FIRST_ROBOT, FIRST_ROBOT + robots):
        if seed not in done:
            rows = errors_of_robot(seed, scenes)
            with path.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)
            print(f"robot {seed}: {len(rows)} scenes", file=sys.stderr, flush=True)


def _values(strength: float, missed: float) -> Values:
    given = {"occlusion_by_fingers.strength": strength, "colour_segmentation.missed": missed}
    return values_of(Physics.of(1, given), CUBE.size_m)


def by_kind(rows: Sequence[dict[str, Any]], ranges: Path) -> list[dict[str, Any]]:
    """For each scene how far the images are off, the formula of that robot as `real`, and as the ranges that were found."""
    table, physics = load_ranges(ranges), dict[int, Physics]()
    told = []
    for row in rows:
        seed = row["robot"]
        if seed not in physics:
            physics[seed] = table.draw(np.random.default_rng(seed), 1)
        scene = Scene(*(np.array(row[name]) for name in ("joint_position_rad", "position_m", "quat_wxyz")))
        kinds = {"images": row["images"]["at_rest"], "real": row["formula"]}
        kinds["found"] = formula_error(physics[seed], seed, row["scene"], scene)
        told.append({key: row[key] for key in ("hidden", "speed_m_s", "from_middle_m", "lamp")} | kinds)
        told[-1]["moved"] = row["images"]["moved"]
    return told


def table(errors: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians and 95th percentiles of what counts as seen, by kind; and of images by what may matter."""
    hidden, speed = (np.array([each[key] for each in errors]) for key in ("hidden", "speed_m_s"))
    told = [_summary(f"{kind}, all", [each[kind] for each in errors]) for kind in KINDS]
    for low, high in pairwise(HIDDEN_BOUNDS):
        part = np.flatnonzero((low <= hidden) & (hidden < high))
        about = f"hidden {low:.0%} to {min(high, 1.0):.0%}"
        told += [_summary(f"{kind}, {about}", [errors[int(k)][kind] for k in part]) for kind in KINDS]
    for low, high in pairwise(FASTEST):
        part = np.flatnonzero((low <= speed) & (speed < high))
        told.append(
            _summary(f"images, after moving at {low:g} to {min(high, 0.5):g} m/s", [errors[int(k)]["moved"] for k in part])
        )
    for key, about in (("from_middle_m", "m from the middle"), ("lamp", "of the lamp's strength")):
        values = np.array([each[key] for each in errors])
        middle = float(np.median(values))
        for side, part in (("below", values < middle), ("from", values >= middle)):
            seen = [errors[int(k)]["images"] for k in np.flatnonzero(part)]
            told.append(_summary(f"images, {side} {middle:.2g} {about}", seen))
    return told


def _summary(about: str, found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    seen = [each for each in found if each["confidence"] >= SURE]
    told: dict[str, Any] = {"what": about, "scenes": len(found), "not_seen": round(1 - len(seen) / max(len(found), 1), 3)}
    if seen:
        apart = {"mm": [np.linalg.norm(each["position_mm"]) for each in seen]}
        apart["deg"] = [np.rad2deg(np.linalg.norm(each["rotation_rad"])) for each in seen]
        for unit, values in apart.items():
            told |= {f"{unit}_50": round(float(np.median(values)), 2), f"{unit}_95": round(float(np.quantile(values, 0.95)), 2)}
    return told


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """The table as a page has it."""
    lines = ["| errors | scenes | not seen | median | 95th percentile |", "|---|---|---|---|---|"]
    for row in rows:
        ends = [f"{row[f'mm_{at}']} mm, {row[f'deg_{at}']}°" if f"mm_{at}" in row else "–" for at in ("50", "95")]
        lines.append(f"| {row['what']} | {row['scenes']} | {row['not_seen']:.1%} | {ends[0]} | {ends[1]} |")
    return "\n".join(lines)


def draw(errors: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the share of scenes whose error is at most so large, of each kind, by position and by orientation."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, unit, factor in zip(figure.subplots(1, 2), ("position_mm", "rotation_rad"), (1.0, np.rad2deg(1.0)), strict=True):
        for kind, style in zip(KINDS, ("-", ":", "--"), strict=True):
            seen = [each[kind] for each in errors if each[kind]["confidence"] >= SURE]
            off = np.sort([factor * np.linalg.norm(each[unit]) for each in seen])
            name = {"images": "images", "real": "formula, real", "found": "formula, as found"}[kind]
            axes.plot(off, (np.arange(len(off)) + 1) / max(len(off), 1), style, label=name)
        axes.set(xlim=(0, 10), ylim=(0, 1), xlabel="error, mm" if factor == 1.0 else "error, degrees", ylabel="share of scenes")
        axes.legend(frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    sys.exit(main())
