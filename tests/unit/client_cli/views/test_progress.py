from dataclasses import replace
from functools import reduce

import pytest

from api_schemas.question import Question
from client_cli.terminal.output import duration
from client_cli.views.progress import JobProgress, advance, counted, estimate_s, question_sentence, sentence
from client_cli.views.progress_view import ProgressBar, ProgressLines
from tests.unit.client_cli.farm_server import event

EVENTS = [
    event(0, "job_queued"),
    event(10, "trial_leased", ordinal=0),
    event(10, "trial_leased", ordinal=1),
    event(11, "trial_running", ordinal=0),
    event(14, "trial_done", ordinal=0, done=1),
    event(15, "attempt_faulted", ordinal=1, done=1),
]


def test_events_move_the_progress_on():
    after = [reduce(advance, EVENTS[:n], JobProgress(trials=3)) for n in range(len(EVENTS) + 1)]
    assert [len(progress.running) for progress in after] == [0, 0, 1, 2, 2, 1, 0]
    assert after[-1].done == after[-1].successes == 1


def test_the_estimate_follows_the_servers_clock():
    progress = reduce(advance, EVENTS, JobProgress(trials=3))
    assert estimate_s(progress) == pytest.approx(8.0)  # one trial took 4 s, two are left
    assert estimate_s(JobProgress(trials=3)) is None


def test_the_sentence_names_successes_robots_and_estimate():
    progress = reduce(advance, EVENTS[:5], JobProgress(trials=3))
    told = "1 succeeded, 95 % interval 2–100 %, 1 running (robot-1), about 8 s left"
    assert sentence(progress) == told  # one success of one trial says hardly anything


def test_the_rate_is_of_the_first_trials_that_are_all_done():
    """The third trial has ended before the second, and does not count before it."""
    ended = JobProgress(trials=4, done=2, successes=1, ended=((0, True), (2, False)))
    assert counted(ended) == (1, 1)
    assert counted(replace(ended, ended=(*ended.ended, (1, True)))) == (2, 3)
    asked = replace(ended, question="open after 1 goals of at most 4")
    assert "open after 1 goals" in sentence(asked) and "rate" not in sentence(asked)


def test_each_robot_has_its_own_trials_and_successes():
    events = [event(1, "trial_done", ordinal=0, done=1), event(2, "trial_done", ordinal=1, done=2)]
    events.append(events[-1].model_copy(update={"id": 3, "trials_done": 3}))  # the third trial, on robot-1, did not succeed
    after = reduce(advance, events, JobProgress(trials=3, done=3, successes=2))  # as one who comes late sees it
    assert after.of_robots == (("robot-0", 1, 1), ("robot-1", 2, 1))


def test_the_sentence_says_why_a_job_waits_until_it_runs():
    waiting = JobProgress(trials=3, waiting_because="no robot is in service")
    assert sentence(waiting) == "0 succeeded, waiting: no robot is in service"
    assert "waiting" not in sentence(advance(waiting, EVENTS[1]))


def test_lines_come_for_every_twentieth_and_at_the_end(capsys):
    with ProgressLines() as lines:
        for done in range(101):
            lines.show(JobProgress(trials=100, done=done, successes=done))
        lines.show(JobProgress(trials=100, done=100, successes=100))
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 20
    assert printed[-1] == "100/100 done, 100 succeeded"


def test_the_bar_shows_the_sentence(capsys):
    with ProgressBar() as bar:
        bar.show(reduce(advance, EVENTS[:5], JobProgress(trials=3)))
        bar.say("connection lost")
    printed = capsys.readouterr().err
    assert "robot-0: 1 of 1 succeeded" in printed
    assert "connection lost" in printed
    assert "1/3" in printed


@pytest.mark.parametrize(("seconds", "text"), [(-1, "0 s"), (5, "5 s"), (600, "10 min"), (7200, "2 h"), (200_000, "2 d")])
def test_durations_have_one_unit(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("gained", "told"), [(3, "better on 3 goals, worse on 1: 95 % interval -5 to +30 points"), (None, "95 % interval 40–80 %")]
)
def test_a_question_is_told_in_words(gained, told):
    sequence = (-0.05, 0.3) if gained else (0.4, 0.8)
    question = Question.model_construct(gained=gained, lost=1, sequence_95=sequence)
    assert question_sentence(question) == told
