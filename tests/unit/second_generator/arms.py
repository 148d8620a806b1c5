"""Small arms and bodies for the tests of the second generator."""

from dataclasses import replace

import numpy as np

from tests.second_generator.arms import Arm, Link
from tests.second_generator.plant import Plant, plain_body

LINK = Link((0, 0, 0), (0, 1, 0), 1.0, (0.0, 0.0, -0.2), (0.01, 0.01, 0.002), armature_kg_m2=0.02)
PENDULUM = Arm((LINK,), True, 1, ("j1",), (0.0,), (50.0,))
LEVEL = replace(PENDULUM, gravity_m_s2=(0.0, 0.0, 0.0))
"""The same arm where nothing weighs anything."""
INERTIA_KG_M2 = 0.01 + 0.2**2 + 0.02


def body_of(arm):
    one = np.ones(arm.joints)
    return plain_body(arm, 1e-6 * one, 0 * one, 10.0 * one, 10.0 * one)


def plant_of(body, position=0.0, velocity=0.0, command=0.0):
    plant, n = Plant(body), body.arm.joints
    plant.start(np.full(n, position), np.full(n, velocity), np.full(n, command))
    return plant


def go(plant, seconds, command=0.0):
    """Step a plant with a constant command; positions and velocities of the encoders after each step, each (steps,)."""
    from tests.second_generator.laws import STEP_S

    given, found = np.full(plant.joints, command), []
    for _ in range(round(seconds / STEP_S)):
        plant.step(given)
        q, v = plant.turned()
        found.append((q[0], v[0]))
    return np.array(found).T
