"""The attacker on answers: made-up robots whose answers tell nothing, and tell all."""

import numpy as np
import pytest

from api_schemas.why import WhyVerdict
from tests.benchmarks import leak
from tests.benchmarks.leak import QUESTIONS, failed_of, summary, table

ROBOTS = 20


def lines(told_of):
    """Logs that say nothing, and answers of each robot that blame the camera as often as ``told_of`` says."""
    rng = np.random.default_rng(3)
    made = []
    for robot in range(ROBOTS):
        truth = {"friction": rng.normal(), "delay": float(robot), "same": 0.3}
        made += [{"robot": robot, "stretch": k, "truth": truth, "logs": {"noise": rng.normal()}, "failed": []} for k in (0, 1)]
        named = [["late_camera"] if at < told_of(robot) else [] for at in range(ROBOTS)]
        answers = [
            {"robot": robot, "policy": "push-scratch", "verdict": "cause" if each else "chance", "named": each} for each in named
        ]
        made += answers
    return made


@pytest.mark.parametrize(("told_of", "leaks"), [(lambda _robot: 5, False), (lambda robot: robot, True)])
def test_what_answers_tell_is_noticed_and_nothing_is_nothing(told_of, leaks, monkeypatch):
    monkeypatch.setattr(leak, "SHUFFLES", 1)
    found = summary(lines(told_of))
    assert found["parameters"] == 2, "what is the same on every robot cannot be learned"
    assert np.isfinite(found["gained_by_answers"])
    assert (found["interval_95"][0] > 0) is leaks


def test_the_table_counts_groups_and_verdicts():
    found = table([line for line in lines(lambda _robot: 5) if "verdict" in line])
    assert found["kinds"]["one group"]["trials"] == 5 * ROBOTS == found["groups"]["late_camera"]["trials"]
    assert found["kinds"][WhyVerdict.CHANCE]["share"] == 0.75


def test_no_robot_is_asked_about_more_often_than_a_user_may():
    failed = [["push-scratch", at] for at in range(15)]
    made = [{"robot": 1, "stretch": k, "logs": {}, "failed": failed} for k in (1, 0)]
    assert len(failed_of(made)[1]) == QUESTIONS
