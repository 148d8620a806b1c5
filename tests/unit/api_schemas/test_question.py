import pytest
from pydantic import ValidationError

from api_schemas.question import QuestionRequest, Verdict, judge_pairs, judge_rate

GAINED, LOST, BOTH = (False, True), (True, False), (True, True)


def test_the_answer_is_that_of_the_first_goal_that_decides_whoever_looks_later():
    assert judge_pairs([GAINED] * 8, 200, None) == (8, Verdict.BETTER)
    assert judge_pairs([GAINED] * 8 + [LOST] * 40, 200, None) == (8, Verdict.BETTER)
    assert judge_pairs([LOST] * 8, 200, None) == (8, Verdict.WORSE)
    assert judge_pairs([GAINED] * 7, 200, None) == (7, None)


def test_nothing_goes_on_that_cannot_be_decided_any_more():
    assert judge_pairs([BOTH] * 40, 40, None) == (33, Verdict.UNDECIDED)  # seven goals are left, and eight are needed
    assert judge_rate([True, False] * 20, 40, 0.5)[1] is Verdict.UNDECIDED


def test_policies_are_alike_once_no_difference_of_that_size_is_left():
    goals, verdict = judge_pairs([BOTH] * 200, 200, 0.2)
    assert verdict is Verdict.ALIKE and 20 < goals < 60
    assert judge_pairs([BOTH] * 200, 200, 0.02)[1] is Verdict.UNDECIDED


def test_a_rate_is_found_on_its_side_of_the_bar():
    assert judge_rate([True] * 40, 40, 0.7)[1] is Verdict.ABOVE
    assert judge_rate([False] * 40, 40, 0.7)[1] is Verdict.BELOW


@pytest.mark.parametrize(
    "asked", [{}, {"against": "d" * 64, "bar": 0.5}, {"bar": 0.5, "at_least": 0.1}, {"bar": 1.0}, {"against": "x"}]
)
def test_a_question_is_one_question(asked):
    with pytest.raises(ValidationError):
        QuestionRequest(**asked)
