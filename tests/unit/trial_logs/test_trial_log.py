"""The log: complete, readable by the mcap package, and recoverable up to the last flush."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from trial_logs import trial_log
from trial_logs.fixed_message import FixedMessage
from trial_logs.messages import encode_pose
from trial_logs.reader import read_log
from trial_logs.trial_log import LogChannels, TrialLogWriter

NAMES = tuple(f"joint{j}" for j in range(9))
FRAMES = (("world", "a"), ("a", "b"))


def test_every_message_is_read_back_as_written(tmp_path):
    rng = np.random.default_rng(0)
    position, velocity, torque, desired = rng.standard_normal((4, 300, 9))
    cube, quat = rng.standard_normal((30, 3)), rng.standard_normal((30, 4))
    cube[0] = 0.0  # zeros must survive: protobuf leaves them out when it can
    path = tmp_path / "log.mcap"
    with TrialLogWriter(path, LogChannels(joint_names=NAMES, frames=FRAMES)) as writer:
        writer.metadata(trial_log.TRIAL_METADATA, {"job_id": "j", "seed": 3})
        writer.joint_states(0, position, velocity, torque)
        writer.torque(0, desired, torque)
        writer.cube_pose(np.arange(0, 300, 10), cube, quat)
        writer.goal(cube[1], quat[1])
        writer.tracked_pose(-100, -10, cube[2], quat[2], 1.0)
        writer.tracked_pose(100, 190, cube[3], quat[3], 0.5)
    log = read_log(str(path))
    np.testing.assert_array_equal(log.joint_position_rad, position)
    np.testing.assert_array_equal(log.joint_velocity_rad_s, velocity)
    np.testing.assert_array_equal(log.measured_torque_nm, torque)
    np.testing.assert_array_equal(log.desired_torque_nm, desired)
    np.testing.assert_array_equal(log.cube_position_world_m, cube)
    np.testing.assert_array_equal(log.cube_quat_wxyz, quat)
    np.testing.assert_array_equal(log.joint_steps, np.arange(300))
    assert log.capture_s.tolist() == [-0.1, 0.1]
    assert log.delivery_s.tolist() == [-0.01, 0.19]
    assert log.confidence.tolist() == [1.0, 0.5]
    assert log.metadata == {"job_id": "j", "seed": "3"}


def test_time_stamps_inside_messages_are_the_log_times(short_log):
    from mcap_protobuf.decoder import DecoderFactory

    with short_log.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, message, decoded in reader.iter_decoded_messages(topics=[trial_log.JOINT_STATES]):
            assert decoded.timestamp.seconds * 10**9 + decoded.timestamp.nanos == message.log_time


def test_a_killed_writer_loses_only_what_was_not_flushed(tmp_path):
    path = tmp_path / "log.mcap"
    writer = TrialLogWriter(path, LogChannels(joint_names=NAMES, frames=FRAMES))
    rows = np.zeros((250, 9))
    writer.joint_states(0, rows, rows, rows)
    writer.flush()
    writer.joint_states(250, rows, rows, rows)
    survived = path.read_bytes()  # what a kill at this moment would leave
    writer.__exit__(None, None, None)
    found = 0
    (tmp_path / "cut.mcap").write_bytes(survived)
    with (tmp_path / "cut.mcap").open("rb") as stream:
        try:
            for record in StreamReader(stream, record_size_limit=None).records:
                found += type(record).__name__ == "Message"
        except Exception as error:  # the cut end of the file reads as garbage
            assert found, error
    assert found >= 250


def test_fixed_message_refuses_times_it_cannot_hold():
    message = FixedMessage(lambda values: np.array(values).tobytes(), 2)
    assert message.rows(np.array([[1.0, 2.0]]), np.array([0])) == [np.array([1.0, 2.0]).tobytes()]
    with pytest.raises(ValueError, match="within 0 and 127 s"):
        FixedMessage(encode_pose, 7).rows(np.zeros((1, 7)), np.array([128 * 10**9]))
