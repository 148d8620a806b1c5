"""Values of the catalogue reach the compiled model of any object."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.subjects.tosses.geometry import geometry_of
from sim_backend.reality_gap.subjects.tosses.models import (
    DAMPING,
    FRICTION,
    GRAVITY,
    MASS,
    PITCH,
    SIZE,
    TIME_CONSTANT,
    compiled,
    nominal_values,
)
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec

_TETRA = "0 0 0.05  0.05 0 -0.03  -0.05 0.04 -0.03  -0.05 -0.04 -0.03"


def _model(values):
    spec = toss_spec()
    geometry = geometry_of(spec.copy().compile(), "thing")
    return geometry.model, compiled(spec, geometry, values, 0.001)


def test_contacts_have_the_value_whatever_the_rule_of_mixing():
    _, model = _model({FRICTION: 0.05, TIME_CONSTANT: 0.01, DAMPING: 0.7})
    data = mujoco.MjData(model)
    data.qpos[2] = 0.049
    mujoco.mj_forward(model, data)
    assert data.ncon == 4
    assert data.contact.friction[:, 0] == pytest.approx(0.05)
    assert data.contact.solref == pytest.approx(np.tile([0.01, 0.7], (4, 1)))


def test_size_keeps_the_mass_and_mass_the_size():
    nominal, model = _model({SIZE: 0.9, MASS: 2.0})
    assert model.geom_size[1] == pytest.approx(0.9 * nominal.geom_size[1])
    assert model.body_mass[1] == pytest.approx(2.0 * nominal.body_mass[1])
    assert model.body_inertia[1] == pytest.approx(2.0 * 0.81 * nominal.body_inertia[1])
    assert model.body_subtreemass[1] == pytest.approx(model.body_mass[1])


def test_gravity_grows_against_its_direction_and_tilts():
    assert _model({GRAVITY: 0.5})[1].opt.gravity == pytest.approx([0.0, 0.0, -9.31])
    assert _model({PITCH: 0.1})[1].opt.gravity == pytest.approx([9.81 * np.sin(0.1), 0.0, -9.81 * np.cos(0.1)])


def test_a_mesh_grows_too():
    spec = mujoco.MjSpec.from_string(f"""<mujoco><asset><mesh name="m" vertex="{_TETRA}"/></asset><worldbody>
        <geom type="plane" size="1 1 1"/><body name="thing"><freejoint/><geom type="mesh" mesh="m"/></body>
        </worldbody></mujoco>""")
    geometry = geometry_of(spec.copy().compile(), "thing")
    model = compiled(spec, geometry, {SIZE: 1.2}, 0.001)
    assert model.geom_rbound[1] == pytest.approx(1.2 * geometry.model.geom_rbound[1])
    assert model.body_mass[1] == pytest.approx(geometry.model.body_mass[1])


def test_nominal_friction_is_that_of_the_contact():
    spec = toss_spec(friction=0.3)
    spec.geom("thing").friction[0], spec.geom("thing").priority = 0.1, 1
    values = nominal_values(geometry_of(spec.compile(), "thing"))
    assert values[FRICTION] == pytest.approx(0.1)
    assert (values[TIME_CONSTANT], values[DAMPING]) == (0.02, 1.0)
