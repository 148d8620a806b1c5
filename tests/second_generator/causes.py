"""Hidden causes of the documented catalogue (docs/effects.md): how each is drawn for an arm, and what it changes.

Each function takes the body, the joint, what a pilot run showed (``Seen``) and a ``size`` between 0 (small) and 1
(large); it changes the body and gives the parameters as the catalogue names them. Sizes are logarithmic:
``between(low, high, size)``.
"""

from dataclasses import dataclass, replace

import numpy as np

from tests.second_generator.laws import STEP_S, Cogging, Drive, Spring


@dataclass(frozen=True)
class Seen:
    """What a pilot run without causes showed, each with shape (joints,), and the table's rate."""

    torque_rms_nm: np.ndarray
    torque_peak_nm: np.ndarray
    speed_rms_rad_s: np.ndarray
    position_mean_rad: np.ndarray
    position_std_rad: np.ndarray
    inertia_kg_m2: np.ndarray
    rate_hz: float


def between(low, high, size):
    """A number between two, logarithmic in ``size``."""
    return float(low * (high / low) ** size)


def coulomb_friction(body, j, seen, size, rng):
    body.extra_coulomb[j] = between(0.03, 0.5, size) * seen.torque_rms_nm[j]
    return {"torque_nm": body.extra_coulomb[j]}


def viscous_friction(body, j, seen, size, rng):
    body.extra_viscous[j] = between(0.03, 0.5, size) * seen.torque_rms_nm[j] / seen.speed_rms_rad_s[j]
    return {"damping_nm_s_rad": body.extra_viscous[j]}


def stribeck_friction(body, j, seen, size, rng):
    body.stribeck[j] = between(0.05, 0.6, size) * seen.torque_rms_nm[j]
    body.stribeck_speed[j] = rng.uniform(0.1, 0.5) * seen.speed_rms_rad_s[j]
    return {"extra_nm": body.stribeck[j], "speed_rad_s": body.stribeck_speed[j]}


def load_friction(body, j, seen, size, rng):
    body.load[j] = between(0.03, 0.4, size)
    return {"coefficient": body.load[j]}


def directional_friction(body, j, seen, size, rng):
    # friction cannot drive a joint: the difference is at most what the bearing has in the mean
    most = 0.95 * body.arm.links[j].frictionloss_nm
    body.direction[j] = rng.choice([-1, 1]) * min(between(0.03, 0.4, size) * seen.torque_rms_nm[j], most)
    return {"difference_nm": body.direction[j]}


def backlash(body, j, seen, size, rng):
    rotor, gap = body.arm.links[j].armature_kg_m2, between(0.003, 0.06, size)
    body.drives[j] = Drive(rotor, stiff_contact(rotor, seen.inertia_kg_m2[j]), gap_rad=gap)
    return {"gap_rad": gap, "rotor_inertia_kg_m2": rotor}


def stiff_contact(rotor_kg_m2, whole_kg_m2):
    """As stiff as steps of this length bear, N m/rad."""
    link = max(whole_kg_m2 - rotor_kg_m2, 0.05 * whole_kg_m2)
    return (0.2 / STEP_S) ** 2 * rotor_kg_m2 * link / (rotor_kg_m2 + link)


def joint_stiffness(body, j, seen, size, rng):
    stiffness = between(0.04, 0.6, size) * seen.torque_rms_nm[j] / seen.position_std_rad[j]
    reference = seen.position_mean_rad[j] + rng.uniform(-1.0, 1.0) * seen.position_std_rad[j]
    body.laws.setdefault(j, []).append(Spring(stiffness, reference))
    return {"stiffness_nm_rad": stiffness, "reference_rad": reference}


def link_mass(body, j, seen, size, rng):
    factor = float(np.exp(rng.choice([-1, 1]) * between(0.06, 0.6, size)))
    links = list(body.arm.links)
    moments = tuple(factor * value for value in links[j].inertia_kg_m2)
    links[j] = replace(links[j], mass_kg=links[j].mass_kg * factor, inertia_kg_m2=moments)
    body.arm = replace(body.arm, links=tuple(links))
    return {"factor": factor}


def rotor_inertia(body, j, seen, size, rng):
    more = between(0.05, 0.8, size) * seen.inertia_kg_m2[j]
    links = list(body.arm.links)
    links[j] = replace(links[j], armature_kg_m2=links[j].armature_kg_m2 + more)
    body.arm = replace(body.arm, links=tuple(links))
    return {"armature_kg_m2": more}


def torque_constant(body, j, seen, size, rng):
    body.torque_error[j] = rng.choice([-1, 1]) * between(0.05, 0.4, size)
    return {"error": body.torque_error[j]}


def action_delay(body, j, seen, size, rng):
    delay = round(between(0.002, 0.03, size) / STEP_S) * STEP_S
    body.delay_s[j] = delay
    return {"delay_s": delay}


def torque_saturation(body, j, seen, size, rng):
    body.limit_nm[j] = (1 - between(0.1, 0.6, size)) * seen.torque_peak_nm[j]
    return {"limit_nm": body.limit_nm[j]}


