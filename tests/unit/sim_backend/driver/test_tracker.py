"""The tracker on a cube at rest, in motion and in a grasp: what is measured of its reports is what was set."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2, norm

from sim_backend.driver.detection import DROPOUT, confidence_of, hidden_faces
from sim_backend.driver.driver import Measurement, Segment
from sim_backend.driver.tracker import TrackedPose, Tracker, filtered
from sim_backend.driver.visibility import FACES, look
from sim_backend.effects import noise
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.physics import Physics
from sim_backend.effects.pose_errors import CUBE_TURNS_WXYZ
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad
from sim_backend.trifinger.objects import shape_of
from tests.unit.sim_backend.effects.rig import present

TAILS = 1e-6
"""Probability that a limit is left by chance; the limits follow from it and the number of reports."""
REST_M, REST_WXYZ = np.array([0.01, 0.02, 0.0325]), np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
UPRIGHT = np.tile([0.0, 0.9, -1.7], 3)
POSES = ("cube_position_world_m", "cube_quat_wxyz")


def grasp(position_m) -> np.ndarray:
    """Joint positions with the three tips on three faces of an upright cube, shape (9,)."""
    reach = c.CUBE_WIDTH_M / 2 + c.TIP_RADIUS_M
    tips = np.asarray(position_m) + reach * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
    joints = joint_position_rad(tips.reshape(9))
    assert (joints > c.SOFT_LIMIT_LOWER_RAD).all() and (joints < c.SOFT_LIMIT_UPPER_RAD).all()
    return joints


def segment(first, steps, n=1, joints=UPRIGHT, position=REST_M, quat=REST_WXYZ) -> Segment:
    """``n`` robots for some steps; arguments are one state, or one for each step."""

    def rows(value, width):
        return np.ascontiguousarray(np.broadcast_to(value, (n, steps, width)))

    q, none = rows(joints, 9), np.zeros((n, steps, 9))
    return Segment(first, q, none, none, none, none, none, q, none, rows(position, 3), rows(quat, 4))


def start(part: Segment) -> Measurement:
    first = {field.name: getattr(part, field.name)[:, 0] for field in fields(Segment) if field.name != "first_step"}
    measured = {"joint_torque_nm": first["measured_torque_nm"], **first}
    return Measurement(**{field.name: measured[field.name] for field in fields(Measurement)})


def reports(values=None, *, n=1, seconds=10.0, seed=7, block=20, physics=None, shape=None, **state) -> list[TrackedPose]:
    """Everything that is reported in this time, after the report at the start."""
    physics = physics or Physics.of(n, values or {})
    tracker = Tracker(physics=physics, **({"shape": shape} if shape else {}))
    tracker.reset(start(segment(0, block, n, **state)), seed + np.arange(n))
    out = []
    for first in range(0, round(seconds * 1000), block):
        tracker.capture(segment(first, block, n, **state))
        out += tracker.deliver(first + block)
    return out


def column(found: list[TrackedPose], name: str) -> np.ndarray:
    """A field of all reports of robot 0, shape (reports, ...)."""
    return np.array([getattr(report, name)[0] for report in found])


def std_within(sample, std) -> bool:
    """Whether a sample's standard deviation is what it should be, within the limits that its size allows."""
    low, high = std * np.sqrt(chi2.ppf([TAILS / 2, 1 - TAILS / 2], len(sample) - 1) / (len(sample) - 1))
    return low < np.std(sample, ddof=1) < high


def mean_within(sample, mean, std) -> bool:
    return abs(np.mean(sample) - mean) < norm.ppf(1 - TAILS / 2) * std / np.sqrt(len(sample))


def count_within(count, n, probability) -> bool:
    return binom.ppf(TAILS / 2, n, probability) <= count <= binom.ppf(1 - TAILS / 2, n, probability)


def jumped(found: list[TrackedPose], quat=REST_WXYZ, limit_rad=0.7) -> np.ndarray:
    """Which reports have an orientation that is not the cube's."""
    true = Rotation.from_quat(np.roll(quat, -1))
    raw = Rotation.from_quat(np.roll(column(found, "raw_quat_wxyz"), -1, axis=1))
    return (true.inv() * raw).magnitude() > limit_rad


