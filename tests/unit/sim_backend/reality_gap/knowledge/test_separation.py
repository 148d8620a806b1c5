from sim_backend.reality_gap.knowledge.separation import SEPARATIONS, separated_by


def test_a_pair_has_one_sentence_whichever_stands_first():
    first, second = sorted(next(iter(SEPARATIONS)))
    assert separated_by(first, second, "") == separated_by(second, first, "") == SEPARATIONS[frozenset((first, second))].by


def test_an_unknown_pair_gets_what_the_caller_says():
    assert separated_by("backlash", "cube_mass", "more data") == "more data"
