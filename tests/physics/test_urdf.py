"""Our model against the public URDF of the TriFinger Pro (robot_properties_fingers 2.0.2, BSD-3), fetched by pip."""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.scene import compile_scene

PACKAGE = "robot_properties_fingers"


@pytest.fixture(scope="module")
def urdf(tmp_path_factory) -> mujoco.MjModel:
    folder = tmp_path_factory.mktemp("urdf")
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(folder), f"{PACKAGE}==2.0.2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    if done.returncode:
        pytest.skip(f"{PACKAGE} could not be fetched: {done.stderr.strip()[-200:]}")
    text = next(Path(folder).rglob("trifingerpro.urdf")).read_text()
    return mujoco.MjModel.from_xml_string(text.replace(f"package://{PACKAGE}", str(folder / PACKAGE)))


def test_masses_inertias_gravity_and_coriolis_agree(urdf):
    ours, theirs = compile_scene(), urdf
    our_data, their_data = mujoco.MjData(ours), mujoco.MjData(theirs)
    rng = np.random.default_rng(0)
    for _ in range(20):
        position, velocity = rng.uniform(-1, 1, 9), rng.uniform(-3, 3, 9)
        our_data.qpos[:9] = their_data.qpos[:] = position
        our_data.qvel[:9] = their_data.qvel[:] = velocity
        mujoco.mj_forward(ours, our_data)
        mujoco.mj_forward(theirs, their_data)
        our_mass, their_mass = np.zeros((ours.nv, ours.nv)), np.zeros((9, 9))
        mujoco.mj_fullM(ours, our_data, our_mass)
        mujoco.mj_fullM(theirs, their_data, their_mass)
        np.testing.assert_allclose(our_mass[:9, :9], their_mass, atol=1e-6)
        np.testing.assert_allclose(our_data.qfrc_bias[:9], their_data.qfrc_bias, atol=1e-6)
    assert abs(theirs.body_mass.sum() + c.CUBE_MASS_KG - ours.body_mass.sum()) < 1e-6


def test_forward_kinematics_agrees(urdf):
    data = mujoco.MjData(urdf)
    offset = np.array(c.LINKS[3].origin_m)  # the URDF's fixed tip link is fused into the lower link
    for joints in np.random.default_rng(1).uniform(-1, 1, (20, 9)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(urdf, data)
        tips = []
        for number in (0, 120, 240):
            lower = data.body(f"finger_lower_link_{number}")
            tips.append(lower.xpos + lower.xmat.reshape(3, 3) @ offset)
        np.testing.assert_allclose(fingertip_position_world_m(joints), np.concatenate(tips), atol=1e-6)
