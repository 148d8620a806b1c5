"""Tosses simulated with hidden values, seen by a tracker with noise and smoothing; apart from the code that studies them."""

import mujoco
import numpy as np

from sim_backend.reality_gap.recording import ObjectSignals, Recording

_RATE_HZ, _STEP_S, _SAMPLES = 150.0, 1.0 / 1500.0, 110
_HALF_M = (0.05, 0.05, 0.05)


def toss_spec(friction=0.3, half_m=_HALF_M, solref=(0.02, 1.0), gravity=(0.0, 0.0, -9.81), mass_kg=0.4) -> mujoco.MjSpec:
    """A box over a plane, with the cone and ratio of the published study."""
    return mujoco.MjSpec.from_string(f"""
        <mujoco><option cone="elliptic" impratio="10" timestep="{_STEP_S}" gravity="{_row(gravity)}"/><worldbody>
        <geom name="floor" type="plane" size="3 3 0.1" friction="{friction} 0.005 0.0001" solref="{_row(solref)}"/>
        <body name="thing" pos="0 0 0.3"><freejoint/><geom name="thing" type="box" size="{_row(half_m)}" mass="{mass_kg}"
        friction="{friction} 0.005 0.0001" solref="{_row(solref)}"/></body></worldbody></mujoco>""")


def tosses(spec: mujoco.MjSpec, count: int, seed: int, scale=1.0, noise_m=3e-4, noise_rad=4e-3) -> list[Recording]:
    """Recordings of random tosses; measured positions are ``scale`` times the true ones."""
    rng, model = np.random.default_rng(seed), spec.copy().compile()
    return [_recording(model, f"toss {number}", rng, scale, noise_m, noise_rad) for number in range(count)]


def _recording(model, name, rng, scale, noise_m, noise_rad) -> Recording:
    data = mujoco.MjData(model)
    data.qpos[:3] = [*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.14, 0.2)]
    quat = rng.standard_normal(4)
    data.qpos[3:7] = quat / np.linalg.norm(quat)
    data.qvel[:3], data.qvel[3:] = rng.normal(0.0, [0.7, 0.7, 0.3]), rng.normal(0.0, 3.0, 3)
    poses = np.empty((_SAMPLES, 7))
    for sample in range(_SAMPLES):
        poses[sample] = data.qpos
        mujoco.mj_step(model, data, nstep=round(1.0 / (_RATE_HZ * _STEP_S)))
    position = scale * poses[:, :3] + _smooth(noise_m * rng.standard_normal((_SAMPLES, 3)))
    turned = np.empty((_SAMPLES, 4))
    for sample, turn in enumerate(_smooth(noise_rad * rng.standard_normal((_SAMPLES, 3)))):
        turned[sample] = poses[sample, 3:]
        mujoco.mju_quatIntegrate(turned[sample], turn, 1.0)
    time_s = np.arange(_SAMPLES) / _RATE_HZ
    return Recording(
        name, "simulated", 1.0 / _RATE_HZ, time_s, None, (ObjectSignals("thing", "thing", time_s, position, turned),)
    )


def _smooth(noise: np.ndarray) -> np.ndarray:
    """Mean of three neighbours, as a tracker that smooths has it."""
    return (np.roll(noise, 1, 0) + noise + np.roll(noise, -1, 0)) / 3.0


def _row(values) -> str:
    return " ".join(str(float(value)) for value in values)
