"""A double pendulum whose torques are what MuJoCo's inverse dynamics needs, with noise: the truth is known exactly."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.reality_gap.recording import JointSignals, Recording

MODEL = Path(__file__).resolve().parents[4] / "docs" / "studies" / "double-pendulum" / "model.xml"
NAMES = ("joint1", "joint2")
STEP_S = 0.002
ENCODER_RAD, SENSOR_NM = 5e-5, 0.005
STUDY = """
model = "model.xml"
time = "time"
[[recording]]
file = "*.csv"
[joints.joint1]
position = "q1"
measured_torque = "t1"
[joints.joint2]
position = "q2"
measured_torque = "t2"
"""


def arm() -> mujoco.MjModel:
    """The nominal model, as it is in the example."""
    return mujoco.MjModel.from_xml_path(str(MODEL))


def motion(
    seed: int, seconds: float, friction_nm: Sequence[float] = (0.0, 0.0), damping_nm_s_rad: Sequence[float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Positions, rad, and measured torques, N m, each of shape (s, 2), both with noise."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, seconds, STEP_S)
    frequency_hz, phase, amplitude = (
        rng.uniform(0.2, 1.5, (2, 6, 1)),
        rng.uniform(0.0, 2 * np.pi, (2, 6, 1)),
        rng.normal(size=(2, 6, 1)),
    )
    position = 0.33 * np.sum(amplitude * np.sin(2 * np.pi * frequency_hz * time_s + phase), axis=1).T
    velocity = np.gradient(position, STEP_S, axis=0)
    acceleration = np.gradient(velocity, STEP_S, axis=0)
    model, torque = arm(), np.empty_like(position)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    for row in range(len(time_s)):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[row], velocity[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        torque[row] = data.qfrc_inverse
    torque += np.array(friction_nm) * np.tanh(velocity / 0.01) + np.array(damping_nm_s_rad) * velocity
    noise = rng.normal(size=(2, *position.shape))
    return position + ENCODER_RAD * noise[0], torque + SENSOR_NM * noise[1]


def recorded(position: np.ndarray, torque: np.ndarray, name: str = "made", **channels) -> Recording:
    """As a file of anybody's arm would give it."""
    joints = JointSignals(NAMES, position, measured_torque_nm=torque, **channels)
    return Recording(name, "made.csv", STEP_S, STEP_S * np.arange(len(position)), joints)


def write_csv(path: Path, position: np.ndarray, torque: np.ndarray) -> None:
    """A file with the columns that ``STUDY`` names; NaN is an empty cell."""
    rows = np.column_stack([STEP_S * np.arange(len(position)), position, torque])
    lines = [",".join("" if np.isnan(cell) else repr(float(cell)) for cell in row) for row in rows]
    path.write_text("\n".join(["time,q1,q2,t1,t2", *lines]) + "\n")
