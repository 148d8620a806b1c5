"""Comparisons on the same goals: exact p, an interval that holds its level, and who changed sides."""

from statistics import NormalDist

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import binomtest

from api_schemas.comparison import NotComparableError, changed_sides, compare, mcnemar, paired_interval
from api_schemas.trial import OutcomeKind
from tests.unit.report_views.test_text import report, trial


def job(name, outcomes, *, first_seed=100):
    rows = [
        trial(number, OutcomeKind.SUCCEEDED if done else OutcomeKind.FAILED).model_copy(update={"seed": first_seed + number})
        for number, done in enumerate(outcomes)
    ]
    return report(*rows, name=name).model_copy(update={"job_id": name, "seed": first_seed})


@pytest.mark.parametrize("gained, lost", [(0, 0), (1, 0), (5, 5), (2, 9), (12, 1), (30, 17)])
def test_p_is_that_of_the_exact_binomial_test(gained, lost):
    expected = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
    assert mcnemar(gained, lost) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("gained, lost, goals", [(0, 1, 44), (7, 2, 40), (12, 0, 40)])
def test_at_the_bounds_the_score_is_that_of_the_likeliest_rates(gained, lost, goals):
    """Finds the likeliest rates under each bound by search, instead of by Tango's formula."""
    z = NormalDist().inv_cdf(0.975)
    for difference, expected in zip(paired_interval(gained, lost, goals, 0.95), (z, -z), strict=True):

        def unlikely(q, difference=difference):
            rest = 1 - 2 * q - difference
            return -(gained * np.log(q + difference) + lost * np.log(q) + (goals - gained - lost) * np.log(rest))

        low = max(0.0, -difference) + 1e-12
        q = minimize_scalar(unlikely, bounds=(low, (1 - difference) / 2 - 1e-12), method="bounded", options={"xatol": 1e-13}).x
        score = (gained - lost - goals * difference) / np.sqrt(goals * (2 * q + difference - difference**2))
        assert score == pytest.approx(expected, abs=2e-3)


def test_where_no_goal_changed_sides_the_interval_is_the_same_to_both_sides():
    z = NormalDist().inv_cdf(0.975)
    assert paired_interval(0, 0, 40, 0.95) == pytest.approx((-(z**2) / (40 + z**2), z**2 / (40 + z**2)), abs=1e-9)


def test_the_interval_covers_the_truth_about_as_often_as_it_says():
    rng = np.random.default_rng(5)
    both, gained, lost, goals = 0.4, 0.25, 0.15, 40
    drawn = rng.multinomial(goals, [both, gained, lost, 1 - both - gained - lost], size=800)
    bounds = np.array([paired_interval(int(row[1]), int(row[2]), goals, 0.8) for row in drawn])
    covered = np.mean((bounds[:, 0] <= gained - lost) & (gained - lost <= bounds[:, 1]))
    assert 0.76 < covered < 0.84


def test_goals_are_paired_by_their_seed_and_changed_sides_are_named():
    first = job("a", [True, True, False, False, True])
    other = job("b", [False, True, True, False, True, True])  # has a goal more
    (task,) = compare([first, other]).tasks
    (difference,) = task.differences
    assert (task.goals, difference.both, difference.neither, difference.gained, difference.lost) == (5, 2, 1, 1, 1)
    assert [goal.seed for goal in changed_sides(task, 1)] == [100, 102]
    assert difference.difference == 0.0
    assert not difference.is_worse


def test_a_policy_that_lost_much_is_worse_and_one_that_gained_is_not():
    good, bad = [True] * 20, [True] * 8 + [False] * 12
    (worse,) = compare([job("a", good), job("b", bad)]).tasks[0].differences
    (better,) = compare([job("a", bad), job("b", good)]).tasks[0].differences
    assert worse.is_worse and worse.interval_95[1] < 0
    assert not better.is_worse and better.interval_95[0] > 0


def test_jobs_of_two_tasks_are_compared_task_by_task():
    jobs = [job(name, [True, False]) for name in "abcd"]
    jobs[1], jobs[3] = (each.model_copy(update={"task": "lift"}) for each in (jobs[1], jobs[3]))
    found = compare(jobs)
    assert [(task.task, [each.job_id for each in task.jobs]) for task in found.tasks] == [
        ("push", ["a", "c"]),
        ("lift", ["b", "d"]),
    ]


@pytest.mark.parametrize(
    "jobs, words",
    [
        (["a"], "only one of push"),
        (["a", "a"], "named twice"),
        (["a", "far"], "no goal in common"),
    ],
)
def test_what_cannot_be_compared_is_said(jobs, words):
    made = {"a": job("a", [True]), "far": job("far", [True], first_seed=999)}
    with pytest.raises(NotComparableError, match=words):
        compare([made[name] for name in jobs])


def test_jobs_of_two_forms_of_the_scene_are_not_compared():
    first, other = job("a", [True, False]), job("b", [True, True])
    of_now = other.model_copy(update={"forms": ("0.2.0-0123456789ab",)})
    with pytest.raises(NotComparableError, match=r"different forms .*a: 0\.1\.0; b: 0\.2\.0-0123456789ab"):
        compare([first, of_now])
    mixed = other.model_copy(update={"forms": ("0.1.0", "0.2.0-0123456789ab")})
    with pytest.raises(NotComparableError, match="their rate is of none"):
        compare([first, mixed])
    assert compare([of_now, of_now.model_copy(update={"job_id": "c"})]).tasks[0].goals == 2


def test_three_jobs_or_more_have_letters_for_all_of_them_together():
    good, poor = [True] * 40, [False] * 40
    (task,) = compare([job("ja", poor), job("jb", good), job("jc", [*good[:39], False])]).tasks
    assert [each.letters for each in task.jobs] == ["b", "a", "a"]
    (two,) = compare([job("ja", poor), job("jb", good)]).tasks
    assert [each.letters for each in two.jobs] == [None, None]


def test_a_job_that_a_question_ended_is_compared_with_what_holds_at_every_look():
    stopped = job("jb", [True] * 8).model_copy(update={"intervals": "sequence"})
    (task,) = compare([job("ja", [False] * 8), stopped]).tasks
    (difference,) = task.differences
    assert difference.at_every_look and mcnemar(8, 0) < difference.p < 0.05
    assert 0 < difference.interval_95[0] < paired_interval(8, 0, 8, 0.95)[0]
