"""A farm with physics from a file: what was set is what the logs show."""

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.farm import Farm
from trial_logs.reader import read_log

TRACKER = """
[tracking_latency]
extra_s = 0.03
[tracking_jitter]
std_s = 0.004
[tracking_dropout]
probability = 0.1
duration_s = 0.1
[tracking_noise]
position_m = 0.002
rotation_rad = 0.02
[orientation_jumps]
probability = 0.02
growth = 1.0
[occlusion_by_fingers]
strength = 1.0
[encoder_quantisation]
step_rad = 0.002
"""
JUMPED_RAD = 0.5


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> list:
    """Logs of a cube that rests while the fingers hold poses, and of one that is pushed."""
    folder = tmp_path_factory.mktemp("set")
    (folder / "slow-tracker.toml").write_text(TRACKER)
    with Farm(folder / "farm", robots=1, more=("--physics", str(folder / "slow-tracker.toml"))) as farm:
        assert farm.json("status")["physics"] == "file:slow-tracker"
        more = ("--excitation", "hold_poses", "--excitation", "slide_cube")
        farm.json("identify", "--robot", "any", *more, "--to", str(folder / "logs"), "--wait")
    return [read_log(path) for path in sorted(Path(folder / "logs").glob("*.mcap"))]


def resting(logs: list) -> list:
    return [log for log in logs if log.metadata["excitation"] == "hold_poses"]


def test_rate_latency_and_dropout(logs):
    gaps = np.concatenate([np.diff(log.capture_s) for log in logs])
    frames = np.rint(gaps / 0.1)
    assert gaps == pytest.approx(0.1 * frames), "images are taken ten times a second"
    lost = 1 - len(frames) / frames.sum()
    assert lost == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / frames.sum()))
    latency_s = np.concatenate([(log.delivery_s - log.capture_s)[log.capture_s > 0] for log in logs])
    assert latency_s.mean() == pytest.approx(0.12, abs=4 * 0.004 / np.sqrt(len(latency_s)) + 0.0005)
    assert latency_s.std() == pytest.approx(0.004, rel=4 / np.sqrt(2 * len(latency_s)))


def test_noise_and_jumps_of_a_resting_cube(logs):
    errors, jumps = [], []
    for log in resting(logs):
        sure = log.confidence >= 0.75
        position = log.tracked_position_world_m[sure]
        errors.append(position - np.median(position, axis=0))
        cosine = np.abs(log.tracked_quat_wxyz[sure] @ np.median(log.tracked_quat_wxyz[sure], axis=0))
        jumps.append(2 * np.arccos(np.minimum(cosine, 1.0)) > JUMPED_RAD)
    noise, jumped = np.concatenate(errors), np.concatenate(jumps)
    assert noise.std() == pytest.approx(0.002, rel=5 / np.sqrt(2 * noise.size))
    assert jumped.mean() == pytest.approx(0.02, abs=4 * np.sqrt(0.02 / len(jumped)))


def test_fingers_hide_faces_and_confidence_says_so(logs):
    confidence = np.concatenate([log.confidence for log in logs])
    assert 0.2 < confidence.min() < 0.97 and confidence.max() <= 1.0  # goals are drawn: how much is hidden differs


def test_encoders_count_in_steps(logs):
    counts = logs[0].joint_position_rad / 0.002
    assert np.abs(counts - np.rint(counts)).max() < 1e-6
