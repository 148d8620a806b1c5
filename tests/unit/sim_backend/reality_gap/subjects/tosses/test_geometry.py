"""Which geoms an object has and can touch, and how far a pose is from contact."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.subjects.tosses.geometry import gaps_m, geometry_of
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec


def test_box_and_floor():
    geometry = geometry_of(toss_spec(half_m=(0.05, 0.04, 0.03)).compile(), "thing")
    assert len(geometry.geoms) == len(geometry.surroundings) == 1
    assert geometry.radius_m == pytest.approx(np.sqrt(0.05**2 + 0.04**2 + 0.03**2))
    assert geometry.width_m == pytest.approx(0.06)


def test_gap_is_that_of_the_lowest_corner():
    model = toss_spec().compile()
    geometry = geometry_of(model, "thing")
    half = np.pi / 8.0
    quats = np.array([[1.0, 0.0, 0.0, 0.0], [np.cos(half), np.sin(half), 0.0, 0.0]])
    gaps = gaps_m(model, geometry, np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 0.04]]), quats)
    assert gaps == pytest.approx([0.15, 0.04 - 0.05 * np.sqrt(2.0)], abs=1e-6)


@pytest.mark.parametrize(
    ("xml", "says"),
    [
        ("<body name='thing'><geom size='0.1'/></body>", "no free joint"),
        ("<body name='other'><freejoint/><geom size='0.1'/></body>", "no body 'thing'"),
        ("<body name='thing'><freejoint/><geom size='0.1'/></body>", "cannot touch anything"),
    ],
)
def test_refusals_say_what_is_missing(xml, says):
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    with pytest.raises(RecordingError, match=says):
        geometry_of(model, "thing")
