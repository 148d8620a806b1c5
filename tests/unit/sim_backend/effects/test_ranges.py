"""Every preset: rows with sources that the catalogue allows, and draws that follow them."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import LOOKS, Group
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import PRESET_NAMES, Distribution, Per, load_ranges
from sim_backend.effects.tables import renewed
from sim_backend.trifinger import constants as c

PAGE = Path(__file__).parents[4] / "docs" / "effects.md"
ROWS = [pytest.param(row, id=f"{name}-{row.key}") for name in PRESET_NAMES for row in load_ranges(name).rows]
_STEP_S, _ACTION_NM = 0.08, 0.397
DACTYL = {
    # table 1
    "cube_size.factor": ("uniform", 0.95, 1.05),
    "cube_mass.factor": ("uniform", 0.5, 1.5),
    "link_mass.factor": ("uniform", 0.5, 1.5),
    "fingertip_friction.coefficient": ("uniform", 0.7 * c.CUBE_FRICTION, 1.3 * c.CUBE_FRICTION),
    "table_friction.coefficient": ("uniform", 0.7 * c.CUBE_FRICTION, 1.3 * c.CUBE_FRICTION),
    "finger_table_friction.coefficient": ("uniform", 0.7 * c.FINGER_FRICTION, 1.3 * c.FINGER_FRICTION),
    "safety_damping.factor": ("loguniform", 0.3, 3.0),
    "position_gain.factor": ("loguniform", 0.75, 1.5),
    "joint_limits.lower_rad": ("gaussian", -0.15, 0.15),
    "joint_limits.upper_rad": ("gaussian", -0.15, 0.15),
    "gravity.offset_m_s2": ("gaussian", -0.4, 0.4),
    # table 7: 5 mm and 0.1 rad in an episode, 1 mm and 0.1 rad in each reading; fingertips 1 mm and 2 mm, 0.2 m from the joints
    "tracking_episode_noise.position_m": ("fixed", 0.005, 0.005),
    "tracking_episode_noise.rotation_rad": ("fixed", 0.1, 0.1),
    "observation_noise.position_m": ("fixed", 0.001, 0.001),
    "observation_noise.rotation_rad": ("fixed", 0.1, 0.1),
    "joint_episode_noise.position_rad": ("fixed", 0.001 / 0.2, 0.001 / 0.2),
    "joint_noise.position_rad": ("fixed", 0.002 / 0.2, 0.002 / 0.2),
    # table 8: 5 % and 1.5 % of the range of an action, 1.5 % of the action itself
    "action_noise.white_nm": ("fixed", 0.05 * _ACTION_NM, 0.05 * _ACTION_NM),
    "action_noise.correlated_nm": ("fixed", 0.015 * _ACTION_NM, 0.015 * _ACTION_NM),
    "action_noise.relative": ("fixed", 0.015, 0.015),
    "action_noise.hold_s": ("fixed", _STEP_S, _STEP_S),
    "action_noise.time_constant_s": ("fixed", 1000.0, 1000.0),  # as good as constant in an episode
    # appendix C.2
    "action_delay.delay_s": ("either", 0.0, _STEP_S),
    "timing_jitter.std_s": (
        "loguniform",
        10 / 10000 / 0.8,
        10 / 1250 / 0.8,
    ),  # ten steps; a half-normal's mean is 0.8
    "tracking_dropout.probability": ("fixed", 0.2 / 10, 0.2 / 10),  # 0.2 in a second of 10 frames
    "tracking_dropout.duration_s": ("fixed", 1.0, 1.0),
    "occlusion_by_fingers.strength": ("fixed", 1.0, 1.0),
    "cube_pushes.force_n": ("fixed", 1.0 * c.CUBE_MASS_KG, 1.0 * c.CUBE_MASS_KG),  # 1 m/s^2
    "cube_pushes.probability": ("loguniform", 0.001, 0.1),
    "cube_pushes.duration_s": ("fixed", _STEP_S, _STEP_S),
}
"""What arXiv 1808.00177 publishes, by the parameters that express it: distribution and both ends."""
DRAWN = {"nominal": "dee36ace772e1ed7", "mild": "b3acc0bd8b4754bc", "real": "9a5c4009be9bcb94"}
"""Digests of what seed 7 drew from the presets before there were effects on images (main at 6c29269)."""
ROW = """
[[range]]
key = "cube_mass.factor"
distribution = "uniform"
low = 0.9
high = 1.1
per = "robot"
source = "scales"
dated = 2026-11-21
"""


@pytest.mark.parametrize("row", ROWS)
def test_a_row_draws_within_its_range_and_with_its_shape(row):
    values = row.draw(np.random.default_rng(1), 4000)
    parameter = row.parameter
    assert values.shape == ((4000,) if parameter.width == 1 else (4000, parameter.width))
    assert len(row.source) > 5
    assert ((values >= parameter.lower) & (values <= parameter.upper)).all()
    middle, half = (row.low + row.high) / 2, (row.high - row.low) / 2
    if row.distribution is Distribution.GAUSSIAN:
        first = values.reshape(4000, -1)[:, 0]
        inside = np.abs(first - middle) <= half
        assert inside.mean() == pytest.approx(0.683, abs=0.03)
    else:
        assert ((values >= row.low) & (values <= row.high)).all()
        if half and row.distribution is not Distribution.EITHER:
            drawn, low, high = (
                (np.log(values), np.log(row.low), np.log(row.high))
                if row.distribution == "loguniform"
                else (values, row.low, row.high)
            )
            assert drawn.reshape(4000, -1)[:, 0].mean() == pytest.approx((low + high) / 2, abs=0.02 * (high - low))
    if parameter.width > 1 and half:
        assert (np.ptp(values, axis=1) > 0).any() == row.each


@pytest.mark.parametrize("name", DRAWN)
def test_presets_without_images_draw_what_they_always_drew(name):
    ranges, rng = load_ranges(name), np.random.default_rng(7)
    drawn = ranges.draw(rng, 1)
    content = [drawn.document(), ranges.draw_episode(rng, drawn).document()]
    assert hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16] == DRAWN[name]


def test_a_preset_that_extends_another_has_the_same_robots_and_more():
    real, images = (load_ranges(name).draw(np.random.default_rng(3), 2) for name in ("real", "real-images"))
    assert all((real.given[key] == images.given[key]).all() for key in real.given)
    more = {key.partition(".")[0] for key in images.given.keys() - real.given.keys()}
    assert more == {effect.name for effect in CATALOGUE.values() if effect.acts in LOOKS}


def test_a_file_can_extend_presets_alone(tmp_path):
    file = tmp_path / "more.toml"
    file.write_text('extends = "other.toml"')
    with pytest.raises(ValueError, match=r"extends 'other\.toml'; choose from nominal"):
        load_ranges(file)


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_the_same_seed_gives_the_same_robots(name):
    ranges = load_ranges(name)
    robots = ranges.draw(np.random.default_rng(5), 3)
    again = ranges.draw(np.random.default_rng(5), 3)
    assert robots.n == 3
    assert [robots.row(i).document() for i in range(3)] == [again.row(i).document() for i in range(3)]
    assert set(robots.given) == {row.key for row in ranges.rows if row.per is Per.ROBOT}
    episode = ranges.draw_episode(np.random.default_rng(6), robots)
    assert set(episode.given) == {row.key for row in ranges.rows}
    assert all((episode.value(key) == robots.value(key)).all() for key in robots.given)


def test_nominal_has_no_effect():
    assert load_ranges("nominal").draw(np.random.default_rng(0), 4).is_nominal


def test_real_covers_every_group_and_no_fault():
    given = {row.key.partition(".")[0] for row in load_ranges("real").rows}
    assert {CATALOGUE[name].group for name in given} == set(Group) - {Group.FAULT, Group.IMAGES}
    assert all(row.per is Per.ROBOT for row in load_ranges("real").rows)
    assert load_ranges("real").draw(np.random.default_rng(0), 2).is_nominal is False


def test_mild_is_a_third_of_real():
    mild = {row.key: row for row in load_ranges("mild").rows}
    real = {row.key: row for row in load_ranges("real").rows}
    assert list(mild) == list(real)
    for key, row in real.items():
        absent = PARAMETERS[key].absent
        if mild[key].source == "as in `real`":
            assert (mild[key].low, mild[key].high) == (row.low, row.high)
        else:
            assert 3 * (mild[key].low - absent) == pytest.approx(row.low - absent, rel=1e-4)
            assert 3 * (mild[key].high - absent) == pytest.approx(row.high - absent, rel=1e-4)


def test_dactyls_table_is_the_published_one():
    rows = {row.key: row for row in load_ranges("dactyl").rows}
    assert set(rows) == set(DACTYL) | {"backlash.gap_rad"}  # whose calibrated values are not published
    for key, (distribution, low, high) in DACTYL.items():
        assert rows[key].distribution == distribution, key
        assert (rows[key].low, rows[key].high) == (pytest.approx(low), pytest.approx(high)), key
        assert rows[key].per is Per.EPISODE and rows[key].source.startswith("Dactyl (arXiv 1808.00177)")


def test_frictions_of_isaacs_ranges_are_averages_of_the_two_that_touch():
    robot, table, cube = 1.0, 0.1, 1.0  # IsaacGymEnvs; U(0.5, 1.5) times the table's and U(0.7, 1.3) times the cube's
    nominal = (cube + table) / 2
    expected = {
        "fingertip_friction.coefficient": ((robot + 0.7 * cube) / 2, (robot + 1.3 * cube) / 2),
        "table_friction.coefficient": (
            c.CUBE_FRICTION * (0.7 * cube + 0.5 * table) / 2 / nominal,
            c.CUBE_FRICTION * (1.3 * cube + 1.5 * table) / 2 / nominal,
        ),
        "finger_table_friction.coefficient": ((robot + 0.5 * table) / 2, (robot + 1.5 * table) / 2),
    }
    assert (robot + table) / 2 == c.FINGER_FRICTION and (robot + cube) / 2 == c.CUBE_FRICTION
    for name in ("isaacgymenvs", "allshire"):
        rows = {row.key: row for row in load_ranges(name).rows}
        for key, ends in expected.items():
            assert (rows[key].low, rows[key].high) == pytest.approx(ends, abs=5e-4), (name, key)
            assert "averages" in rows[key].source


def test_real_keeps_to_the_numbers_that_its_sources_give():
    rows = {row.key: (row.low, row.high) for row in load_ranges("real").rows}
    assert rows["tracking_scale.factor_error"] == pytest.approx((0.0, 65.2 / 65 - 1), abs=1e-4)
    assert rows["rotor_inertia.armature_kg_m2"] == pytest.approx((4.5e-6 * 81, 1.05 * 5.4e-6 * 81), abs=1e-6)
    assert rows["thermal_derating.time_constant_s"] == (21 * 10, 21 * 20)


def test_a_file_of_ranges(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('about = "mine"\n' + ROW)
    ranges = load_ranges(path)
    assert (ranges.name, ranges.about, len(ranges.rows)) == ("own", "mine", 1)


def test_a_file_with_one_robots_physics(tmp_path):
    path = tmp_path / "one.toml"
    path.write_text("[fingertip_friction]\ncoefficient = 0.7\n\n[link_mass]\nfactor = [1, 1, 1, 1, 1, 1, 1, 1, 1.2]\n")
    robots = load_ranges(str(path)).draw(np.random.default_rng(0), 2)
    assert robots.n == 2
    assert (
        robots.row(1).document()
        == Physics.from_document(
            {"fingertip_friction": {"coefficient": 0.7}, "link_mass": {"factor": [1.0] * 8 + [1.2]}}
        ).document()
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("cube_mass.factor", "cube_mass.weight"), "unknown parameter"),
        (("high = 1.1", "high = 9.9"), r"the catalogue allows 0\.2 to 3"),
        (("low = 0.9", "low = 1.2"), "must not be larger"),
        (('"uniform"', '"normal"'), "normal"),
        (('"robot"', '"robot"\neach = true'), "one number for each robot"),
        (('source = "scales"\n', ""), "'source' is missing"),
        (('source = "scales"', 'source = " "'), "no source"),
        (("low = 0.9", "low = 0.9\nlwo = 1"), "unknown lwo"),
        (("[[range]]", ROW + "[[range]]"), "more than one range"),
        (("[[range]]", "range = 3\n[x]"), "must be a list"),
        (("[[range]]", "[[range"), "is not a TOML file"),
    ],
)
def test_errors_say_what_is_wrong(tmp_path, change, message):
    path = tmp_path / "wrong.toml"
    path.write_text(ROW.replace(*change, 1))
    with pytest.raises(ValueError, match=message):
        load_ranges(path)


def test_an_unknown_name_lists_the_presets():
    with pytest.raises(ValueError, match="nominal, mild, real"):
        load_ranges("perfect")


def test_the_page_has_the_tables_of_the_code():
    page = PAGE.read_text(encoding="utf-8")
    assert page == renewed(page), "run python -m sim_backend.effects.tables docs/effects.md"
