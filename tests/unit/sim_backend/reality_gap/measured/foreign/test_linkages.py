"""Equalities of a model that recorded joints move are refused, since a study leaves them out."""

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
