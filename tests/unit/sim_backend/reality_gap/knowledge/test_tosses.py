"""What is known of effects that tosses show."""

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge.tosses import TOSSED


def test_every_effect_stands_once_with_parameters_of_its_own():
    assert len({known.effect for known in TOSSED}) == len(TOSSED)
    for known in TOSSED:
        assert known.effect in CATALOGUE
        assert {key.partition(".")[0] for key in known.keys} == {known.effect}
        assert set(known.keys) <= set(PARAMETERS)
