"""What runs the tests has all cores before each of them, whatever the last one did with its own."""

import os

import pytest

ALL = os.sched_getaffinity(0)


@pytest.mark.parametrize("number", [1, 2])
def test_a_test_that_stays_on_one_core_does_not_keep_the_next_ones_there(number):
    assert os.sched_getaffinity(0) == ALL
    os.sched_setaffinity(0, {min(ALL)})
