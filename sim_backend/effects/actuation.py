"""Effects between the torque that the safety pipeline sends and the torque that reaches a joint.

The functions act on one joint for one step and are compiled into the control callback (``driver/native_control.py``).
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numba

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_joint, per_robot
from sim_backend.trifinger import constants as c

MAX_DELAY_S = 0.1
"""The longest action delay; the record of each simulation keeps so much of the past."""
COGGING_PER_TURN = 72
"""Of the rotor: 18 slots and 24 magnets (T-Motor Antigravity 4004, open_robot_actuator_hardware actuator_module_v1)."""
ROTOR_INERTIA_KG_M2 = 4.5e-6 * c.GEAR_RATIO**2
"""On the joint's side (4.5e-6 at the rotor: configuration of the Solo robot, which has the same actuator modules)."""


@numba.njit(inline="always")
def delayed_torque_nm(newer_nm: float, older_nm: float, fraction: float) -> float:
    """Mean over a step of a held torque that arrives ``fraction`` of a step after the step's begin."""
    if fraction == 0.0:
        return newer_nm
    return newer_nm + fraction * (older_nm - newer_nm)


@numba.njit(inline="always")
def share_of_step(now_s: float, due_s: float, step_s: float) -> float:
    """For which share of the step that begins now a command acts that is due at a time; below 0 if not yet."""
    return min(1.0, (now_s + step_s - due_s) / step_s)


@numba.njit(inline="always")
def scaled_torque_nm(torque_nm: float, error: float) -> float:
    """Torque of a motor whose torque constant is off by the relative ``error``."""
    return torque_nm * (1.0 + error)


@numba.njit(inline="always")
def saturated_torque_nm(torque_nm: float, limit_nm: float) -> float:
    """Torque clipped to what the motor gives."""
    return min(max(torque_nm, -limit_nm), limit_nm)


@numba.njit(inline="always")
def sagging_factor(sag_per_nm: float, total_torque_nm: float) -> float:
    """Share of the torque limit that a supply leaves which sags under the torque of all motors together."""
    return max(0.0, 1.0 - sag_per_nm * total_torque_nm)


@numba.njit(inline="always")
def temperature_rise_k(
    rise_k: float, torque_nm: float, rise_per_torque_k_nm2: float, time_constant_s: float, step_s: float
) -> float:
    """Temperature above ambient after a step: first order, heated by the copper loss of the torque."""
    x = step_s / time_constant_s
    share = x * (1.0 - x / 2.0 * (1.0 - x / 3.0))  # of 1 - exp(-x), to 1e-11 for x below 0.005
    return rise_k + share * (rise_per_torque_k_nm2 * torque_nm * torque_nm - rise_k)


@numba.njit(inline="always")
def derated_torque_nm(torque_nm: float, rise_k: float, loss_per_k: float) -> float:
    """Torque of a motor that loses a share for each kelvin above ambient."""
    if loss_per_k == 0.0:
        return torque_nm
    return torque_nm * max(0.0, 1.0 - loss_per_k * rise_k)


@numba.njit(inline="always")
def cogging_torque_nm(amplitude_nm: float, cycles_per_rad: float, phase_rad: float, position_rad: float) -> float:
    """Torque of the rotor's preferred positions."""
    if amplitude_nm == 0.0:
        return 0.0
    return amplitude_nm * math.sin(2.0 * math.pi * cycles_per_rad * position_rad + phase_rad)


@numba.njit(inline="always")
def correlated_noise(previous: float, fresh: float, step_s: float, time_constant_s: float) -> float:
    """Next value of an Ornstein-Uhlenbeck process of unit variance; ``fresh`` is a standard normal number."""
    kept = math.exp(-step_s / time_constant_s)
    return kept * previous + math.sqrt(1.0 - kept * kept) * fresh


@numba.njit(inline="always")
def scaled_gain(gain: float, factor: float) -> float:
    """A gain of the controller that is not what it should be."""
    return gain * factor


@numba.njit(inline="always")
def backlash(
    play_rad: float,
    rotor_rad_s: float,
    joint_rad_s: float,
    torque_nm: float,
    gap_rad: float,
    rotor_inertia_kg_m2: float,
    step_s: float,
) -> tuple[float, float, float]:
    """One step of a rotor with play in its gear.

    Args:
        play_rad: rotor ahead of joint, between -gap/2 and gap/2.
        rotor_rad_s: speed of the rotor, on the joint's side of the gear.
        joint_rad_s: speed of the joint.
        torque_nm: torque of the motor.
        gap_rad: width of the play.
        rotor_inertia_kg_m2: inertia of the free rotor, on the joint's side.
        step_s: length of the step.

    Returns:
        The play, the rotor's speed and the transmitted torque: the motor's torque while the rotor presses against the side
        it lies on, none while it crosses the gap, and its momentum within one step when it arrives. As the gap goes to zero
        the torque passes unchanged.
    """
    half = 0.5 * gap_rad
    lies_on = 1.0 if play_rad >= half else (-1.0 if play_rad <= -half else 0.0)
    if lies_on != 0.0 and torque_nm * lies_on > 0.0:
        return lies_on * half, joint_rad_s, torque_nm
    if lies_on != 0.0:
        rotor_rad_s = joint_rad_s
    rotor_rad_s = rotor_rad_s + step_s * torque_nm / rotor_inertia_kg_m2
    play_rad = play_rad + step_s * (rotor_rad_s - joint_rad_s)
    if abs(play_rad) < half:
        return play_rad, rotor_rad_s, 0.0
    impact_nm = rotor_inertia_kg_m2 * (rotor_rad_s - joint_rad_s) / step_s
    return (half if play_rad > 0.0 else -half), joint_rad_s, impact_nm


