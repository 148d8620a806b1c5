"""Positions and targets of a stated controller are as good as torques."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from tests.unit.sim_backend.reality_gap.synthetic_arm import MODEL, STEP_S, arm, motion

STIFFNESS, DAMPING = {"joint1": 20.0, "joint2": 10.0}, 0.5
STUDY = f"""
model = "{MODEL}"
time = "time"
[[recording]]
file = "r.csv"
[joints.joint1]
position = "q1"
position_target = "target1"
[joints.joint2]
position = "q2"
position_target = "target2"
"""
CONTROLLER = """
[controller]
kind = "pd"
stiffness = { joint1 = 20.0, joint2 = 10.0 }
damping = 0.5
"""


@pytest.fixture
def torque(tmp_path):
    """What a controller sends that leads the arm along a motion; the file has positions and targets alone."""
    position, torque = motion(5, 3.0)
    velocity = np.gradient(position, STEP_S, axis=0)
    target = position + (torque + DAMPING * velocity) / np.array(list(STIFFNESS.values()))
    rows = np.column_stack([STEP_S * np.arange(len(position)), position, velocity, target])
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header="time,q1,q2,v1,v2,target1,target2", comments="", fmt="%.17g")
    return torque


def signals(folder, study=STUDY + CONTROLLER):
    (folder / "study.toml").write_text(study)
    (recording,) = read_recordings(load_study_file(folder / "study.toml"))
    return recording.joints


def test_the_torque_that_was_sent_follows_from_position_and_target(tmp_path, torque):
    for study in (STUDY + CONTROLLER, STUDY.replace('"q1"', '"q1"\nvelocity = "v1"') + CONTROLLER):
        np.testing.assert_allclose(signals(tmp_path, study).commanded_torque_nm, torque, atol=1e-9)


@pytest.mark.parametrize(("stated", "on_board"), [("", False), ("on_board = true", True)])
def test_a_controller_is_on_board_where_the_file_says_so(tmp_path, torque, stated, on_board):
    assert signals(tmp_path, STUDY + CONTROLLER + stated).feedback.is_on_board.tolist() == [on_board] * torque.shape[1]
    assert load_study_file(tmp_path / "study.toml").on_board == (("joint1", "joint2") if on_board else ())


def test_torque_is_limited_as_stated_and_counts_in_the_models_direction(tmp_path, torque):
    limited = signals(tmp_path, STUDY + CONTROLLER + "torque_limit = { joint1 = 1.5 }").commanded_torque_nm
    np.testing.assert_allclose(limited, np.column_stack([np.clip(torque[:, 0], -1.5, 1.5), torque[:, 1]]), atol=1e-9)
    turned = signals(tmp_path, STUDY.replace('"q1"', '"q1"\nsign = -1') + CONTROLLER).commanded_torque_nm
    np.testing.assert_allclose(turned, torque * [-1.0, 1.0], atol=1e-9)


def test_a_torque_that_was_recorded_stands(tmp_path, torque):
    found = signals(tmp_path, STUDY.replace('"q1"', '"q1"\nmeasured_torque = "v1"') + CONTROLLER)
    assert np.isnan(found.commanded_torque_nm[:, 0]).all()
    np.testing.assert_allclose(found.commanded_torque_nm[:, 1], torque[:, 1], atol=1e-9)


@pytest.mark.parametrize(("share", "is_as_stated"), [(1.0, True), (0.75, False)])
def test_a_controller_that_does_not_make_the_recorded_torque_is_not_known(tmp_path, torque, share, is_as_stated):
    rows = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    rows = np.column_stack([rows, share * torque[:, 0]])
    header = "time,q1,q2,v1,v2,target1,target2,tau1"
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    found = signals(tmp_path, STUDY.replace('"q1"', '"q1"\nmeasured_torque = "tau1"') + CONTROLLER)
    assert found.feedback.is_known.tolist() == [is_as_stated, True]
    assert found.unlike_law == ({} if is_as_stated else {"joint1": pytest.approx(1 / 3, abs=0.02)})


def test_a_study_of_positions_and_targets_is_no_longer_refused(tmp_path, torque):
    (tmp_path / "study.toml").write_text(STUDY + CONTROLLER)
    recordings = read_recordings(load_study_file(tmp_path / "study.toml"))
    study = study_joints(arm(), recordings, lambda *_: None, robot=UnknownRobot(), gate=np.inf)
    (episode,) = study.problem.episodes
    left = episode.torque_error(study.start)[episode.valid_mechanics]
    assert np.sqrt(np.mean(left**2)) < 1.5 * np.sqrt(np.mean(episode.torque_error_floor_nm**2 + 0.005**2 * 2 * 12.0 * STEP_S))


def test_a_joint_without_its_gains_is_refused(tmp_path, torque):
    with pytest.raises(RecordingError, match=r"joint2.*stiffness and damping of this joint"):
        signals(tmp_path, STUDY + CONTROLLER.replace("damping = 0.5", "damping = { joint1 = 0.5 }"))
