"""The tracker on a cube at rest, in motion and in a grasp: what is measured of its reports is what was set."""

import numpy as np
import pytest

from sim_backend.driver.detection import DROPOUT
from sim_backend.driver.tracker import TrackedPose, Tracker, filtered
from sim_backend.effects import noise
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.physics import Physics
from tests.unit.sim_backend.driver.cubes import (
    POSES,
    REST_M,
    column,
    count_within,
    grasp,
    mean_within,
    reports,
    segment,
    start,
    std_within,
)
from tests.unit.sim_backend.effects.rig import present


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


def tracking_effects():
    return [effect for effect in CATALOGUE.values() if effect.acts is Acts.TRACKER]


def bits(found: list[TrackedPose], robot: int) -> bytes:
    """Every report of one robot of images from the start on, as it is in memory."""
    seen = {int(report.capture_step[robot]): report for report in found if report.capture_step[robot] >= 0}
    return b"".join(np.asarray(values)[robot].tobytes() for one in seen.values() for values in one)


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


def test_a_robot_that_begins_anew_has_a_clock_of_its_own():
    physics = Physics.of(3, {"tracking_latency.extra_s": [0.0, 0.15, 0.02], "tracking_noise.position_m": 0.01})
    together, alone = Tracker(physics=physics), Tracker(physics=physics.row(1))
    together.reset(start(segment(0, 20, 3)), np.array([1, 2, 3]))
    first = alone.reset(start(segment(0, 20)), np.array([9]))
    begun = 340
    for step in range(0, begun, 20):
        together.capture(segment(step, 20, 3))
        together.deliver(step + 20)
    others = together.latest.capture_step[[0, 2]].copy()
    together.restart(np.array([1]), start(segment(0, 20, 3)), np.array([9]), begun)
    np.testing.assert_array_equal(together.latest.capture_step[[0, 2]], others)
    np.testing.assert_array_equal(together.latest.capture_step[1], first.capture_step[0])
    for own in range(0, 600, 20):
        together.capture(segment(begun + own, 20, 3))
        alone.capture(segment(own, 20))
        together.deliver(begun + own + 20)
        alone.deliver(own + 20)
        for name in ("capture_step", "delivery_step", "cube_position_world_m", "confidence"):
            np.testing.assert_array_equal(
                getattr(together.latest, name)[1:2], getattr(alone.latest, name), err_msg=f"{own} {name}"
            )
    assert (together.latest.capture_step[[0, 2]] >= others + 500).all()
