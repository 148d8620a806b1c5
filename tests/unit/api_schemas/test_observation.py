"""Terms of an observation: parts, earlier values, histories, constants, and what each number is called."""

import re

import pytest

from api_schemas.observation import fields_of, number_name, sizes_of, term_of
from api_schemas.policy import LAYOUTS, PolicyManifest


@pytest.mark.parametrize(
    ("text", "field", "numbers", "ago", "size"),
    [
        ("joint_position_rad", "joint_position_rad", range(9), (0,), 9),
        ("joint_position_rad[0:3]", "joint_position_rad", range(3), (0,), 3),
        ("cube_quat_xyzw[3]", "cube_quat_xyzw", range(3, 4), (0,), 1),
        ("previous_action@2", "previous_action", range(9), (2,), 9),
        ("fingertip_force@3..0", "fingertip_force", range(3), (3, 2, 1, 0), 12),
        ("fingertip_force[1]@0..2", "fingertip_force", range(1, 2), (0, 1, 2), 3),
        ("constant(0, -0.5)", None, range(0), (), 2),
    ],
)
def test_terms(text, field, numbers, ago, size):
    term = term_of(text)
    assert (term.field, term.numbers, term.periods_ago, term.size) == (field, numbers, ago, size)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joint_positions", "choose from cube_keypoints_world_m"),
        ("joint_position_rad[9]", "has the numbers 0 to 8"),
        ("joint_position_rad[3:3]", "at most joint_position_rad[0:9]"),
        ("previous_action@51", "at most 50 control periods"),
        ("constant(a)", "such as constant(0, 0.5)"),
        ("constant(nan)", "at most a million"),
    ],
)
def test_what_is_no_term_is_said(text, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        PolicyManifest(observation=(text,))


def test_flat_layouts_have_the_width_and_order_of_the_published_datasets():
    """Gürtler et al. 2023 (arXiv 2307.15690); the order of ``gymnasium.spaces.flatten`` over sorted keys."""
    assert {name: LAYOUTS[name].observation_size for name in ("rrc2022-push-flat", "rrc2022-lift-flat")} == {
        "rrc2022-push-flat": 97,
        "rrc2022-lift-flat": 139,
    }
    robot = ("fingertip_force", "fingertip_position_world_m", "fingertip_velocity_world_m_s", "joint_position_rad", "robot_id")
    assert LAYOUTS["rrc2022-lift-flat"].observation[-7:] == (*robot, "joint_torque_nm", "joint_velocity_rad_s")
    assert LAYOUTS["rrc2022-push-flat"].observation.count("cube_position_world_m") == 2


def test_each_number_has_a_name():
    seen = ("robot_id", "fingertip_force[1:3]@1..0", "constant(2, 3)")
    names = [number_name(seen, index) for index in range(sum(sizes_of(seen)))]
    assert names[:5] == ["robot_id", *(f"fingertip_force[{k}]{ago}" for ago in ("@1", "") for k in (1, 2))]
    assert names[5:] == ["constant(2, 3)"] * 2
    assert fields_of(seen) == ("robot_id", "fingertip_force")
