import hashlib
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.jobs.order import MOST_DRAWN, drawn_order, trial_seed

NAMES = st.lists(st.from_regex(r"[a-z0-9-]{1,10}", fullmatch=True), min_size=1, max_size=12, unique=True)
SEEDS = st.integers(0, 2**63 - 1)


@given(SEEDS, st.integers(0, 999), NAMES)
def test_an_order_is_a_permutation_that_depends_on_the_set_of_robots_only(seed, ordinal, robots):
    order = drawn_order(seed, ordinal, robots)
    assert sorted(order) == sorted(robots)
    assert order == drawn_order(seed, ordinal, robots[::-1])


@given(SEEDS, st.integers(0, 100), NAMES)
def test_each_block_gives_every_robot_one_first_choice(seed, block, robots):
    ordinals = range(block * len(robots), (block + 1) * len(robots))
    assert sorted(drawn_order(seed, ordinal, robots)[0] for ordinal in ordinals) == sorted(robots)


def test_the_orders_of_one_block_are_rotations_of_each_other():
    first, second = (drawn_order(5, ordinal, "abcd") for ordinal in (4, 5))
    assert second == (*first[1:], first[0])


def test_of_many_robots_an_order_has_the_first_and_all_are_first_of_one_trial_of_a_block():
    names = [f"robot-{number}" for number in range(3 * MOST_DRAWN)]
    orders = [drawn_order(5, ordinal, names) for ordinal in range(len(names))]
    assert {len(order) for order in orders} == {MOST_DRAWN}
    assert sorted(order[0] for order in orders) == sorted(names)


def test_no_robots_no_order():
    assert drawn_order(1, 0, ()) == ()


def test_first_choices_do_not_follow_a_pattern():
    firsts = Counter(drawn_order(7, 4 * block, "abcd")[0] for block in range(1000))
    assert all(200 < count < 300 for count in firsts.values()), firsts


@pytest.mark.parametrize("ordinal", [0, 39, 999])
def test_a_trials_seed_is_the_documented_draw(ordinal):
    digest = hashlib.sha256(f"trifarm-trial\n17\n{ordinal}".encode()).digest()
    assert trial_seed(17, ordinal) == int.from_bytes(digest[:8], "big") >> 1


def test_trial_seeds_fit_a_database_integer_and_differ():
    seeds = {trial_seed(seed, ordinal) for seed in range(50) for ordinal in range(50)}
    assert len(seeds) == 2500
    assert max(seeds) < 2**63