def thermal_derating(body, j, seen, size, rng):
    body.warming_s[j] = rng.uniform(6.0, 20.0)
    body.rise_k_nm2[j] = rng.uniform(40.0, 80.0) / seen.torque_rms_nm[j] ** 2
    body.loss_per_k[j] = between(0.06, 0.45, size) / (body.rise_k_nm2[j] * seen.torque_rms_nm[j] ** 2)
    loss, rise, warming = body.loss_per_k[j], body.rise_k_nm2[j], body.warming_s[j]
    return {"loss_per_k": loss, "rise_k_nm2": rise, "time_constant_s": warming}


def cycles(seen, j, rng, harmonics=1):
    """Whole cycles a turn that the table's rate can show at the arm's usual speed, as cycles for each rad."""
    most = seen.rate_hz / (8 * harmonics * seen.speed_rms_rad_s[j])
    least = min(1.0 / max(seen.position_std_rad[j], 0.05), most)
    return max(1, round(2 * np.pi * rng.uniform(least, max(min(most, 30.0 / harmonics), least)))) / (2 * np.pi)


def cogging(body, j, seen, size, rng):
    amplitude, each, phase = between(0.04, 0.5, size) * seen.torque_rms_nm[j], cycles(seen, j, rng), rng.uniform(-np.pi, np.pi)
    body.laws.setdefault(j, []).append(Cogging(amplitude, each, phase))
    return {"amplitude_nm": amplitude, "cycles_per_rad": each, "phase_rad": phase}


def encoder_offset(body, j, seen, size, rng):
    body.offset_rad[j] = rng.choice([-1, 1]) * between(0.01, 0.15, size)
    return {"offset_rad": body.offset_rad[j]}


def velocity_filter(body, j, seen, size, rng):
    body.filter_s[j] = between(0.003, 0.05, size)
    return {"time_constant_s": body.filter_s[j]}


def encoder_quantisation(body, j, seen, size, rng):
    body.step_rad[j] = max(between(8.0, 60.0, size) * body.step_rad[j], between(0.002, 0.02, size))
    return {"step_rad": body.step_rad[j]}


def joint_noise(body, j, seen, size, rng):
    body.noise_rad[j] = max(between(8.0, 60.0, size) * body.noise_rad[j], between(0.001, 0.01, size))
    return {"position_rad": body.noise_rad[j]}


def position_gain(body, j, seen, size, rng):
    body.gain_factor[j] = float(np.exp(rng.choice([-1, 1]) * between(0.05, 0.6, size)))
    return {"factor": body.gain_factor[j]}


def table_tilt(body, j, seen, size, rng):
    angle, key = rng.choice([-1, 1]) * between(0.01, 0.15, size), "pitch_rad"
    across = {link.axis for link in body.arm.links}
    if len(across) > 1 and rng.random() < 0.5:
        key = "roll_rad"
    # the table turns under the arm, so that gravity turns the other way round in the arm's own frame
    x, y, z = body.arm.gravity_m_s2
    sine, cosine = np.sin(angle), np.cos(angle)
    if key == "roll_rad":
        turned = (x, y * cosine + z * sine, z * cosine - y * sine)
    else:
        turned = (x * cosine - z * sine, y, z * cosine + x * sine)
    body.arm = replace(body.arm, gravity_m_s2=turned)
    return {key: angle}


def gravity(body, j, seen, size, rng):
    more = rng.choice([-1, 1]) * between(0.4, 4.0, size)
    x, y, z = body.arm.gravity_m_s2
    body.arm = replace(body.arm, gravity_m_s2=(x, y, z + more))
    return {"offset_m_s2": [0.0, 0.0, more]}


CATALOGUE = {
    function.__name__: function
    for function in (
        coulomb_friction,
        viscous_friction,
        stribeck_friction,
        load_friction,
        directional_friction,
        backlash,
        joint_stiffness,
        link_mass,
        rotor_inertia,
        torque_constant,
        action_delay,
        torque_saturation,
        thermal_derating,
        cogging,
        encoder_offset,
        velocity_filter,
        encoder_quantisation,
        joint_noise,
        position_gain,
        table_tilt,
        gravity,
    )
}
OF_THE_ARM = {"table_tilt", "gravity"}
"""Effects without a joint."""
MAYBE_EVERYWHERE = {"coulomb_friction", "viscous_friction", "action_delay", "velocity_filter"}
"""Effects that all joints of an arm may share."""
NEEDS_NEIGHBOURS = {"encoder_quantisation", "joint_noise"}
"""Effects that only other joints of the same arm can show to be unusual (docs/verdicts.md)."""
OF_READINGS = {"velocity_filter", "encoder_quantisation", "joint_noise"}
"""Effects on what is reported, not on how the arm moves."""
SAME_PHYSICS = {"table_tilt": ("gravity",)}
"""A tilt of the table is a gravity that has turned: each of the names says the truth."""
