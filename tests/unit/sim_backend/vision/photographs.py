"""Photographs of a real TriFinger, where they are at hand (``shared/data/trifinger_photos``; read its SOURCE.md)."""

from pathlib import Path

import pytest

from sim_backend.vision.calibration import Calibration, calibration_of

NAMES = ("60", "180", "300")
WHERE = Path(__file__).parents[5] / "shared" / "data" / "trifinger_photos"


def folder() -> Path:
    """Where they lie; skips the test without them."""
    if not WHERE.is_dir():
        pytest.skip(f"the photographs are absent: no folder {WHERE}")
    return WHERE


def photographed_calibrations() -> tuple[Calibration, ...]:
    """The three cameras of the robot in the photographs."""
    yaml = pytest.importorskip("yaml")
    files = [folder() / "pose_detection" / "cube_v2" / f"camera_calib_{name}.yml" for name in NAMES]
    return tuple(calibration_of(yaml.safe_load(file.read_text())) for file in files)
