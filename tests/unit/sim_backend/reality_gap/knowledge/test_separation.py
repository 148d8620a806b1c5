import json
from pathlib import Path

from sim_backend.reality_gap.knowledge.separation import SEPARATIONS, separated_by


def test_a_pair_has_one_sentence_whichever_stands_first():
    first, second = sorted(next(iter(SEPARATIONS)))
    assert separated_by(first, second, "") == separated_by(second, first, "") == SEPARATIONS[frozenset((first, second))].by


def test_an_unknown_pair_gets_what_the_caller_says():
    assert separated_by("backlash", "cube_mass", "more data") == "more data"


def test_pairs_at_joints_name_the_two_excitations_that_the_simulation_found_best():
    kept = json.loads((Path(__file__).parents[5] / "results" / "separating.json").read_text(encoding="utf-8"))["apart"]
    for effects, apart in kept.items():
        known = SEPARATIONS.get(frozenset(effects.split()))
        if known is not None and known.needs == 1:
            best = sorted((name for name in apart if name != "standard"), key=lambda name: -apart[name])
            assert list(known.excitations) == best[:2], effects
