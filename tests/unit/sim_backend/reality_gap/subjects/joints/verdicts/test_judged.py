"""What was not measured does not count, and is said."""

import shutil

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.nominal import largest_torque_nm, starting_values
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.laws.trajectory import CUTOFF_HZ, EDGE_S, trajectory
from sim_backend.reality_gap.subjects.joints.signs.checks import fault_findings
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.judged import not_judged
from tests.unit.sim_backend.reality_gap.synthetic_arm import MODEL, NAMES, STEP_S, STUDY, arm, motion, recorded, write_csv

SECONDS = 4.0
GAP = slice(500, 1000)
FAR = 0.5 * EDGE_S * CUTOFF_HZ / UnknownRobot.cutoff_hz + 0.01


@pytest.fixture(scope="module")
def moved():
    return motion(3, SECONDS)


def equations(position, **torques) -> EpisodeEquations:
    recording = Recording("made", "made", STEP_S, STEP_S * np.arange(len(position)), JointSignals(NAMES, position, **torques))
    path = trajectory(recording, cutoff_hz=UnknownRobot.cutoff_hz)
    return EpisodeEquations(Plant(arm(), NAMES), path, 0, robot=UnknownRobot())


def with_gap(series, joint, rows=GAP):
    gappy = series.copy()
    gappy[rows, joint] = np.nan
    return gappy


def in_gap(episode) -> np.ndarray:
    return (episode.path.time_s > 1.0 - FAR) & (episode.path.time_s < 2.0 + FAR)


def test_whole_data_count_as_they_did(moved):
    episode = equations(moved[0], measured_torque_nm=moved[1])
    np.testing.assert_array_equal(episode.is_measured, episode.path.valid)
    assert not_judged([episode], NAMES) == []


def test_rows_without_a_joints_torque_do_not_count_at_this_joint(moved):
    episode = equations(moved[0], measured_torque_nm=with_gap(moved[1], 1))
    assert not episode.valid_mechanics[(episode.path.time_s > 1.0) & (episode.path.time_s < 2.0), 1].any()
    np.testing.assert_array_equal(episode.is_measured[:, 0], episode.path.valid[:, 0])
    np.testing.assert_array_equal(episode.is_measured[~in_gap(episode), 1], episode.path.valid[~in_gap(episode), 1])
    (said,) = not_judged([episode], NAMES)
    assert said == "what joint2 does in 35% of the time: its torque, or a position of a joint that it moves with, is missing"


def test_rows_without_a_position_count_at_no_joint_of_the_tree(moved):
    episode = equations(with_gap(moved[0], 1), measured_torque_nm=moved[1])
    assert not episode.valid_mechanics[(episode.path.time_s > 1.0) & (episode.path.time_s < 2.0)].any()
    left = episode.torque_error(JointState(2, starting_values(Plant(arm(), NAMES), 10.0, {})))[episode.valid_mechanics]
    assert np.sqrt(np.mean(left**2)) < 0.02
    assert fault_findings([episode]) == []  # where the line that fills a gap turns off, no encoder jumps
    assert len(not_judged([episode], NAMES)) == 2


def test_a_joint_without_torque_is_named_as_not_judged(moved):
    episode = equations(moved[0], measured_torque_nm=with_gap(moved[1], 1, slice(None)))
    assert not episode.valid_mechanics[:, 1].any()
    assert episode.valid_mechanics[:, 0].any()
    assert np.isfinite(episode.torque_error_floor_nm).all()
    assert not_judged([episode], NAMES) == ["anything about joint2: no torque of it is known"]


def test_one_joint_may_have_what_was_sent_and_another_what_was_measured(moved):
    sent, measured = with_gap(moved[1], 0, slice(None)), with_gap(moved[1], 1, slice(None))
    episode = equations(moved[0], commanded_torque_nm=sent, measured_torque_nm=measured)
    np.testing.assert_array_equal(episode.acting_nm, moved[1].T)
    np.testing.assert_array_equal(episode.driving_nm, moved[1].T)
    assert episode.is_measured.any(axis=0).all()


def test_a_joint_that_rests_is_named_as_not_judged(moved):
    position = moved[0].copy()
    position[:, 0] = 1.0
    (said,) = not_judged([equations(position, measured_torque_nm=moved[1])], NAMES)
    assert said == "anything else about joint1: no time is left in which its motor alone moves it"


