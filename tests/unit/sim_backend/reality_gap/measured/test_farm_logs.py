"""Recordings from the farm's logs: from what was measured alone."""

from dataclasses import fields

import numpy as np
import pytest

from sim_backend.reality_gap.measured.farm_logs import find_logs, read_farm_logs
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.trifinger import constants as c
from trial_logs import trial_log
from trial_logs.trial_log import MEASURED_TOPICS, TRUTH_TOPICS, LogChannels, TrialLogWriter

STEPS, GAP = 1500, slice(700, 710)
COMMANDS = (0, 400, 900)


def write_log(path, *, truth, steps=STEPS, robot="alpha", commands=COMMANDS, gap=GAP, task=""):
    """A log of noise, the same each time; with or without the channels that only a simulation knows."""
    rng = np.random.default_rng(7)
    position, velocity, torque, desired, applied = rng.standard_normal((5, STEPS, 9))
    cube, quat = rng.standard_normal((STEPS, 3)), rng.standard_normal((STEPS, 4))
    target = rng.standard_normal((len(COMMANDS), 9))
    topics = (*MEASURED_TOPICS, *TRUTH_TOPICS) if truth else MEASURED_TOPICS
    with TrialLogWriter(path, LogChannels(joint_names=c.JOINT_NAMES, frames=(("world", "a"),), topics=topics)) as writer:
        writer.metadata(trial_log.TRIAL_METADATA, {"robot": robot, "task": task, "excitation": "" if task else "standard"})
        for part in (slice(0, gap.start), slice(gap.stop, steps)):
            writer.joint_states(part.start, position[part], velocity[part], torque[part])
            writer.torque(part.start, desired[part], applied[part])
        for number, step in enumerate(commands):
            writer.command(step, desired[step], target[number] if number else None)
        for step in range(0, steps - 200, 100):
            writer.tracked_pose(step, step + 90, cube[step] + 0.01, quat[step], 0.5)
        if truth:
            every = np.arange(0, steps, 10)
            writer.cube_pose(every, cube[every], quat[every])
            writer.true_joint_states(every, position[every] + 1.0, velocity[every] + 1.0, torque[every] + 1.0)
            writer.motors(0, np.full(9, 20.0))
            writer.event(100, "encoder jumps", topic=trial_log.TRUE_EVENTS)
    return position, velocity, torque, desired, applied, target


def read(path):
    return read_farm_logs([path], lambda *_: None)[0]


def assert_same(first, second):
    """Every array of two recordings, bit for bit."""
    for one, other in ((first.joints, second.joints), *zip(first.objects, second.objects, strict=True), (first, second)):
        for field in fields(one):
            a, b = getattr(one, field.name), getattr(other, field.name)
            if isinstance(a, np.ndarray):
                assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
            elif field.name not in ("joints", "objects"):
                assert a == b, field.name


def test_the_truth_in_a_file_changes_nothing(tmp_path):
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    for folder, truth in (("with", True), ("without", False)):
        write_log(tmp_path / folder / "log.mcap", truth=truth)
    with_truth, without = (tmp_path / folder / "log.mcap" for folder in ("with", "without"))
    assert b"/truth/joint_states" in with_truth.read_bytes()
    assert b"/truth/" not in without.read_bytes()
    assert_same(read(with_truth), read(without))


def test_a_recording_holds_what_was_measured_with_gaps_as_nan(tmp_path):
    path = tmp_path / "log.mcap"
    position, velocity, torque, desired, applied, target = write_log(path, truth=True)
    found = read(path)
    joints = found.joints
    assert joints is not None
    known = np.ones(STEPS, bool)
    known[GAP] = False
    for series, expected in (
        (joints.position_rad, position),
        (joints.velocity_rad_s, velocity),
        (joints.measured_torque_nm, torque),
        (joints.commanded_torque_nm, applied),
    ):
        np.testing.assert_array_equal(series[known], expected[known])
        assert np.isnan(series[~known]).all()
    for number, (first, last) in enumerate(zip(COMMANDS, (*COMMANDS[1:], STEPS), strict=True)):
        np.testing.assert_array_equal(joints.desired_torque_nm[first:last], np.tile(desired[first], (last - first, 1)))
        wanted = target[number] if number else np.full(9, np.nan)
        np.testing.assert_array_equal(joints.position_target_rad[first:last], np.tile(wanted, (last - first, 1)))
    assert (found.name, found.source, found.regime, found.step_s) == ("log", "log.mcap", "standard", 1e-3)
    assert found.duration_s == pytest.approx(1.5)
    assert found.objects[0].delivery_s is not None
    assert found.objects[0].delivery_s - found.objects[0].time_s == pytest.approx(np.full(13, 0.09))


def test_a_policys_log_has_torques_without_targets(tmp_path):
    path = tmp_path / "log.mcap"
    desired = write_log(path, truth=False, commands=())[3]
    joints = read(path).joints
    assert joints is not None
    np.testing.assert_array_equal(joints.desired_torque_nm[:700], desired[:700])
    assert np.isnan(joints.position_target_rad).all()


def test_files_that_cannot_be_used_are_named(tmp_path):
    with pytest.raises(RecordingError, match="has no logs"):
        find_logs(tmp_path)
    short = tmp_path / "short.mcap"
    write_log(short, truth=False, steps=900)
    with pytest.raises(RecordingError, match=r"short.mcap holds 890 joint states; a study needs at least 1000"):
        read(short)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(short.read_bytes()[:-500])
    with pytest.raises(RecordingError, match=r"broken.mcap .*fetch it again"):
        read(broken)


def test_a_folder_is_of_one_robot_and_truth_files_are_left_out(tmp_path):
    for name in "ab":
        write_log(tmp_path / f"{name}.mcap", truth=False)
    (tmp_path / "a.truth.mcap").write_bytes(b"")
    logs = find_logs(tmp_path)
    assert ([path.name for path in logs.judged], logs.trials, logs.robot) == (["a.mcap", "b.mcap"], (), "alpha")
    write_log(tmp_path / "c.mcap", truth=False, robot="beta")
    with pytest.raises(RecordingError, match=r"of 2 robots \(alpha, beta\)"):
        find_logs(tmp_path)


def test_trials_are_left_out_whichever_robot_they_are_of(tmp_path):
    write_log(tmp_path / "trial-000.mcap", truth=False, robot="beta", task="push")
    with pytest.raises(RecordingError, match=r"trial-000.mcap is the log of a trial, .*--trials"):
        find_logs(tmp_path)
    write_log(tmp_path / "trial-001.mcap", truth=False, robot="gamma", task="push")
    with pytest.raises(RecordingError, match=r"the 2 logs are of trials, .*--trials"):
        find_logs(tmp_path)
    write_log(tmp_path / "standard.mcap", truth=False)
    logs = find_logs(tmp_path)
    assert ([path.name for path in logs.judged], len(logs.trials), logs.robot) == (["standard.mcap"], 2, "alpha")
