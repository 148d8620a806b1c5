"""Equalities of a model that recorded joints move are refused, since a study leaves them out."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.recording import RecordingError

LINKAGE = """
<mujoco>
  <worldbody>
    <body name="arm"><joint name="shoulder" axis="0 1 0"/><geom size="0.1"/>
      <body name="fore"><joint name="elbow" axis="0 1 0"/><geom size="0.1"/><site name="tip"/>
        <body name="left"><joint name="finger1" type="slide"/><geom size="0.1"/></body>
        <body name="right"><joint name="finger2" type="slide"/><geom size="0.1"/></body>
      </body>
    </body>
    <body name="rod"><joint name="crank" axis="0 1 0"/><geom size="0.1"/><site name="end"/></body>
  </worldbody>
  <tendon>
    <fixed name="of_arm"><joint joint="shoulder" coef="1"/></fixed>
    <fixed name="of_crank"><joint joint="crank" coef="1"/></fixed>
    <fixed name="of_finger"><joint joint="finger1" coef="1"/></fixed>
  </tendon>
  <equality>{equality}</equality>
</mujoco>
"""
STUDY = """
model = "model.xml"
time = "time"
[[recording]]
file = "data.csv"
[joints.shoulder]
position = "q"
torque = "tau"
torque_kind = "measured"
"""


def load(folder, equality):
    (folder / "model.xml").write_text(LINKAGE.format(equality=equality))
    (folder / "data.csv").write_text("time,q,tau\n")
    (folder / "study.toml").write_text(STUDY)
    return load_study_file(folder / "study.toml")


@pytest.mark.parametrize(
    "equality",
    [
        '<joint name="mimic" joint1="elbow" joint2="shoulder"/>',
        '<connect name="loop" body1="fore" body2="rod" anchor="0 0 0"/>',
        '<weld name="closed" site1="tip" site2="end"/>',
        '<tendon name="belt" tendon1="of_arm" tendon2="of_crank"/>',
    ],
)
def test_a_linkage_that_a_recorded_joint_moves_is_refused(tmp_path, equality):
    with pytest.raises(RecordingError, match=r"(mimic|loop|closed|belt), which shoulder moves"):
        load(tmp_path, equality)


# A finger that follows another, and the model that the refusal asks for in its place.
FINGERS = """
<mujoco><worldbody><body name="left"><joint name="left" type="slide" damping="{damping}" armature="{armature}"/>
  <geom size="0.01" mass="0.05" contype="0"/></body>
  <body name="right">{follower}<geom size="0.01" mass="0.05" contype="0"/></body></worldbody>
  <equality>{equality}</equality></mujoco>
"""
FOLLOWER = '<joint name="right" type="slide" damping="3" armature="0.2"/>'
FOLLOWS = '<joint name="mimic" joint1="right" joint2="left" polycoef="0 0.5 0 0 0" solimp="0.999 0.9999 1e-6" solref="0.002 1"/>'


def test_what_a_refused_follower_is_to_be_written_as_moves_as_it_does(tmp_path):
    with pytest.raises(RecordingError, match="mimic, which shoulder moves") as refused:
        load(tmp_path, '<joint name="mimic" joint1="elbow" joint2="shoulder"/>')
    assert "add its mass" in str(refused.value) and "times the square of the ratio" in str(refused.value)
    linked = mujoco.MjModel.from_xml_string(FINGERS.format(damping=2, armature=0.1, follower=FOLLOWER, equality=FOLLOWS))
    written = FINGERS.format(damping=2 + 3 * 0.25, armature=0.1 + (0.05 + 0.2) * 0.25, follower="", equality="")
    ends = []
    for model in (linked, mujoco.MjModel.from_xml_string(written)):
        model.opt.timestep, model.opt.gravity[:], data = 5e-4, 0.0, mujoco.MjData(model)
        for row in range(1000):
            data.qfrc_applied[0] = 2.0 * np.sin(0.01 * row)
            mujoco.mj_step(model, data)
        ends.append(data.qpos[0])
    assert ends[1] == pytest.approx(ends[0], rel=0.01) and abs(ends[1]) > 0.01


@pytest.mark.parametrize(
    "equality",
    [
        '<joint joint1="finger1" joint2="finger2"/>',
        '<connect body1="left" body2="right" anchor="0 0 0"/>',
        '<tendon tendon1="of_crank" tendon2="of_finger"/>',
        '<joint joint1="elbow" joint2="shoulder" active="false"/>',
    ],
)
def test_what_no_recorded_joint_moves_and_what_is_off_is_left_out(tmp_path, equality):
    assert [joint.name for joint in load(tmp_path, equality).joints] == ["shoulder"]