def _effect(
    name: str, about: str, source: str, apply: Callable[..., Any], *parameters: Parameter, shape: Sequence[Parameter] = ()
) -> Effect:
    return Effect(name, Group.ACTUATION, about, source, Acts.CONTROL, parameters, apply, tuple(shape))


EFFECTS = (
    _effect(
        "action_delay",
        "the torque reaches the motors later than it was sent; a fraction of a step acts as the mean over the step",
        "PACE (arXiv 2509.06342) fits one delay to each robot; MuJoCo's actuator delay is the same law in plain MJCF",
        delayed_torque_nm,
        per_joint("delay_s", "s", 0.0, MAX_DELAY_S, 0.0, "from the safety pipeline to the motor"),
    ),
    _effect(
        "timing_jitter",
        "a new command comes late by half-normal chance; until then the previous one is repeated",
        "robot_interfaces doc/timeseries.rst: a late user repeats the previous action; Dactyl (arXiv 1808.00177) jitters timing",
        share_of_step,
        per_robot("std_s", "s", 0.0, 0.02, 0.0, "scale of the half-normal lateness, drawn for each new command"),
    ),
    _effect(
        "torque_constant",
        "every torque of a motor is off by the same factor",
        "robot_fingers trifinger_driver.hpp gives one nominal 0.02 N m/A for all motors",
        scaled_torque_nm,
        per_joint("error", "", -0.5, 0.5, 0.0, "relative error of the torque"),
    ),
    _effect(
        "torque_saturation",
        "the motor gives no more than its own limit, below that of the driver",
        "MuJoCo's dcmotor saturation; robot_fingers config/trifingerpro.yml limits the current to 2.2 A",
        saturated_torque_nm,
        per_joint("limit_nm", "N m", 0.02, c.MAX_TORQUE_NM, c.MAX_TORQUE_NM, "largest torque of the motor"),
    ),
    _effect(
        "supply_sag",
        "the torque limit of all motors falls with the torque that they give together",
        "a supply with inner resistance: Rhoban/bam (arXiv 2410.08650) and MuJoCo's dcmotor take the voltage as given",
        sagging_factor,
        per_robot(
            "loss_per_nm", "1/(N m)", 0.0, 0.5, 0.0, "share of the driver's torque limit lost for each N m of total torque"
        ),
    ),
    _effect(
        "thermal_derating",
        "a motor that gets warm gives less torque for the same current",
        "MuJoCo's dcmotor thermal; magnets of NdFeB lose about 0.11 % of their flux for each kelvin",
        derated_torque_nm,
        per_joint("loss_per_k", "1/K", 0.0, 0.02, 0.0, "share of the torque lost for each kelvin above ambient"),
        shape=(
            per_joint("rise_k_nm2", "K/(N m)^2", 0.0, 2000.0, 160.0, "temperature above ambient that a constant torque leads to"),
            per_joint("time_constant_s", "s", 1.0, 3600.0, 300.0, "of heating and cooling"),
        ),
    ),
    _effect(
        "cogging",
        "the rotor prefers some positions",
        "MuJoCo's dcmotor cogging",
        cogging_torque_nm,
        per_joint("amplitude_nm", "N m", 0.0, 0.1, 0.0, "largest torque, on the joint's side of the gear"),
        shape=(
            per_joint("cycles_per_rad", "1/rad", 0.1, 1000.0, COGGING_PER_TURN * c.GEAR_RATIO / (2 * math.pi), "of the torque"),
            per_joint("phase_rad", "rad", -math.pi, math.pi, 0.0, "at joint position zero"),
        ),
    ),
    _effect(
        "action_noise",
        "the torque varies by chance, from step to step and slowly",
        "IsaacGymEnvs Trifinger.yaml: white and correlated noise of actions; Dactyl (arXiv 1808.00177), table of randomisations",
        correlated_noise,
        per_joint("white_nm", "N m", 0.0, 0.1, 0.0, "standard deviation, redrawn every hold_s"),
        per_joint("correlated_nm", "N m", 0.0, 0.1, 0.0, "standard deviation of the slow part"),
        per_joint("relative", "", 0.0, 0.5, 0.0, "standard deviation in proportion to the torque, redrawn every hold_s"),
        shape=(
            per_robot("hold_s", "s", 0.001, 0.1, 0.001, "how long a white number is held"),
            per_robot("time_constant_s", "s", 0.001, 1000.0, 0.1, "over which the slow part is correlated"),
        ),
    ),
    _effect(
        "backlash",
        "the rotor turns freely through a gap before the joint follows; encoders sit on the rotor",
        "Dactyl (arXiv 1808.00177) models actuator backlash; belts and bearings of the finger modules have play",
        backlash,
        per_joint("gap_rad", "rad", 0.0, 0.1, 0.0, "width of the play at the joint"),
        shape=(
            per_joint(
                "rotor_inertia_kg_m2",
                "kg m^2",
                1e-5,
                1e-2,
                ROTOR_INERTIA_KG_M2,
                "of the free rotor, on the joint's side of the gear",
            ),
        ),
    ),
    _effect(
        "position_gain",
        "position commands act with another stiffness",
        "Dactyl (arXiv 1808.00177) randomises the actuators' P term",
        scaled_gain,
        per_joint("factor", "", 0.2, 4.0, 1.0, "of the driver's position gain"),
    ),
    _effect(
        "safety_damping",
        "the driver's velocity damping has another gain",
        "robot_fingers config/trifingerpro.yml has 0.09, 0.09, 0.05; trifinger_simulation has 0.08, 0.08, 0.04",
        scaled_gain,
        per_joint("factor", "", 0.0, 3.0, 1.0, "of the driver's safety damping"),
    ),
)
