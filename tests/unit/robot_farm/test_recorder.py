"""What the recorder makes of a trial: blocks by the clock and by their size, and a log that is the same however it was cut."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from robot_farm.recorder import Recorder
from robot_farm.trial import measured_channels
from robot_farm.truth import truth_channels
from sim_backend.driver.driver import Command, Segment
from sim_backend.driver.tracker import TrackedPose
from sim_backend.tasks.task import Goal
from trial_logs import trial_log
from trial_logs.trial_log import TrialLogWriter

TRIAL_STEPS, REPORT_STEPS = 2400, 100
NO_GOAL = Goal(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 9)))


def tracked(capture_step, delivery_step, x_m):
    position, quat, sure = np.array([[x_m, 0.0, 0.03]]), np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([0.9])
    faces = np.zeros((1, 3, 6), bool)
    return TrackedPose(np.array([capture_step]), np.array([delivery_step]), position, quat, sure, position, quat, sure, faces)


def segment(first_step, steps):
    joints = np.tile((first_step + np.arange(steps))[None, :, None] * 1e-4, (1, 1, 9))
    pose = np.zeros((1, steps, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (1, steps, 1))
    return Segment(first_step, *([joints] * 8), *pose)


def recorded(folder, period_s, steps=20):
    """A log and a truth file of a trial whose periods have so many steps and take so long; how often the log was flushed."""
    flushes = []
    folder.mkdir()
    with (
        TrialLogWriter(folder / "log.mcap", measured_channels()) as writer,
        TrialLogWriter(folder / "truth.mcap", truth_channels()) as truth,
    ):
        flush = writer.flush
        writer.flush = lambda: (flushes.append(1), flush())
        now_s = [0.0]
        with Recorder(writer, truth, clock=lambda: now_s[0]) as recorder:
            recorder.begin(None, NO_GOAL, tracked(-30, 0, 0.0))
            for k, first in enumerate(range(0, TRIAL_STEPS, steps)):
                now_s[0] = k * period_s
                reports = [tracked(first - 40, first + 5, 1e-5 * first)] if first % REPORT_STEPS == 0 and first else []
                recorder.record_command(Command(np.zeros((1, 9))), segment(first, steps), reports, np.full(9, float(k)))
    return len(flushes)


def messages(path, topic):
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(message.log_time // 10**6, decoded) for _, _, message, decoded in reader.iter_decoded_messages(topics=[topic])]


@pytest.mark.parametrize(("period_s", "flushes"), [(1e-3, 3), (0.1, 40), (0.3, 120)], ids=["fast", "slow", "very slow"])
def test_blocks_are_as_large_as_the_robots_pace_lets_them(period_s, flushes, tmp_path):
    assert recorded(tmp_path / "trial", period_s) == pytest.approx(flushes, abs=1)


@pytest.mark.parametrize("steps", [1, 5, 20])
def test_a_log_is_the_same_however_it_was_cut_into_blocks(steps, tmp_path):
    for name, period_s in (("fast", 1e-3), ("slow", 0.3)):
        recorded(tmp_path / name, period_s, steps)
    topics = {"log.mcap": trial_log.MEASURED_TOPICS, "truth.mcap": trial_log.TRUTH_TOPICS}
    told = 0
    for file, channels in topics.items():
        for topic in (channel for channel in channels if channel != trial_log.TRACKER):
            fast, slow = (messages(tmp_path / name / file, topic) for name in ("fast", "slow"))
            assert [(at, str(decoded)) for at, decoded in fast] == [(at, str(decoded)) for at, decoded in slow], topic
            told += len(fast)
    assert told > 2 * TRIAL_STEPS


def test_the_tracked_object_moves_when_its_report_comes_and_not_before(tmp_path):
    recorded(tmp_path / "trial", 1e-3)
    moving = [
        (at, decoded.transforms[9].translation.x)
        for at, decoded in messages(tmp_path / "trial" / "log.mcap", trial_log.MEASURED_TRANSFORMS)
        if len(decoded.transforms) == 10
    ]
    assert len(moving) == TRIAL_STEPS // 40
    for at, x_m in moving:
        reported = max(0, (at - 5) // REPORT_STEPS * REPORT_STEPS)
        assert x_m == pytest.approx(1e-5 * reported), f"at {at} ms"


def test_temperatures_are_written_four_times_a_second(tmp_path):
    recorded(tmp_path / "trial", 1e-3)
    found = messages(tmp_path / "trial" / "truth.mcap", trial_log.MOTORS)
    assert [at for at, _ in found] == [260, 500, 760, 1000, 1260, 1500, 1760, 2000, 2260]
    assert [decoded.temperature_rise_k[0] for _, decoded in found] == [at // 20 - 1 for at, _ in found]
