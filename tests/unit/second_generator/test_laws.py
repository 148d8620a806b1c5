"""Known limits of the generator's own laws."""

from dataclasses import replace

import numpy as np
import pytest

from tests.second_generator.laws import (
    STEP_S,
    BoucWen,
    Cogging,
    Drive,
    IntermittentStick,
    Magnet,
    Motor,
    OddRipple,
    OneSidedCable,
    PaddleDrag,
    Spring,
    TightSpot,
)
from tests.unit.second_generator.arms import INERTIA_KG_M2, LEVEL, LINK, PENDULUM, body_of, go, plant_of


def motor(**changed):
    values = {"delay_s": 0.0, "error": 0.0, "limit_nm": 9.0, "loss_per_k": 0.0, "rise_k_nm2": 10.0, "time_constant_s": 5.0}
    return Motor(**{key: np.array([float(value)]) for key, value in (values | changed).items()})


def test_a_pendulum_without_friction_keeps_its_energy():
    q, v = go(plant_of(body_of(PENDULUM), position=1.0), 5.0)
    energy = 0.5 * INERTIA_KG_M2 * v**2 - 9.81 * 0.2 * np.cos(q)
    # of the half swing's energy; the rest is the step's length
    assert np.ptp(energy) < 0.002 * 9.81 * 0.2 * (1 - np.cos(1.0))


def test_coulomb_friction_stops_at_the_expected_time():
    body = body_of(LEVEL)
    body.extra_coulomb[0] = 0.14
    _, v = go(plant_of(body, velocity=1.0), 0.7)
    stopped_s = np.argmax(v < 0.005) * STEP_S
    assert stopped_s == pytest.approx(INERTIA_KG_M2 / 0.14, rel=0.02)
    assert abs(v[-1]) < 0.002


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_coulomb_friction_acts_against_the_motion(side):
    body = body_of(LEVEL)
    body.extra_coulomb[0] = 0.1
    _, v = go(plant_of(body, velocity=side), 0.1)
    assert (v[-1] - v[20]) / (0.1 - 21 * STEP_S) == pytest.approx(-side * 0.1 / INERTIA_KG_M2, rel=0.001)


def test_coulomb_friction_holds_what_is_smaller():
    body = body_of(LEVEL)
    body.extra_coulomb[0] = 0.1
    held, _ = go(plant_of(body), 1.0, command=0.08)
    moved, _ = go(plant_of(body), 1.0, command=0.11)
    # what bends may slip a little when the torque comes at once
    assert abs(held[-1]) < 0.002
    assert held[-1] == pytest.approx(held[2000], abs=1e-5)
    assert moved[-1] > 0.05


@pytest.mark.parametrize(
    ("change", "wanted_nm"),
    [
        ({"extra_viscous": 0.05}, 0.05 * 2.0),
        ({"extra_coulomb": 0.02, "stribeck": 0.1, "stribeck_speed": 0.1}, 0.02),
        ({"load": 0.2}, 0.2 * 0.5),
        ({"extra_coulomb": 0.05, "direction": 0.03}, 0.08),
    ],
)
def test_frictions_at_speed(change, wanted_nm):
    body = body_of(LEVEL)
    for key, value in change.items():
        getattr(body, key)[0] = value
    _, v = go(plant_of(body, velocity=2.0, command=0.5), 0.05, command=0.5)
    # the damping's torque falls with the speed: its mean counts
    mean = wanted_nm if "extra_viscous" not in change else 0.05 * v.mean()
    assert (v[-1] - v[20]) / (0.05 - 21 * STEP_S) == pytest.approx((0.5 - mean) / INERTIA_KG_M2, rel=0.01)


def test_direction_makes_the_other_way_easier():
    body = body_of(LEVEL)
    body.extra_coulomb[0], body.direction[0] = 0.05, 0.03
    _, v = go(plant_of(body, velocity=-2.0), 0.05)
    assert (v[-1] - v[20]) / (0.05 - 21 * STEP_S) == pytest.approx(0.02 / INERTIA_KG_M2, rel=0.02)


def test_play_lets_the_rotor_turn_alone_and_no_further():
    body = body_of(LEVEL)
    body.drives[0] = Drive(LINK.armature_kg_m2, 2000.0, gap_rad=0.02)
    plant = plant_of(body)
    go(plant, 0.02, command=0.4)
    # half of the play is 10 mrad; a free rotor needs sqrt(2 * 0.01 * 0.02 / 0.4) = 32 ms for it
    assert plant.data.qpos[0] == 0.0
    assert plant.drives[0].q == pytest.approx(0.5 * 0.4 / 0.02 * 0.02**2, rel=0.05)
    go(plant, 1.0, command=0.4)
    assert plant.data.qpos[0] > 0.05
    assert plant.drives[0].q - plant.data.qpos[0] < 0.01 + 0.002


def test_a_stiff_drive_without_play_is_no_drive():
    body = body_of(PENDULUM)
    body.drives[0] = Drive(LINK.armature_kg_m2, 5000.0)
    q, _ = go(plant_of(body, position=0.8), 1.0)
    rigid, _ = go(plant_of(body_of(PENDULUM), position=0.8), 1.0)
    assert np.abs(q - rigid).max() < 0.01


