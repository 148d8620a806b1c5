"""Neighbouring versions work together; of others it is said which is too old."""

import pytest

from api_schemas.joining import too_far_apart

NEIGHBOURS = [("0.1.0", "0.1.9"), ("0.1.0", "0.2.0"), ("0.3.1", "0.2.7"), ("2.0", "2.1"), ("unknown", "9.9.9")]
APART = [
    ("0.1.0", "0.3.0", "the robot's"),
    ("0.9.0", "1.0.0", "the robot's"),
    ("0.4.0", "0.2.9", "the services'"),
    ("2.0", "1.9", "the services'"),
]


@pytest.mark.parametrize("pair", NEIGHBOURS)
def test_neighbours_work_together(pair):
    assert too_far_apart(*pair) is None


@pytest.mark.parametrize(("robot", "services", "old"), APART)
def test_the_older_one_is_named(robot, services, old):
    said = too_far_apart(robot, services)
    assert said is not None
    assert said.startswith(f"{old} version")
    assert "too old" in said
