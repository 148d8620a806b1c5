"""Causes that the documented catalogue (docs/effects.md) has no effect for; same form as those of ``causes.py``."""

from dataclasses import replace

import numpy as np

from tests.second_generator.arms import LooseMass
from tests.second_generator.causes import between, cycles, stiff_contact
from tests.second_generator.laws import BoucWen, Drive, IntermittentStick, Magnet, OddRipple, OneSidedCable, PaddleDrag, TightSpot


def hysteresis(body, j, seen, size, rng):
    amplitude, width = between(0.1, 0.6, size) * seen.torque_rms_nm[j], rng.uniform(0.4, 1.2) * seen.position_std_rad[j]
    body.laws.setdefault(j, []).append(BoucWen(amplitude, width))
    return {"amplitude_nm": amplitude, "width_rad": width}


def encoder_dropouts(body, j, seen, size, rng):
    length, each = between(0.02, 0.25, size), rng.uniform(0.3, 2.0)
    begins = np.cumsum(rng.exponential(each, 400) + length)
    body.gone[j] = [(float(begin), float(begin + length * rng.uniform(0.5, 1.5))) for begin in begins if begin < 45.0]
    return {"length_s": length, "mean_distance_s": each}


def odd_ripple(body, j, seen, size, rng):
    share, each = between(0.06, 0.5, size), cycles(seen, j, rng, harmonics=4)
    body.laws.setdefault(j, []).append(OddRipple(share, each, rng.uniform(-np.pi, np.pi)))
    return {"share": share, "cycles_per_rad": each}


def loose_mass(body, j, seen, size, rng):
    link = body.arm.links[j]
    mass = between(0.08, 0.5, size) * link.mass_kg
    links = list(body.arm.links)
    left = 1 - mass / link.mass_kg
    links[j] = replace(link, mass_kg=link.mass_kg - mass, inertia_kg_m2=tuple(left * value for value in link.inertia_kg_m2))
    length, hz = 2 * abs(link.com_m[2]), rng.uniform(0.5, 2.5)
    axis = (1, 0, 0) if rng.random() < 0.5 else (0, 0, 1)
    stiffness = mass * (2 * np.pi * hz) ** 2
    loose = LooseMass(j, mass, link.com_m, axis, 0.35 * length, stiffness, 2 * 0.08 * np.sqrt(stiffness * mass))
    body.arm = replace(body.arm, links=tuple(links), loose=loose)
    return {"mass_kg": mass, "frequency_hz": hz, "half_travel_m": loose.half_travel_m}


def magnet(body, j, seen, size, rng):
    peak = between(0.1, 0.8, size) * seen.torque_rms_nm[j]
    place = seen.position_mean_rad[j] + rng.uniform(-1, 1) * seen.position_std_rad[j]
    reach = rng.uniform(0.15, 0.4) * seen.position_std_rad[j]
    body.laws.setdefault(j, []).append(Magnet(peak, place, reach))
    return {"peak_nm": peak, "place_rad": place, "reach_rad": reach}


def belt_memory(body, j, seen, size, rng):
    rotor = body.arm.links[j].armature_kg_m2
    soft = seen.torque_rms_nm[j] / between(0.005, 0.1, size)
    stiffness, memory = min(soft, stiff_contact(rotor, seen.inertia_kg_m2[j]) / 2), rng.uniform(0.1, 1.0)
    body.drives[j] = Drive(rotor, stiffness, memory_share=0.8, memory_s=memory, damping_ratio=0.05)
    return {"stiffness_nm_rad": stiffness, "memory_share": 0.8, "memory_s": memory}


def creeping_supply(body, j, seen, size, rng):
    depth, period, phase = between(0.08, 0.5, size), rng.uniform(5.0, 15.0), rng.uniform(0, 2 * np.pi)
    other = rng.uniform(0.3, 0.5)
    body.sag = lambda t: 1 - depth * (0.5 + 0.35 * np.sin(2 * np.pi * t / period + phase) + 0.15 * np.sin(t / other))
    return {"depth": depth, "period_s": period}


def one_sided_cable(body, j, seen, size, rng):
    side = float(rng.choice([-1, 1]))
    stiffness = between(0.2, 2.0, size) * seen.torque_rms_nm[j] / seen.position_std_rad[j]
    taut = seen.position_mean_rad[j] + side * rng.uniform(0.2, 0.8) * seen.position_std_rad[j]
    body.laws.setdefault(j, []).append(OneSidedCable(stiffness, taut, side))
    return {"stiffness_nm_rad": stiffness, "taut_rad": taut, "side": side}


def intermittent_stick(body, j, seen, size, rng):
    level, each = between(0.3, 3.0, size) * seen.torque_rms_nm[j], rng.uniform(1.0, 3.0)
    begins = np.cumsum(rng.exponential(each, 200) + 0.4)
    grips = [(float(begin), float(begin + rng.uniform(0.1, 0.5))) for begin in begins if begin < 45.0]
    body.dry.setdefault(j, []).append(IntermittentStick(level, grips))
    return {"torque_nm": level, "mean_distance_s": each}


def tight_spot(body, j, seen, size, rng):
    level = between(0.15, 1.5, size) * seen.torque_rms_nm[j]
    place = seen.position_mean_rad[j] + rng.uniform(-1, 1) * seen.position_std_rad[j]
    width = rng.uniform(0.15, 0.4) * seen.position_std_rad[j]
    body.dry.setdefault(j, []).append(TightSpot(level, place, width))
    return {"torque_nm": level, "place_rad": place, "half_width_rad": width}


def paddle_drag(body, j, seen, size, rng):
    coefficient = between(0.05, 0.6, size) * seen.torque_rms_nm[j] / seen.speed_rms_rad_s[j] ** 2
    body.laws.setdefault(j, []).append(PaddleDrag(coefficient))
    return {"coefficient_nm_s2_rad2": coefficient}


def crosstalk(body, j, seen, size, rng):
    n = body.arm.joints
    other = int(rng.choice([k for k in range(n) if k != j]))
    share = rng.choice([-1, 1]) * between(0.04, 0.4, size) * min(1.0, seen.torque_rms_nm[j] / seen.torque_rms_nm[other])
    body.crosstalk = np.eye(n)
    body.crosstalk[j, other] = share
    return {"share": share, "from_joint": other}


OUTSIDE = {
    function.__name__: function
    for function in (
        hysteresis,
        encoder_dropouts,
        odd_ripple,
        loose_mass,
        magnet,
        belt_memory,
        creeping_supply,
        one_sided_cable,
        intermittent_stick,
        tight_spot,
        paddle_drag,
        crosstalk,
    )
}
OF_THE_ARM = {"creeping_supply"}
OF_READINGS = {"encoder_dropouts"}
NEEDS_TWO_JOINTS = {"crosstalk"}