def test_a_belt_with_memory_creeps_on_under_the_same_torque():
    drive = Drive(0.02, 100.0, memory_share=1.0, memory_s=0.2, damping_ratio=1.0)
    stretch = []
    for _ in range(round(1.5 / STEP_S)):
        drive.step(0.0, 0.0, 1.0)
        stretch.append(drive.q)
    assert stretch[round(0.08 / STEP_S)] < 0.0075
    assert stretch[-1] == pytest.approx(0.01, rel=0.02)


def test_a_late_command_comes_late():
    late = motor(delay_s=0.01)
    late.fill(np.array([0.0]))
    given = [late.torque(0.0, np.array([1.0]))[0] for _ in range(60)]
    assert given.index(1.0) == 40


def test_motors_scale_clip_and_get_weak():
    assert motor(error=-0.2).torque(0.0, np.array([1.0]))[0] == pytest.approx(0.8)
    assert motor(limit_nm=0.6).torque(0.0, np.array([-1.0]))[0] == -0.6
    warm = motor(loss_per_k=0.01)
    for _ in range(round(25 / STEP_S)):
        given = warm.torque(0.0, np.array([2.0]))[0]
    # 10 K/(N m)^2 times 4 (N m)^2 are 40 K after five time constants, less e^-5
    assert given == pytest.approx(2.0 * (1 - 0.4 * (1 - np.exp(-5))), rel=1e-3)
    assert warm.current[0] == 2.0


def test_hysteresis_loses_energy_in_a_loop_and_forgets_no_sign():
    law, t = BoucWen(0.1, 0.05), np.arange(0, 4, STEP_S)
    q = 0.3 * np.sin(2 * np.pi * t)
    v = np.gradient(q, STEP_S)
    torque = np.array([law.torque(0.0, a, b, 0.0) for a, b in zip(q, v, strict=True)])
    assert np.abs(torque).max() == pytest.approx(0.1, rel=0.02)
    assert np.sum((torque * v)[-4000:]) * STEP_S == pytest.approx(-0.1 * 4 * 0.3, rel=0.2)


def test_springs_of_one_and_two_sides():
    assert Spring(2.0, 0.5).torque(0, 0.7, 0, 0) == pytest.approx(-0.4)
    assert OneSidedCable(2.0, 0.5, 1.0).torque(0, 0.7, 0, 0) == pytest.approx(-0.4)
    assert OneSidedCable(2.0, 0.5, 1.0).torque(0, 0.3, 0, 0) == 0.0
    assert OneSidedCable(2.0, 0.5, -1.0).torque(0, 0.3, 0, 0) == pytest.approx(0.4)


def test_a_magnet_pulls_to_its_place_within_its_reach():
    law = Magnet(0.3, 0.2, 0.1)
    assert law.torque(0, 0.3, 0, 0) == pytest.approx(-0.3)
    assert law.torque(0, 0.1, 0, 0) == pytest.approx(0.3)
    assert abs(law.torque(0, 1.0, 0, 0)) < 1e-9


def test_ripple_has_no_first_harmonic_and_needs_a_torque():
    angle = np.arange(4096) * 2 * np.pi / 4096
    law = OddRipple(0.2, 1 / (2 * np.pi), 0.3)
    spectrum = np.abs(np.fft.rfft([law.torque(0, a, 0, 1.5) for a in angle])) / 2048
    assert spectrum[1] < 1e-9
    assert spectrum[[3, 5, 7]] == pytest.approx([0.3, 0.18, 0.12])
    assert law.torque(0, 0.4, 0, 0.0) == 0.0
    assert Cogging(0.2, 1.0, 0.5 * np.pi).torque(0, 1.0, 0, 0.0) == pytest.approx(0.2)


def test_what_grips_now_and_then_or_here_and_there():
    stick, spot = IntermittentStick(0.5, [(1.0, 1.2)]), TightSpot(0.5, 0.3, 0.1)
    assert [stick.dry(t, 0.0) for t in (0.9, 1.1, 1.3)] == [0.0, 0.5, 0.0]
    assert spot.dry(0, 0.3) == 0.5
    assert spot.dry(0, 0.6) < 1e-9
    assert PaddleDrag(0.1).torque(0, 0, -2.0, 0) == pytest.approx(0.4)


def test_a_supply_and_a_motor_of_another_joint_reach_the_joint():
    body = body_of(LEVEL)
    body.sag = lambda t: 0.5
    _, v = go(plant_of(body), 0.1, command=0.2)
    assert v[-1] == pytest.approx(0.5 * 0.2 * 0.1 / INERTIA_KG_M2, rel=0.01)
    two = replace(LEVEL, links=(LINK, replace(LINK, offset_m=(0.0, 0.0, -0.3))), names=("a", "b"), home_rad=(0.0, 0.0))
    body = body_of(replace(two, torque_limit_nm=(9.0, 9.0)))
    body.crosstalk = np.array([[1.0, -0.5], [0.0, 1.0]])
    plant = plant_of(body)
    plant.step(np.array([0.0, 0.4]))
    assert plant.data.qfrc_applied[0] == pytest.approx(-0.2)
