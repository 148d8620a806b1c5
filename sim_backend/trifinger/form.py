"""The form of the scene: which arena, robot, solver and step a result was simulated with."""

import functools
import hashlib

import mujoco

from sim_backend.trifinger.scene import build_scene, discard_what_shows

VERSION = "0.2.1"
"""Raised when the scene, its solver, its step or a law of control changes; a test holds its digest."""


@functools.cache
def scene_form() -> str:
    """The version and a digest of the scene, such as "0.2.0-0123456789ab".

    The digest is of the nominal scene as MJCF, with solver and step but without what only shows, and of MuJoCo's version.
    """
    spec = discard_what_shows(build_scene())
    spec.compile()
    content = f"MuJoCo {mujoco.mj_versionString()}\n{spec.to_xml()}"
    return f"{VERSION}-{hashlib.sha256(content.encode()).hexdigest()[:12]}"
