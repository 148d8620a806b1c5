"""The record of one simulation in MuJoCo's ``userdata``: parameters and state of everything that acts every millisecond.

Each parameter of a control effect has its slots, then come the states, and last a ring of past torques. The control
callback reads and writes them; batches and rollouts carry them along like any other state of the simulation.
"""

import math

from sim_backend.effects.actuation import MAX_DELAY_S
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts

SAFETY_ON = 0
"""1.0 where the safety pipeline acts, 0.0 where ``ctrl`` passes unchanged."""
EFFECTS_ON = 1
"""1.0 where effects act."""
BOUNDS_ON = 2
"""1.0 where all nine joints have a friction constraint whose bound is set in every step."""
SEED = 3
CLOCK = 4
"""Steps since the reset."""
STEP_S = 5
AFTER_WALL = 6
"""The first geom after the wall's, where parts of the wall are switched off and on (``driver/wall_watch.py``); 0 elsewhere."""
POSITION_TARGET = 7
"""First of nine position targets, rad, NaN for none."""
CONTROL_SLOTS = POSITION_TARGET + 9
"""A simulation needs at least these for the safety pipeline."""

CONTROL_PARAMETERS = tuple(
    (effect.key(parameter), parameter)
    for effect in CATALOGUE.values()
    if effect.acts is Acts.CONTROL
    for parameter in effect.all_parameters
)
COULOMB = "coulomb_friction.torque_nm"
"""MuJoCo's own, but the bounds of other frictions are counted from it."""


def _layout() -> tuple[dict[str, int], int]:
    """First slot of each parameter, and the first slot after all of them."""
    slots, at = {COULOMB: CONTROL_SLOTS}, CONTROL_SLOTS + 9
    for key, parameter in CONTROL_PARAMETERS:
        slots[key] = at
        at += parameter.width
    return slots, at


SLOTS, _STATE = _layout()

POSITION_EPISODE = _STATE
"""Errors that stay the same within a trial, drawn when it begins."""
VELOCITY_EPISODE = POSITION_EPISODE + 9
FILTERED_VELOCITY = VELOCITY_EPISODE + 9
TEMPERATURE = FILTERED_VELOCITY + 9  # kelvin above ambient
CORRELATED = TEMPERATURE + 9
PLAY = CORRELATED + 9
ROTOR = PLAY + 9
HELD_TORQUE = ROTOR + 9
HELD_TARGET = HELD_TORQUE + 9
AWAITED_TORQUE = HELD_TARGET + 9
AWAITED_TARGET = AWAITED_TORQUE + 9
DUE_S = AWAITED_TARGET + 9
RING = DUE_S + 1
SMALLEST = RING + 2 * 9
"""A simulation needs at least these slots for effects."""

MEASURED_POSITION, MEASURED_VELOCITY, MEASURED_TORQUE, EFFECTIVE_TORQUE = 0, 9, 18, 27
REPORT_SIZE = 36
"""Numbers that the callback reports in each step through ``sensordata``."""

CHANNEL_POSITION, CHANNEL_VELOCITY, CHANNEL_TORQUE, CHANNEL_WHITE, CHANNEL_CORRELATED = 0, 9, 18, 27, 36
CHANNEL_POSITION_EPISODE, CHANNEL_VELOCITY_EPISODE = 45, 54
CHANNEL_LATENESS, CHANNEL_PUSH_CHANCE, CHANNEL_PUSH, CHANNEL_RELATIVE = 63, 64, 65, 70
"""Channels of ``noise``; the tracker's begin at 100."""


def ring_length(step_s: float) -> int:
    """Past torques that the longest delay needs."""
    return math.ceil(MAX_DELAY_S / step_s) + 2


def record_size(step_s: float) -> int:
    """Slots of a simulation with steps of this length."""
    return RING + 9 * ring_length(step_s)