def test_a_nominal_tracker_reports_the_true_pose_at_10_hz_and_90_ms_late():
    rng = np.random.default_rng(1)
    position, quat = rng.normal(size=(2000, 3)) * 0.05, rng.normal(size=(2000, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    tracker = Tracker()
    first = tracker.reset(start(segment(0, 20, position=position[:20], quat=quat[:20])))
    assert first.capture_step.tolist() == [-100] and first.delivery_step.tolist() == [-10]
    for step in range(0, 2000, 20):
        tracker.capture(segment(step, 20, position=position[step : step + 20], quat=quat[step : step + 20]))
        for report in tracker.deliver(step + 20):
            frame = int(report.capture_step[0])
            assert frame % 100 == 0 and report.delivery_step.tolist() == [frame + 90]
            for name in ("cube_position_world_m", "raw_position_world_m"):
                assert getattr(report, name)[0].tobytes() == position[frame].tobytes()
            for name in ("cube_quat_wxyz", "raw_quat_wxyz"):
                assert getattr(report, name)[0].tobytes() == quat[frame].tobytes()
            assert report.confidence.tolist() == [1.0] and report.raw_confidence.tolist() == [1.0]
            assert tracker.latest is report and tracker.reading(step) is report
    assert frame == 1900


def test_visible_faces_are_told():
    seen = reports(seconds=0.3, position=(0.0, 0.0, 0.0325), quat=(1.0, 0.0, 0.0, 0.0))[0].visible_faces
    names = [{FACES[face] for face in np.flatnonzero(seen[0, camera])} for camera in range(3)]
    assert names == [{"+x", "+y", "+z"}, {"-y", "+z"}, {"-x", "+y", "+z"}]


@pytest.mark.parametrize("rate_hz", [4.0, 10.0, 25.0])
@pytest.mark.parametrize("extra_s", [-0.05, 0.0, 0.04, 0.25])
def test_rate_and_latency_are_those_that_were_set(rate_hz, extra_s):
    found = reports({"tracking_rate.rate_hz": rate_hz, "tracking_latency.extra_s": extra_s})
    capture, delivery = column(found, "capture_step"), column(found, "delivery_step")
    assert set(np.diff(capture)) == {round(1000 / rate_hz)}
    assert set(delivery - capture) == {90 + round(1000 * extra_s)}


def test_after_a_reset_reports_of_the_resting_cube_are_under_way():
    found = reports({"tracking_latency.extra_s": 0.25})
    assert column(found, "capture_step")[0] == -300  # delivered at 40 ms; the one of -400 ms was there at the start


def test_jitter_has_its_spread_and_reports_stay_in_order():
    found = reports({"tracking_jitter.std_s": 0.008}, seconds=100)
    assert len(found) in {999, 1000}
    delay_s = (column(found, "delivery_step") - column(found, "capture_step")) / 1000
    assert std_within(delay_s, np.sqrt(0.008**2 + 0.001**2 / 12))  # and the rounding to a step
    assert mean_within(delay_s, 0.09, 0.008)
    wild = reports({"tracking_jitter.std_s": 0.1}, seconds=100)
    assert (np.diff(column(wild, "delivery_step")) >= 0).all() and (np.diff(column(wild, "capture_step")) > 0).all()
    assert (column(wild, "delivery_step") >= column(wild, "capture_step")).all()


def test_frames_are_lost_at_the_rate_that_was_set():
    found = reports({"tracking_dropout.probability": 0.2}, seconds=200)
    assert count_within(len(found), 2000, 0.8)
    assert set(np.diff(column(found, "capture_step")) % 100) == {0}
    gaps = reports({"tracking_dropout.probability": 0.02, "tracking_dropout.duration_s": 1.0}, seconds=100)
    assert np.diff(column(gaps, "capture_step")).max() >= 1100


def test_a_gap_lasts_from_the_frame_it_begins_with():
    found = reports({"tracking_dropout.probability": 0.1, "tracking_dropout.duration_s": 0.3}, seconds=20, seed=11)
    begins = [noise.uniform(11, frame, DROPOUT) < 0.1 for frame in range(-2, 199)]
    arrived = [100 * frame for frame in range(199) if not any(begins[frame : frame + 3])]
    captured = column(found, "capture_step")
    assert captured[captured >= 0].tolist() == arrived


def test_all_frames_lost_leaves_the_report_from_before_the_start():
    tracker = Tracker(physics=Physics.of(1, {"tracking_dropout.probability": 1.0}))
    first = tracker.reset(start(segment(0, 20)))
    tracker.capture(segment(0, 1000))
    assert tracker.deliver(1000) == [] and tracker.latest is first
    np.testing.assert_array_equal(first.cube_position_world_m[0], REST_M)


@pytest.mark.parametrize("state", [{}, {"joints": grasp((0.0, 0.0, 0.06)), "position": (0.0, 0.0, 0.06), "quat": (1.0, 0, 0, 0)}])
def test_the_noise_of_frames_at_rest_and_in_a_grasp_is_what_was_set(state):
    found = reports({"tracking_noise.position_m": 0.002, "tracking_noise.rotation_rad": 0.02}, seconds=200, **state)
    error_m = column(found, "cube_position_world_m") - state.get("position", REST_M)
    true = Rotation.from_quat(np.roll(state.get("quat", REST_WXYZ), -1))
    turn = (Rotation.from_quat(np.roll(column(found, "cube_quat_wxyz"), -1, axis=1)) * true.inv()).as_rotvec()
    for axis in range(3):
        assert std_within(error_m[:, axis], 0.002) and mean_within(error_m[:, axis], 0.0, 0.002)
        assert std_within(turn[:, axis], 0.02) and mean_within(turn[:, axis], 0.0, 0.02)
    correlation = np.corrcoef(error_m[1:, 0], error_m[:-1, 0])[0, 1]
    assert abs(correlation) < norm.ppf(1 - TAILS / 2) / np.sqrt(len(error_m))  # each frame on its own


def test_the_noise_of_a_trial_stays_and_differs_between_trials():
    n = 2000
    found = reports({"tracking_episode_noise.position_m": 0.003}, n=n, seconds=0.5)
    errors = np.array([report.cube_position_world_m - REST_M for report in found])
    assert (errors == errors[0]).all()
    assert all(std_within(errors[0, :, axis], 0.003) for axis in range(3))


def test_scale_and_offset_of_the_cameras():
    found = reports({"tracking_scale.factor_error": 0.01, "tracking_offset.position_m": [[0.001, 0.0, -0.002]]})
    np.testing.assert_allclose(found[-1].cube_position_world_m[0], 1.01 * REST_M + [0.001, 0.0, -0.002], atol=1e-15)


def test_each_reading_has_noise_of_its_own():
    tracker = Tracker(physics=Physics.of(1, {"observation_noise.position_m": 0.001, "observation_noise.rotation_rad": 0.01}))
    latest = tracker.reset(start(segment(0, 20)), np.array([3]))
    readings = [tracker.reading(step) for step in range(0, 40000, 20)]
    errors = np.array([reading.cube_position_world_m[0] - REST_M for reading in readings])
    assert all(std_within(errors[:, axis], 0.001) for axis in range(3))
    assert (tracker.reading(60).cube_quat_wxyz == readings[3].cube_quat_wxyz).all()
    np.testing.assert_array_equal(latest.cube_position_world_m[0], REST_M)
    assert tracker.latest is latest


def test_jumps_of_the_orientation_come_at_the_rate_that_was_set():
    found = reports({"orientation_jumps.probability": 0.05}, seconds=200)
    assert count_within(jumped(found).sum(), len(found), 0.05)
    true = Rotation.from_quat(np.roll(REST_WXYZ, -1))
    wrong = Rotation.from_quat(np.roll(column(found, "cube_quat_wxyz")[jumped(found)], -1, axis=1))
    turns = Rotation.from_quat(np.roll(CUBE_TURNS_WXYZ, -1, axis=1))
    assert all(((true * turns).inv() * one).magnitude().min() < 1e-6 for one in wrong)


def test_jumps_are_more_frequent_in_a_grasp_as_the_hidden_faces_say():
    position, quat, joints = (0.0, 0.0, 0.06), (1.0, 0.0, 0.0, 0.0), grasp((0.0, 0.0, 0.06))
    arrays = (np.array([joints]), np.array([position]), np.array([quat]), np.full((1, 3), 0.0325), np.ones(1), np.zeros((1, 4)))
    size, seen, _ = look(*arrays, np.ones((1, 3), dtype=bool))
    hidden = hidden_faces(size, seen)[0]
    assert 0.5 < hidden < 2.0
    values = {"orientation_jumps.probability": 0.02, "orientation_jumps.growth": 5.0, "occlusion_by_fingers.strength": 1.0}
    found = reports(values, seconds=200, joints=joints, position=position, quat=quat)
    assert count_within(jumped(found, quat).sum(), len(found), 0.02 * 5.0**hidden)


def test_confidence_is_the_formula_of_the_real_tracker():
    size, seen = np.zeros((5, 3, 6)), np.zeros((5, 3, 6))
    size[:, :, :2] = 0.01
    seen[0] = size[0] > 0  # everything
    seen[1, :2] = size[1, :2] > 0  # one camera sees nothing
    seen[2, :, 0] = 1.0  # one of two faces is hidden everywhere
    seen[3, :, :2] = 0.05  # too little of each face
    sharp = seen.copy()
    seen[4], sharp[4] = size[4] > 0, 0.5 * (size[4] > 0)  # half of it beside outlines
    expected = [1.0, 0.4 * 2 / 3 + 0.3 * 2 / 3 + 0.2, 0.2 + 0.15 + 0.3, 0.0, 0.2 + 0.3 + 0.3]
    np.testing.assert_allclose(confidence_of(size, seen, sharp, np.zeros(5)), expected, atol=1e-12)
    np.testing.assert_allclose(confidence_of(size, seen, sharp, np.full(5, 0.1))[:1], [0.97 - 0.04], atol=1e-12)
    np.testing.assert_allclose(hidden_faces(size, seen), [0, 0, 1, 2 * 0.95, 0], atol=1e-12)


def test_confidence_of_a_healthy_robot_is_high_and_falls_as_the_cube_is_hidden():
    fingers = {"occlusion_by_fingers.strength": 1.0}
    clear = reports(fingers, seconds=0.3, position=(0, 0, 0.0325))[0].raw_confidence[0]
    held = reports(fingers, seconds=0.3, joints=grasp((0, 0, 0.06)), position=(0, 0, 0.06))[0].raw_confidence[0]
    ball = {"foreign_occlusion.radius_m": 0.08, "foreign_occlusion.position_m": [[0.09, 0.09, 0.16]]}
    behind = reports(ball, seconds=0.3)[0].raw_confidence[0]
    assert 0.95 < clear <= 1.0 and 0.8 < held < 0.95
    assert behind < 0.75


@pytest.mark.parametrize("thin", [{"occlusion_by_fingers.strength": 1e-9}, {"foreign_occlusion.radius_m": 1e-9}])
def test_confidence_is_full_where_what_is_in_the_way_has_no_thickness(thin):
    between = {"foreign_occlusion.position_m": [[0.1, 0.1, 0.2]]} if "foreign_occlusion.radius_m" in thin else {}
    for state in ({}, {"joints": grasp((0.0, 0.0, 0.06)), "position": (0.0, 0.0, 0.06), "quat": (1.0, 0, 0, 0)}):
        found = reports(thin | between, seconds=0.3, **state)[0]
        assert found.raw_confidence[0] == pytest.approx(1.0, abs=1e-12)


def test_missed_pixels_lower_the_confidence_by_their_share():
    found = reports({"colour_segmentation.missed": 0.04}, seconds=200)
    loss = (1.0 - column(found, "raw_confidence")) / 0.7
    assert mean_within(loss, 0.04, 0.04)


@pytest.mark.parametrize("dead", [0, 1, 2])
def test_a_dead_camera_is_below_the_laboratorys_limit_and_sees_no_face(dead):
    found = reports({"dead_camera.dead": np.eye(3)[[dead]]}, seconds=1)
    assert not found[0].visible_faces[0, dead].any()
    assert found[0].visible_faces[0].any(axis=1).sum() == 2
    assert 0.5 < found[0].raw_confidence[0] < 0.75


def test_the_filter_repeats_what_it_is_surer_of():
    position, quat = np.arange(12.0).reshape(4, 3), np.arange(16.0).reshape(4, 4)
    confidence, previous = np.array([0.75, 0.74, 0.74, 0.0]), np.array([0.9, 0.8, 0.0, 0.1])
    moved, turned, sure = filtered(position, quat, confidence, -position, -quat, previous)
    np.testing.assert_allclose(sure, [0.75, 0.72, 0.74, 0.09])
    for got, new, old in ((moved, position, -position), (turned, quat, -quat)):
        np.testing.assert_array_equal(got, np.stack([new[0], old[1], new[2], old[3]]))


def test_when_cameras_die_in_a_trial_the_last_good_pose_is_repeated_with_less_and_less_confidence():
    tracker = Tracker(physics=Physics.nominal(1))
    tracker.reset(start(segment(0, 20)))
    tracker.capture(segment(0, 500))
    good = tracker.deliver(500)[-1]
    tracker.set_physics(Physics.of(1, {"dead_camera.dead": [[1.0, 1.0, 0.0]]}))
    tracker.capture(segment(500, 500, position=REST_M + 0.05))
    tracker.deliver(500)
    found = [report for report in tracker.deliver(1000) if report.capture_step[0] >= 500]
    np.testing.assert_allclose(column(found, "confidence"), 0.9 ** np.arange(1, 6), rtol=1e-12)
    assert all((report.cube_position_world_m == good.cube_position_world_m).all() for report in found)
    np.testing.assert_allclose(column(found, "raw_position_world_m"), np.tile(REST_M + 0.05, (5, 1)))


def test_a_tracker_that_never_saw_anything_says_so():
    found = reports({"dead_camera.dead": [[1.0, 1.0, 1.0]]}, seconds=0.5)
    assert (column(found, "confidence") == 0.0).all() and not column(found, "visible_faces").any()
    np.testing.assert_array_equal(column(found, "cube_quat_wxyz"), np.tile([1.0, 0, 0, 0], (len(found), 1)))


@pytest.mark.parametrize(("name", "scale"), [("cube", 0.6), ("cuboid", 1.0), ("sphere", 1.0), ("octagonal_prism", 1.2)])
def test_other_objects_are_seen_too(name, scale):
    shape = shape_of(name, scale)
    found = reports({"occlusion_by_fingers.strength": 1.0}, seconds=0.5, shape=shape, position=(0, 0, shape.rest_height_m))
    assert 0.9 < found[0].raw_confidence[0] <= 1.0


def tracking_effects():
    return [effect for effect in CATALOGUE.values() if effect.acts is Acts.TRACKER]


def bits(found: list[TrackedPose], robot: int) -> bytes:
    """Every report of one robot of images from the start on, as it is in memory."""
    seen = {int(report.capture_step[robot]): report for report in found if report.capture_step[robot] >= 0}
    return b"".join(np.asarray(getattr(one, f.name))[robot].tobytes() for one in seen.values() for f in fields(TrackedPose))


def read_back(values, **state) -> tuple:
    tracker = Tracker(physics=Physics.of(1, values))
    tracker.reset(start(segment(0, 20, **state)), np.array([5]))
    return tuple(getattr(tracker.reading(100), name).tobytes() for name in POSES)


@pytest.mark.parametrize("effect", tracking_effects(), ids=lambda effect: effect.name)
def test_absent_is_nominal_to_the_bit_and_present_is_not(effect):
    state = {"joints": grasp((0.0, 0.0, 0.06)), "position": (0.0, 0.0, 0.06)}
    absent = {effect.key(parameter): parameter.absent for parameter in effect.all_parameters}
    there = present(effect)
    if effect.name == "foreign_occlusion":
        there |= {"foreign_occlusion.position_m": [[0.12, 0.12, 0.22]]}
    if effect.name == "dead_camera":
        there = {"dead_camera.dead": 1.0}
    nominal = bits(reports(seconds=4, **state), 0), read_back({}, **state)
    assert (bits(reports(absent, seconds=4, **state), 0), read_back(absent, **state)) == nominal
    assert (bits(reports(there, seconds=4, **state), 0), read_back(there, **state)) != nominal


def test_a_robot_in_a_batch_gets_the_same_bits_as_alone():
    rows = [
        Physics.nominal(1),
        Physics.of(1, {"tracking_rate.rate_hz": 15.0, "tracking_latency.extra_s": 0.2, "tracking_noise.position_m": 0.003}),
        Physics.of(1, {"tracking_jitter.std_s": 0.03, "tracking_dropout.probability": 0.2, "tracking_dropout.duration_s": 0.3}),
        Physics.of(1, {"orientation_jumps.probability": 0.2, "colour_segmentation.missed": 0.2}),
        Physics.of(1, {"tracking_episode_noise.rotation_rad": 0.1, "occlusion_by_fingers.strength": 1.0}),
    ]
    together = reports(physics=Physics.stack(rows), n=5, seconds=5)
    for index, row in enumerate(rows):
        assert bits(together, index) == bits(reports(physics=row, seconds=5, seed=7 + index), 0), index


def test_the_length_of_segments_does_not_matter():
    values = {"tracking_jitter.std_s": 0.03, "tracking_noise.position_m": 0.003, "colour_segmentation.missed": 0.2}
    assert bits(reports(values, seconds=4, block=20), 0) == bits(reports(values, seconds=4, block=50), 0)


def test_physics_of_another_number_of_robots_is_refused():
    with pytest.raises(ValueError, match="the physics of 2 robots, but there are 1"):
        Tracker(physics=Physics.nominal(2)).reset(start(segment(0, 20)))
