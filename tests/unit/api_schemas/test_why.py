"""What users are told of an answer, and what a job's table says."""

import pytest

from api_schemas.success_rate import wilson
from api_schemas.why import MOST_NAMED, TrialWhy, Why, WhyEffect, WhyGroup, WhyState, WhyVerdict, job_why


def answer(verdict=WhyVerdict.CAUSE, *explains, others=("table",)):
    groups = [WhyGroup(name=name, words=f"{name} words", explains=True, turned=True, successes=4, replays=4) for name in explains]
    groups += [WhyGroup(name=name, words=name, explains=False, turned=False, successes=0, replays=0) for name in others]
    effect = WhyEffect(name="tracking_latency", turned=True, successes=4, replays=4, explains=True, values={"extra_s": 0.4})
    return Why(
        trial="j1-000",
        verdict=verdict,
        groups=tuple(groups),
        control_successes=1,
        control_replays=4,
        effects=(effect,),
        replays=20,
    )


def test_users_see_names_of_groups_and_no_number():
    shown = answer(WhyVerdict.CAUSE, "late_camera", "motors", "links", "object").for_users()
    assert [group.name for group in shown.groups] == ["late_camera", "motors", "links"]
    assert len(shown.groups) == MOST_NAMED
    text = shown.model_dump_json(exclude={"trial"})
    assert not [digit for digit in "0123456789" if digit in text]
    assert "tracking_latency" not in text


@pytest.mark.parametrize("verdict", WhyVerdict)
def test_every_verdict_is_a_sentence_for_both(verdict):
    full = answer(verdict, *(["late_camera"] if verdict is WhyVerdict.CAUSE else []))
    assert full.sentence.startswith("it ")
    assert not [digit for digit in "0123456789" if digit in full.for_users().sentence]


def trial(number, found):
    return TrialWhy(trial=f"j1-{number:03d}", state=WhyState.DONE, why=found)


def test_a_table_counts_groups_over_the_answers():
    answers = [
        answer(WhyVerdict.CAUSE, "late_camera"),
        answer(WhyVerdict.CAUSE, "late_camera", "motors"),
        answer(WhyVerdict.CHANCE),
    ]
    table = job_why("j1", 5, [trial(number, found) for number, found in enumerate(answers)])
    assert [(group.name, group.trials) for group in table.groups] == [("late_camera", 2), ("motors", 1)]
    assert table.groups[0].interval_80 == wilson(2, 3, 0.8)
    assert (table.failed, table.answered, table.verdicts[WhyVerdict.CHANCE]) == (5, 3, 1)
    assert "the camera's delay" in table.advice


def test_trials_that_fail_on_the_ideal_robot_ask_for_another_policy():
    table = job_why("j1", 2, [trial(0, answer(WhyVerdict.POLICY)), trial(1, answer(WhyVerdict.POLICY))])
    assert "another policy" in table.advice
    assert "nothing is known" in job_why("j1", 2, []).advice
