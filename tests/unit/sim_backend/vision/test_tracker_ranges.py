"""Ranges of the formula from measured errors: planted errors come back, and occlusion is matched where it shows."""

import datetime
import functools

import numpy as np
import pytest

from sim_backend.effects.ranges import load_ranges
from sim_backend.vision import tracker_ranges as t
from sim_backend.vision.calibrate_tracker import _values, markdown, table
from sim_backend.vision.rotations import matrices_of
from sim_backend.vision.scenes import drawn_scene
from sim_backend.vision.tracker_errors import moved_on, rotation_vector

OFFSET_MM, NOISE_MM, SCENE_MM = 1.5, 0.4, 0.9


def planted(robots=60, scenes=10, confidence=0.9):
    """Rows whose errors have these parts, in mm and in hundredths of a rad."""
    rng, rows = np.random.default_rng(1), []
    for robot in range(robots):
        offset = OFFSET_MM * rng.standard_normal(3)
        for number in range(scenes):
            scene, with_it = drawn_scene(rng), SCENE_MM * rng.standard_normal(3)
            found = {}
            for look in ("at_rest", "again", "moved"):
                off = offset + with_it + NOISE_MM * rng.standard_normal(3)
                found[look] = {"position_mm": off.tolist(), "rotation_rad": (off / 100).tolist(), "confidence": confidence}
            rows.append({"robot": robot, "scene": number, "hidden": 0.2, "speed_m_s": 0.1, "from_middle_m": 0.1, "lamp": 0.0})
            rows[-1] |= {"images": found, "formula": found["at_rest"], "joint_position_rad": scene.joint_position_rad.tolist()}
            rows[-1] |= {"position_m": scene.position_world_m.tolist(), "quat_wxyz": scene.quat_wxyz.tolist()}
    return rows


def by_key(rows):
    return {row.key: row for row in t.ranges_of(rows, (1.0, 0.02))}


@functools.cache
def found_in_planted():
    return by_key(planted())


def test_planted_errors_are_found_as_offset_noise_and_what_goes_with_a_scene():
    found = found_in_planted()
    assert found["tracking_offset.position_m"].high == pytest.approx(OFFSET_MM / 1000, rel=0.15)
    assert found["tracking_offset.position_m"].low == -found["tracking_offset.position_m"].high
    for key, planted_mm in (("tracking_noise", NOISE_MM), ("tracking_episode_noise", SCENE_MM)):
        row = found[f"{key}.position_m"]
        assert row.low < planted_mm / 1000 < row.high < 2 * planted_mm / 1000
        assert found[f"{key}.rotation_rad"].low == pytest.approx(10 * row.low, rel=1e-6)
    assert found["orientation_jumps.probability"].high < 0.001


def test_jumps_are_counted_and_are_no_noise():
    rows, calm = planted(), found_in_planted()
    for row in rows[:18]:
        row["images"]["moved"]["rotation_rad"] = [1.6, 0.0, 0.0]
    found = by_key(rows)
    assert 18 / 1800 < found["orientation_jumps.probability"].high < 0.02
    assert found["tracking_noise.rotation_rad"].high == pytest.approx(calm["tracking_noise.rotation_rad"].high, rel=0.2)


def test_rows_of_too_few_robots_are_refused():
    with pytest.raises(ValueError, match="at least 2"):
        t.ranges_of(planted(robots=1), (1.0, 0.0))
    with pytest.raises(ValueError, match="at least 2"):
        t.ranges_of(planted(confidence=0.1), (1.0, 0.0))


def test_occlusion_is_that_of_whoever_sees_as_often():
    rows = planted(robots=10)
    for row, confidence in zip(rows, t.confidences(rows, _values(1.3, 0.04)), strict=True):
        row["images"]["at_rest"]["confidence"] = float(confidence)
        row["hidden"] = float(np.clip(1.0 - confidence, 0.0, 1.0))
    strength, missed = t.matched_occlusion(rows, _values)
    wanted, found = (t.unseen(rows, t.confidences(rows, _values(*each))) for each in ((1.3, 0.04), (strength, missed)))
    assert np.nanmean(wanted) > 0.0 and np.nanmax(np.abs(wanted - found)) < 0.1


def test_what_is_written_is_a_preset_of_the_same_robots(tmp_path):
    ranges = t.ranges_of(planted(), (0.9, 0.01))
    text = t.preset_text(ranges, "About.", datetime.date(2026, 11, 26))
    (path := tmp_path / "found.toml").write_text(text)
    real, found = (load_ranges(name).draw(np.random.default_rng(3), 2) for name in ("real", path))
    differ = {key.partition(".")[0] for key in real.given if not np.array_equal(real.given[key], found.given[key])}
    assert differ == {row.key.partition(".")[0] for row in ranges} - {"tracking_episode_noise"} | {"tracking_episode_noise"}


def test_a_scene_moves_on_by_its_speed_and_not_into_the_floor():
    rng = np.random.default_rng(2)
    for _ in range(20):
        scene = drawn_scene(rng)
        later, speed_m_s = moved_on(scene, rng)
        assert later.position_world_m[2] >= scene.position_world_m[2]
        assert np.linalg.norm(later.position_world_m - scene.position_world_m) <= 0.1 * speed_m_s + 1e-9


@pytest.mark.parametrize("vector", [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-2.0, 1.0, 1.0], [3.1, 0.0, 0.0]])
def test_a_rotation_vector_is_that_of_its_matrix(vector):
    np.testing.assert_allclose(rotation_vector(matrices_of(np.array([vector]))[0]), vector, atol=1e-9)


def test_the_table_has_every_kind_and_what_may_matter():
    rows = planted(robots=4)
    errors = [
        {"hidden": 0.2, "speed_m_s": 0.2, "from_middle_m": 0.1, "lamp": 0.1 * k}
        | {kind: row["images"]["at_rest"] for kind in ("images", "real", "found", "moved")}
        for k, row in enumerate(rows)
    ]
    text = markdown(table(errors))
    assert "| found, hidden 10% to 30% | 40 | 0.0% |" in text and "moving at 0.1 to 0.25 m/s | 40" in text
    assert "| images, hidden 50% to 100% | 0 |" in text
