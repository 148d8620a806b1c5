"""Numbers of effects as causes with intervals."""

from types import SimpleNamespace

import pytest

from sim_backend.reality_gap.joints.causes import index_of, is_clear
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger import constants as c


@pytest.mark.parametrize(("where", "index"), [(c.JOINT_NAMES[4], 4), ("x", 0), ("z", 2), ("platform", 0)])
def test_which_number_a_place_means(where, index):
    assert index_of(c.JOINT_NAMES, where) == index


@pytest.mark.parametrize(("interval", "is_it"), [((0.01, 0.03), True), ((-0.01, 0.03), False), ((0.03, 0.05), True)])
def test_a_value_is_clear_if_its_interval_leaves_out_what_the_study_began_with(interval, is_it):
    study = SimpleNamespace(problem=SimpleNamespace(names=c.JOINT_NAMES), problem_start=lambda key, index: 0.0)
    cause = Cause("encoder_offset", "offset_rad", c.JOINT_NAMES[0], sum(interval) / 2, "rad", interval)
    assert is_clear(study, cause) is is_it
