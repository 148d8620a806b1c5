"""The log: complete, readable by the mcap package, and recoverable up to the last flush."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from trial_logs import trial_log
from trial_logs.block_writer import BlockWriter
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
    assert message.one(np.array([1.0, 2.0]), 0) == np.array([1.0, 2.0]).tobytes()
    with pytest.raises(ValueError, match="within 0 and 127 s"):
        FixedMessage(encode_pose, 7).rows(np.zeros((1, 7)), np.array([128 * 10**9]))


def test_rows_in_blocks_are_the_messages_one_by_one(tmp_path):
    """Written at once or each alone, and whatever was flushed when: a reader finds the same messages, and the sums agree."""
    rng, channels = np.random.default_rng(1), LogChannels(joint_names=NAMES, frames=FRAMES)
    values, times_ns = rng.standard_normal((40, 27)), np.arange(40) * 1_000_000
    encoded = [channels.fixed[trial_log.JOINT_STATES].one(row, int(at)) for row, at in zip(values, times_ns, strict=True)]
    paths = [tmp_path / name for name in ("rows.mcap", "single.mcap")]
    with BlockWriter(paths[0], channels.topics) as writer:
        for part in (slice(0, 25), slice(25, 25), slice(25, 40)):
            writer.rows(
                trial_log.JOINT_STATES, channels.fixed[trial_log.JOINT_STATES].rows(values[part], times_ns[part]), times_ns[part]
            )
            writer.flush()
    with BlockWriter(paths[1], channels.topics) as writer:
        for each, at in zip(encoded, times_ns.tolist(), strict=True):
            writer.message(trial_log.JOINT_STATES, each, at)
        writer.metadata("about", {"key": "value"})
        writer.attach("file.bin", "application/octet-stream", b"\x00\x01")
    found = []
    for path in paths:
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            found.append([(m.sequence, m.log_time, m.publish_time, m.data) for _, _, m in reader.iter_messages()])
            summary = reader.get_summary()
            assert summary.statistics.message_count == summary.statistics.channel_message_counts[1] == 40
            assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, 39_000_000)
    assert found[0] == found[1] == [(i, int(at), int(at), encoded[i]) for i, at in enumerate(times_ns)]
    with paths[1].open("rb") as stream:
        reader = make_reader(stream)
        assert [(each.name, each.metadata) for each in reader.iter_metadata()] == [("about", {"key": "value"})]
        assert [(each.name, each.data) for each in reader.iter_attachments()] == [("file.bin", b"\x00\x01")]


def test_a_log_is_never_written_over(tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(b"kept")
    with pytest.raises(FileExistsError):
        TrialLogWriter(path, LogChannels(joint_names=NAMES, frames=FRAMES))
    assert path.read_bytes() == b"kept"
