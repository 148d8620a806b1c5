"""Motions that a sensible experimenter asks for, and the two ways to ask: torques alone, or a controller that follows."""

from dataclasses import replace

import mujoco
import numpy as np

FADE_S = 1.0


def sines(rng, joints, top_hz):
    """A sum of sines for each joint, of size 1: a function of time, shape (joints,)."""
    count = int(rng.integers(3, 6))
    hz = np.exp(rng.uniform(np.log(0.1), np.log(top_hz), (count, joints)))
    size = hz**-0.5 * rng.uniform(0.5, 1.0, (count, joints))
    size /= size.sum(axis=0) * 0.8
    phase = rng.uniform(0, 2 * np.pi, (count, joints))
    return lambda t: (size * np.sin(2 * np.pi * hz * t + phase)).sum(axis=0)


def chirp(rng, joints, top_hz, seconds):
    """A chirp from slow to fast, with phases that differ between joints; smaller where faster."""
    low, phase = rng.uniform(0.1, 0.2), rng.uniform(0, 2 * np.pi, joints)
    rate = np.log(top_hz * 1.5 / low) / seconds

    def at(t):
        hz = low * np.exp(rate * t)
        return np.sin(2 * np.pi * (hz - low) / rate + phase) * (low / hz) ** 0.5

    return at


def ramps(rng, joints, seconds):
    """Slow triangles with a period of its own for each joint."""
    period, phase = rng.uniform(0.35, 0.8, joints) * max(seconds, 8.0), rng.uniform(0, 1, joints)
    return lambda t: 4 * np.abs((t / period + phase) % 1.0 - 0.5) - 1.0


def steps(rng, joints, seconds):
    """Smooth steps to drawn places, each joint at its own times."""
    dwell, move = rng.uniform(1.0, 2.5, joints), rng.uniform(0.25, 0.6)
    places = rng.uniform(-1, 1, (int(seconds / dwell.min()) + 3, joints))
    places[0] = 0.0
    each = np.arange(joints)

    def at(t):
        k = (t / dwell).astype(int)
        s = np.clip((t - k * dwell) / move, 0, 1)
        return places[k, each] + (places[k + 1, each] - places[k, each]) * s**3 * (10 - 15 * s + 6 * s * s)

    return at


def draw_shape(rng, kind, joints, seconds, top_hz):
    """The function of time of one kind of excitation."""
    if kind == "sines":
        return sines(rng, joints, top_hz)
    if kind == "chirp":
        return chirp(rng, joints, top_hz, seconds)
    return ramps(rng, joints, seconds) if kind == "ramps" else steps(rng, joints, seconds)


def faded(shape, seconds):
    """The same function that begins from nothing and ends there."""
    return lambda t: shape(t) * min(1.0, t / FADE_S) * max(0.0, min(1.0, (seconds - t) / FADE_S))


class OpenLoop:
    """Torques by time, whatever the arm does."""

    def __init__(self, shape, amplitude_nm):
        self.shape, self.amplitude = shape, amplitude_nm

    def __call__(self, t, q, v):
        return self.amplitude * self.shape(t), np.nan, np.nan


class Follower:
    """PD about a wanted motion, with gravity compensation from the declared arm.

    ``gain_factor`` is what the stiffness is multiplied with, unknown to the owner, shape (joints,).
    """

    def __init__(self, arm, shape, amplitude_rad, stiffness, damping, gain_factor):
        self.home, self.shape, self.amplitude = np.array(arm.home_rad), shape, amplitude_rad
        self.stiffness, self.damping, self.factor = stiffness, damping, gain_factor
        self.limit = np.array(arm.torque_limit_nm)
        self.model = mujoco.MjModel.from_xml_string(replace(arm, loose=None).mjcf())
        self.data = mujoco.MjData(self.model)

    def target(self, t):
        return self.home + self.amplitude * self.shape(t)

    def __call__(self, t, q, v):
        target, speed = self.target(t), (self.target(t + 0.0005) - self.target(t - 0.0005)) / 0.001
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)
        # at rest the bias is what gravity takes
        desired = self.data.qfrc_bias + self.damping * speed
        command = self.factor * self.stiffness * (target - q) - self.damping * v + desired
        return np.clip(command, -self.limit, self.limit), target, desired


def gains(arm, period_s):
    """Stiffness and damping that a careful owner sets: as fast as the rate allows, and never faster than 14 rad/s."""
    fast = min(14.0, 0.12 / period_s)
    inertia = arm.inertia()
    damping = np.array([link.damping_nm_s_rad for link in arm.links])
    two = np.maximum(2 * 0.7 * fast * inertia - damping, 0.2 * fast * inertia)
    return np.array([float(f"{x:.3g}") for x in inertia * fast**2]), np.array([float(f"{x:.3g}") for x in two])
