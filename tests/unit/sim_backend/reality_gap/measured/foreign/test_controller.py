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


@pytest.mark.parametrize(("sign", "unit"), [(1, 1.0), (-1, 180.0 / np.pi)])
def test_a_velocity_target_is_part_of_what_was_sent(tmp_path, torque, sign, unit):
    rows = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    follows = 0.3 * np.sin(np.arange(len(rows)) / 40.0)
    table = np.column_stack([rows, unit * follows])
    header = "time,q1,q2,v1,v2,target1,target2,target_v1"
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    more = f'"q1"\nvelocity_target = "target_v1"\nvelocity_target_unit = {1.0 / unit}\nsign = {sign}'
    sent = signals(tmp_path, STUDY.replace('"q1"', more) + CONTROLLER).commanded_torque_nm
    np.testing.assert_allclose(sent[:, 0], sign * (torque[:, 0] + DAMPING * follows), atol=1e-9)
    np.testing.assert_allclose(sent[:, 1], torque[:, 1], atol=1e-9)


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


def recorded_beside(folder, torque, shares):
    """Signals of recordings in which the first joint's motor gave such a share of what its controller's law is."""
    rows = np.loadtxt(folder / "r.csv", delimiter=",", skiprows=1)
    for i, share in enumerate(shares):
        measured = share * torque[:, 0]
        header = "time,q1,q2,v1,v2,target1,target2,tau1"
        np.savetxt(
            folder / f"r{i}.csv", np.column_stack([rows, measured]), delimiter=",", header=header, comments="", fmt="%.17g"
        )
    study = STUDY.replace("r.csv", "r[0-9].csv").replace('"q1"', '"q1"\nmeasured_torque = "tau1"') + CONTROLLER
    (folder / "study.toml").write_text(study)
    return [recording.joints for recording in read_recordings(load_study_file(folder / "study.toml"))]


@pytest.mark.parametrize(("shares", "holds"), [((1.0, 1.0), True), ((0.75, 0.75), False), ((1.0, 0.6), False)])
def test_a_controller_that_does_not_make_the_recorded_torque_is_known_in_no_recording(tmp_path, torque, shares, holds):
    for found in recorded_beside(tmp_path, torque, shares):
        assert found is not None and found.feedback is not None
        assert found.feedback.is_known.tolist() == [holds, True]
        assert set(found.unlike_law) == (set() if holds else {"joint1"})


def test_a_recording_in_which_a_joint_does_hardly_anything_does_not_refute_its_controller(tmp_path, torque):
    rows = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    rests = rows.copy()
    rests[:, [1, 3]], rests[:, 5] = rows[0, 1], rows[0, 1]
    study = STUDY.replace("r.csv", "r[0-9].csv").replace('"q1"', '"q1"\nmeasured_torque = "tau1"') + CONTROLLER
    rng = np.random.default_rng(0)
    for i, (each, sent) in enumerate(((rows, torque[:, 0]), (rests, 0.0 * torque[:, 0]))):
        measured = sent + 0.01 * rng.standard_normal(len(torque))
        header = "time,q1,q2,v1,v2,target1,target2,tau1"
        np.savetxt(
            tmp_path / f"r{i}.csv", np.column_stack([each, measured]), delimiter=",", header=header, comments="", fmt="%.17g"
        )
    (tmp_path / "study.toml").write_text(study)
    for recording in read_recordings(load_study_file(tmp_path / "study.toml")):
        assert recording.joints is not None and recording.joints.feedback is not None and recording.joints.unlike_law == {}


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
