"""``trifarm layouts``: every layout with its width, one number by number, and the fields."""

from api_schemas.observation import OBSERVATION_SIZES
from api_schemas.policy import LAYOUTS, PolicyManifest


def test_all_layouts_are_listed_with_their_widths(trifarm):
    rows = [line.split() for line in trifarm("layouts").out.splitlines()[1:]]
    assert {row[0]: int(row[1]) for row in rows} == {name: each.observation_size for name, each in LAYOUTS.items()}
    assert trifarm("layouts", "--json").document["layouts"]["rrc2022-push-flat"]["numbers"] == 97


def test_one_layout_is_listed_number_by_number(trifarm):
    lines = trifarm("layouts", "rrc2022-lift-flat").out.splitlines()
    assert lines[1].split() == ["0–23", "24", "cube_keypoints_world_m"]
    assert lines[-1].split() == ["sum", "139"]
    assert PolicyManifest.model_validate(trifarm("layouts", "pose", "--json").document) == LAYOUTS["pose"]


def test_fields_are_listed(trifarm):
    assert trifarm("layouts", "--fields", "--json").document["fields"] == OBSERVATION_SIZES


def test_an_unknown_layout_is_answered_with_all(trifarm):
    ended = trifarm("layouts", "rrc")
    assert (ended.code, "choose from rrc2022-push, rrc2022-lift" in ended.err) == (2, True)
