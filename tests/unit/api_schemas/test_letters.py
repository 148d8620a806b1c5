import itertools

import numpy as np
import pytest

from api_schemas.letters import compact_letters, holm, pair_chance


def test_the_chance_is_shared_by_all_pairs():
    assert pair_chance(10) == pytest.approx(0.05 / 45)
    assert pair_chance(1) == pair_chance(2) == 0.05


@pytest.mark.parametrize("seed", range(5))
def test_two_policies_share_a_letter_exactly_if_they_cannot_be_told_apart(seed):
    apart = np.triu(np.random.default_rng(seed).random((7, 7)) < 0.4, 1)
    apart = apart | apart.T
    letters = compact_letters(apart.tolist())
    for one, other in itertools.combinations(range(7), 2):
        assert bool(set(letters[one]) & set(letters[other])) is not bool(apart[one, other])


def test_letters_go_down_with_the_order():
    apart = [[False, False, True], [False, False, True], [True, True, False]]
    assert compact_letters(apart) == ("a", "a", "b")


def pairs_apart(policies):
    """Each second policy differs from the one before it and from no other, so that groups double with each pair."""
    return [[one != other and one // 2 == other // 2 for other in range(policies)] for one in range(policies)]


def test_policies_in_more_groups_than_anybody_reads_get_no_letters():
    assert compact_letters(pairs_apart(40)) == (None,) * 40  # 2 ** 20 groups would be compared with each other
    assert len(set("".join(compact_letters(pairs_apart(12))).replace("'", ""))) == 26
    threes = [[one != other and one // 3 == other // 3 for other in range(12)] for one in range(12)]
    assert None not in compact_letters(threes), "of twelve there are no more than 81 groups"


def test_holms_rule_stops_at_the_first_that_is_not_refuted():
    assert holm([0.04, 0.001, 0.02]) == [True, True, True]
    assert holm([0.04, 0.001, 0.03]) == [False, True, False]
    assert holm([]) == []
