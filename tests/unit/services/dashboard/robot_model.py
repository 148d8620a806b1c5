"""The robot that ``watch.js`` draws, made of the scene of a log; ``python -m`` this module from the root to write it."""

import json
import tempfile
from pathlib import Path

import numpy as np

from api_schemas.physics import ObjectName
from robot_farm.trial import measured_channels
from services.dashboard.pages import FOLDER
from services.dashboard.reduction import reduce
from sim_backend.trifinger import constants as c
from sim_backend.trifinger import viewer_scene
from sim_backend.trifinger.objects import shape_of
from trial_logs import trial_log
from trial_logs.trial_log import TrialLogWriter

KEPT = FOLDER / "static" / "trifinger.json"
DIGITS = 6


def scene(folder: Path, name: str) -> dict:
    """The header of a replay whose log holds the scene alone."""
    path = folder / f"{name}.mcap"
    with TrialLogWriter(path, measured_channels()) as writer:
        writer.message(trial_log.MEASURED_TRANSFORMS, 0, viewer_scene.fixed_transforms())
        writer.message(trial_log.MEASURED_SCENE, 0, viewer_scene.measured_scene(None, None, None, shape_of(name, 1.0)))
    return reduce(path, None)[0]


def made() -> dict:
    """The model: what never moves, the joints with their axes, what is drawn, and each object at its usual size."""
    with tempfile.TemporaryDirectory() as folder:
        scenes = {name.value: scene(Path(folder), name.value) for name in ObjectName}
    first = scenes["cube"]
    joints = [
        {"parent": parent, "child": child, "origin_m": list(c.LINKS[at % 3].origin_m), "axis": list(c.LINKS[at % 3].joint_axis)}
        for at, (parent, child) in enumerate(viewer_scene.MEASURED_FRAMES[:9])
    ]
    model = {
        "fixed": first["fixed"],
        "joints": joints,
        "entities": [each for each in first["entities"] if each["id"] != viewer_scene.TRACKED_CUBE],
        "objects": {
            name: [each for each in header["entities"] if each["id"] == viewer_scene.TRACKED_CUBE]
            for name, header in scenes.items()
        },
        "goal_width_m": c.CUBE_WIDTH_M,
        "tip_radius_m": c.TIP_RADIUS_M,
    }
    return json.loads(json.dumps(model, default=np.ndarray.tolist), parse_float=lambda text: round(float(text), DIGITS))


if __name__ == "__main__":
    KEPT.write_text(json.dumps(made(), separators=(",", ":")) + "\n")
