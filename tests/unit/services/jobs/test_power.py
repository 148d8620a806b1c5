import numpy as np
import pytest

from api_schemas.question import QuestionRequest, judge_pairs, judge_rate
from services.jobs.power import decided_within, findable, findable_difference, rate_decided_within

D = "d" * 64


def test_the_law_of_the_test_is_what_made_up_goals_do():
    """Exact probability and mean against the judge itself on drawn goals."""
    rng, decided, goals = np.random.default_rng(241), 0, []
    for _ in range(400):
        draws = rng.choice(3, size=60, p=[0.7, 0.25, 0.05])
        pairs = [((True, True), (False, True), (True, False))[draw] for draw in draws]
        count, verdict = judge_pairs(pairs, 60, None)
        decided += verdict in {"better", "worse"}
        goals.append(count if verdict in {"better", "worse"} else 60)
    chance, mean = decided_within(60, 0.05, 0.25)
    assert decided / 400 == pytest.approx(chance, abs=4 * (chance * (1 - chance) / 400) ** 0.5)
    assert np.mean(goals) == pytest.approx(mean, abs=4 * np.std(goals) / 20)


def test_rates_beside_a_bar_by_the_same_way():
    rng, above = np.random.default_rng(242), 0
    for _ in range(200):
        above += judge_rate((rng.random(60) < 0.95).tolist(), 60, 0.7)[1] == "above"
    chance = rate_decided_within(60, 0.7, 0.95)
    assert above / 200 == pytest.approx(chance, abs=4 * (chance * (1 - chance) / 200) ** 0.5)


def test_more_goals_find_smaller_differences():
    smallest = [findable_difference(goals) for goals in (20, 40, 200)]
    assert smallest == sorted(smallest, reverse=True) and smallest[0] > smallest[2]
    assert findable_difference(6) is None


@pytest.mark.parametrize(
    ("asked", "goals", "told"),
    [
        ({"against": D}, 6, "cannot decide within 6 goals"),
        ({"against": D, "at_least": 0.1}, 40, "cannot be counted on to decide 10 points within 40 goals"),
        ({"against": D, "at_least": 0.5}, 40, "a difference of"),
        ({"bar": 0.8}, 200, "within 200 trials a policy is found to lie above it from"),
        ({"bar": 0.8}, 1, "cannot decide within 1 trials"),
    ],
)
def test_what_can_be_found_is_a_sentence(asked, goals, told):
    assert findable(QuestionRequest(**asked), goals).startswith(told)
