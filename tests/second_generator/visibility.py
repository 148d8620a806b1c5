"""How far a hidden cause can be seen: what it moves, against what noise and a 1 % imperfect model move."""

import copy

import numpy as np

from tests.second_generator.causes import OF_READINGS
from tests.second_generator.laws import STEP_S
from tests.second_generator.outside import OF_READINGS as OUTSIDE_OF_READINGS
from tests.second_generator.plant import Plant

WINDOW_S = 0.25


def of_readings(traces, sensors):
    """The larger of position and velocity: root mean square of what readings are off beyond usual noise, over that noise.

    A constant offset is left out, and 1 % of the speed counts as noise of the velocity.
    """
    usual = np.hypot(sensors.noise_rad, sensors.step_rad / 12**0.5)
    squares = []
    for trace in traces:
        beyond = np.maximum(np.var(trace.seen_rad - trace.turned_rad, axis=0) - usual**2, 0.0)
        speed = np.mean((trace.velocity_rad_s - trace.turned_rad_s) ** 2, axis=0)
        noise = sensors.velocity_noise_rad_s**2 + 0.01**2 * np.mean(trace.turned_rad_s**2, axis=0)
        squares.append(max(float((beyond / usual**2).max()), float((speed / noise).max())))
    return float(np.sqrt(np.mean(squares)))


def of_motion(traces, without, declared_without, sensors, period_s, believed=None):
    """Root mean square of what a cause moves within ``WINDOW_S``, against that of noise and of the declared arm's errors.

    ``without`` is the arm that stands there but for this cause, ``declared_without`` the declared one with the same other causes.
    Both start at the states kept in ``traces`` and get the recorded commands (or ``believed`` ones, a list of arrays). The joint
    that shows most counts.
    """
    rows = max(4, round(WINDOW_S / period_s))
    moved, missed = [], []
    for i, trace in enumerate(traces):
        commands = trace.command_nm if believed is None else believed[i]
        for k, state in trace.states.items():
            if k + rows < len(trace.time_s):
                here = _window(without, trace, k, state, commands, rows, period_s)
                there = _window(declared_without, trace, k, state, commands, rows, period_s)
                moved.append(trace.position_rad[k + 1 : k + rows + 1] - here)
                missed.append(here - there)
    moved, missed = np.sqrt(np.mean(np.square(moved), axis=(0, 1))), np.sqrt(np.mean(np.square(missed), axis=(0, 1)))
    noise = np.hypot(sensors.noise_rad, sensors.step_rad / 12**0.5)
    return float((moved / np.hypot(noise, missed)).max())


def is_of_readings(name):
    """Whether a cause acts on what is reported alone."""
    return name in OF_READINGS or name in OUTSIDE_OF_READINGS


def _window(body, trace, k, state, commands, rows, period_s):
    """Readings of positions, shape (rows, joints), of a body that starts where the recording was at row ``k``."""
    n, fine = body.arm.joints, round(period_s / STEP_S)
    plant = Plant(body)
    time_s, qpos, qvel, kept = state
    plant.start(trace.position_rad[k] - body.offset_rad, trace.turned_rad_s[k], commands[k])
    _take_over(plant, time_s, qpos, qvel, copy.deepcopy(kept))
    late = len(plant.motor.past)
    for s in range(late):
        plant.motor.past[(-1 - s) % late] = commands[max(0, k - 1 - s // fine)]
    found = np.empty((rows, n))
    for row in range(rows):
        for _ in range(fine):
            plant.step(commands[k + row])
        found[row] = plant.reading()[0]
    return found


def _take_over(plant, time_s, qpos, qvel, kept):
    """Give a plant the states of those laws that it shares with the one that was recorded."""
    motor, friction, laws, dry, drives, filtered, held = kept
    n = plant.joints
    plant.time_s, plant.motor.heat_k, plant.friction.bend = time_s, motor.heat_k, friction.bend
    plant.filtered, plant.held = filtered, held
    for own, recorded in ((plant.laws, laws), (plant.dry, dry)):
        for j, each in own.items():
            own[j] = [next((law for law in recorded.get(j, []) if type(law) is type(one)), one) for one in each]
    for j in plant.drives:
        if j in drives:
            plant.drives[j] = drives[j]
            plant.data.qpos[j], plant.data.qvel[j] = qpos[j], qvel[j]
    if len(plant.data.qpos) == len(qpos):
        plant.data.qpos[n:], plant.data.qvel[n:] = qpos[n:], qvel[n:]