def test_a_slow_joint_is_bridged_at_its_own_rate(tmp_path, moved):
    position = moved[0].copy()
    position[np.arange(len(position)) % 5 != 0, 1] = np.nan
    whole, slow = (from_file(tmp_path / name, path, moved[1]) for name, path in (("whole", moved[0]), ("slow", position)))
    assert whole.joints is not None and whole.joints.position_step_s is None
    assert slow.joints is not None and slow.joints.position_step_s is not None
    np.testing.assert_allclose(slow.joints.position_step_s, [STEP_S, 5 * STEP_S])
    start = JointState(2, starting_values(Plant(arm(), NAMES), 10.0, {}))
    errors = []
    for recording in (whole, slow):
        path = trajectory(recording, cutoff_hz=UnknownRobot.cutoff_hz)
        episode = EpisodeEquations(Plant(arm(), NAMES), path, 0, robot=UnknownRobot())
        errors.append(np.sqrt(np.mean(episode.torque_error(start)[episode.valid_mechanics] ** 2)))
        assert episode.path.cutoff_hz == UnknownRobot.cutoff_hz
        assert errors[-1] < 1.5 * np.sqrt(np.mean(episode.torque_error_floor_nm**2))
    assert not_judged([episode], NAMES) == []


def test_what_is_compared_lies_below_what_the_slowest_joint_shows(tmp_path, moved):
    position = moved[0].copy()
    position[np.arange(len(position)) % 25 != 0, 1] = np.nan
    path = trajectory(from_file(tmp_path, position, moved[1]), cutoff_hz=UnknownRobot.cutoff_hz)
    assert path.cutoff_hz == pytest.approx(0.2 / (25 * STEP_S))


def from_file(folder, position, torque) -> Recording:
    folder.mkdir(exist_ok=True)
    write_csv(folder / "r.csv", position, torque)
    (folder / "study.toml").write_text(STUDY)
    shutil.copy(MODEL, folder / "model.xml")
    (recording,) = read_recordings(load_study_file(folder / "study.toml"))
    return recording


def test_samples_far_from_their_neighbours_are_left_out_and_named(tmp_path, moved):
    position, torque = moved[0].copy(), moved[1].copy()
    position[700, 0] += 0.5
    torque[[1200, 1500], 1] = 1e4
    recording = from_file(tmp_path, position, torque)
    assert recording.joints is not None
    assert [(o.channel, o.joint, round(o.time_s, 3)) for o in recording.joints.outliers] == [
        ("position", "joint1", 1.4),
        ("measured torque", "joint2", 2.4),
        ("measured torque", "joint2", 3.0),
    ]
    path = trajectory(recording, cutoff_hz=UnknownRobot.cutoff_hz)
    episode = EpisodeEquations(Plant(arm(), NAMES), path, 0, robot=UnknownRobot())
    assert np.abs(episode.driving_nm).max() < 20.0
    left = episode.torque_error(JointState(2, starting_values(Plant(arm(), NAMES), 10.0, {})))[episode.valid_mechanics]
    assert np.sqrt(np.mean(left**2)) < 1.5 * np.sqrt(np.mean(episode.torque_error_floor_nm**2))
    assert not_judged([episode], NAMES) == [
        "whether the position of joint1 was what it says in r at 1.400 s: far from the samples before and after, and left out",
        "whether the measured torque of joint2 was what it says in r at 2.400 s and 1 more: "
        "far from the samples before and after, and left out",
    ]


def test_an_episode_whose_encoder_jumped_is_compared_as_all_others(moved):
    position = moved[0].copy()
    position[1000:, 0] += 0.1
    study = study_joints(
        arm(), [recorded(position, moved[1]), recorded(*moved)], lambda *_: None, robot=UnknownRobot(), gate=np.inf
    )
    assert [f.effect for f in study.findings] == ["encoder_jump"]
    jumped, other = study.problem.episodes
    assert jumped.path.cutoff_hz == other.path.cutoff_hz == UnknownRobot.cutoff_hz
    channels = [[e.channel for e in episode.equations(study.start, ())] for episode in (jumped, other)]
    assert channels[0] == channels[1]
    assert not any(e.in_windows for e in jumped.equations(study.start, ()))


def test_the_largest_torque_is_one_that_a_motor_can_give(moved):
    torque = moved[1].T.copy()
    assert largest_torque_nm([torque, 0.5 * torque]) == np.abs(torque).max()
    torque[0, 300:302] = 1e4
    assert largest_torque_nm([torque]) < 10.0 * np.abs(moved[1]).max()
    assert largest_torque_nm([np.zeros((2, 50))]) == 0.0
