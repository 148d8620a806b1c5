"""The form of the scene: it names itself, and changes with anything that moves a result."""

import mujoco
import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.trifinger import form, scene
from sim_backend.trifinger.form import scene_form
from sim_backend.trifinger.scene import compile_scene

KNOWN = "0.2.1-de94df5d8d96"
REACH_STEP_RAD = 0.06
OVER_RAD = 0.3
"""As far as the effect ``joint_limits`` moves the ends of a joint's range."""


def test_a_scene_that_changed_has_a_version_of_its_own():
    assert scene_form() == KNOWN, "the scene, its solver or its step changed: raise VERSION, then note the new form here"


@pytest.mark.parametrize("changed", [{"CUBE_MASS_KG": 0.095}, {"PHYSICS_STEP_S": 0.002}, {"FINGER_FRICTION": 0.5}])
def test_what_moves_a_result_changes_the_form(monkeypatch, changed):
    for name, value in changed.items():
        monkeypatch.setattr(c, name, value)
    original = scene.build_scene
    monkeypatch.setattr(form, "build_scene", lambda: original(physics_step_s=c.PHYSICS_STEP_S, shape=_cube_of_now()))
    assert scene_form.__wrapped__() != scene_form()


def _cube_of_now():
    from dataclasses import replace

    from sim_backend.trifinger.objects import CUBE

    return replace(CUBE, mass_kg=c.CUBE_MASS_KG)


def test_what_only_shows_does_not_change_the_form(monkeypatch):
    monkeypatch.setattr(c, "CUBE_FACE_COLOURS", dict.fromkeys(c.CUBE_FACE_COLOURS, (0.0, 0.0, 0.0)))
    monkeypatch.setattr(c, "CAMERAS", c.CAMERAS[:1])
    assert scene_form.__wrapped__() == scene_form()


def test_middle_links_stay_clear_of_table_and_wall():
    """Nothing looks for these contacts, so that they must be out of reach, even past the ends of the joints' range."""
    model = compile_scene()
    data, rows = mujoco.MjData(model), []
    capsule = model.geom("finger0_middle").id
    arena = [i for i in range(model.ngeom) if model.geom_contype[i] == scene.ARENA_BITS]
    assert len(arena) == 1 + 2 * c.WALL_SEGMENTS
    lower, upper = c.SOFT_LIMIT_LOWER_RAD[:2] - OVER_RAD, c.SOFT_LIMIT_UPPER_RAD[:2] + OVER_RAD
    for first in np.arange(lower[0], upper[0], REACH_STEP_RAD):
        for second in np.arange(lower[1], upper[1], REACH_STEP_RAD):
            data.qpos[:2] = first, second
            mujoco.mj_kinematics(model, data)
            rows.append(min(mujoco.mj_geomDistance(model, data, capsule, each, 1.0, None) for each in arena))
    assert min(rows) > 0.05
