"""What is done to tables of healthy arms, and nothing else is."""

import mujoco
import numpy as np
import pytest

from tests.second_generator.told_otherwise import WAYS, Table

PENDULUM = """
<mujoco><worldbody>
 <body><joint name="hinge" axis="0 1 0"/><geom size="0.05" mass="0.5" pos="0 0 -0.3"/>
  <body pos="0 0 -0.5"><joint name="elbow" axis="0 1 0"/><geom size="0.05" mass="0.2" pos="0 0 -0.2"/></body></body>
</worldbody></mujoco>
"""
JOINTS = {
    "hinge": {"position": "q1", "commanded_torque": "tau1", "sign": -1, "zero": 0.2},
    "elbow": {"position": "q2", "velocity": "v2", "commanded_torque": "tau2", "torque_unit": 2.0},
}
HEADER = ["stamp", "q1", "q2", "v2", "tau1", "tau2"]
OF_TORQUES, OF_POSITIONS = {4, 5}, {1, 2, 3}
CHANGED = {
    "at 50 Hz": None,
    "clock slow": {0},
    "one torque off": {5},
    "one torque scaled": {5},
    "torques crossed": {5},
    "positions filtered": OF_POSITIONS,
    "positions held": OF_POSITIONS,
    "rows held": OF_TORQUES | OF_POSITIONS,
    "rows lost": None,
    "stamps late": {1, 2},
}


def table() -> Table:
    time_s, model = np.arange(0.0, 2.0, 0.004), mujoco.MjModel.from_xml_string(PENDULUM)
    angles = np.stack([0.6 * np.sin(3.0 * time_s), 0.4 * np.cos(5.0 * time_s)], axis=1)
    data, weight = mujoco.MjData(model), np.empty_like(angles)
    for i, data.qpos[:] in enumerate(angles):
        mujoco.mj_forward(model, data)
        weight[i] = data.qfrc_bias
    own = [1e3 * time_s, 0.2 - angles[:, 0], angles[:, 1], -2.0 * np.sin(5.0 * time_s), -weight[:, 0], weight[:, 1] / 2.0]
    return Table(HEADER, np.stack(own, axis=1), JOINTS, 1e-3, model)


@pytest.mark.parametrize("way", sorted(WAYS))
def test_a_way_changes_what_it_says_and_leaves_the_table_whole(way):
    told = table()
    before = told.rows.copy()
    after = WAYS[way](told)
    np.testing.assert_array_equal(told.rows, before)
    assert (np.isfinite(after).all() or way == "torques missing") and after.shape[1] == len(HEADER)
    columns = CHANGED.get(way, OF_TORQUES)
    if columns is not None:
        assert {i for i in range(len(HEADER)) if not np.array_equal(after[:, i], before[:, i])} == columns


def test_rows_that_are_lost_are_those_in_the_middle_and_the_clock_goes_on():
    told = table()
    after = WAYS["rows lost"](told)
    assert len(after) == len(told.rows) - 10 and (np.diff(after[:, 0]) > 0.0).all()
    np.testing.assert_array_equal(after[250:, 1], told.rows[260:, 1])


def test_torques_that_hold_an_arm_are_none_without_gravity():
    np.testing.assert_allclose(WAYS["without gravity"](table())[:, 4:], 0.0, atol=1e-12)
