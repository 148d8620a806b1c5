"""Evaluations beside a training: they return at once, tell how far they are, and end no training; with the real libraries."""

import time
from threading import Event

import pytest

import trifarm
from api_schemas.job import JobState
from api_schemas.report import Report
from client_cli.terminal.errors import ClientError, UsageProblem
from tests.unit.client_cli.farm_server import JOB_ID
from tests.unit.report_views.test_text import report, trial
from tests.unit.trifarm import trained
from trifarm.callbacks import Evaluations

WITHIN_S = 120.0
REPORT = report(trial(0), trial(1)).model_dump_json().encode()


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    pytest.importorskip("torch")
    import torch

    actor = torch.nn.Sequential(torch.nn.Linear(75, 8), torch.nn.Tanh(), torch.nn.Linear(8, 9))
    return trifarm.save_policy(actor, trifarm.TrifingerEnv("push"), tmp_path_factory.mktemp("policy") / "mine").weights


def test_it_returns_at_once_tells_how_far_it_is_and_gives_the_report(farm, policy, monkeypatch):
    monkeypatch.setattr("trifarm.evaluation.LOOK_EVERY_S", 0.02)
    farm.state, farm.report = JobState.RUNNING, REPORT
    told = Event()
    handle = trifarm.evaluate(policy, "push", 3, seed=5, step=7, on_end=lambda ended: told.set())
    assert not handle.done, "it returned though the job has not ended, nor will before it is told to"
    with pytest.raises(TimeoutError, match="of 3 trials are done"):
        while handle.job is None:
            time.sleep(0.01)
        handle.result(0.05)
    assert handle.progress == (0, 3)
    farm.state = JobState.SUCCEEDED
    assert isinstance(handle.result(WITHIN_S), Report) and handle.done and told.wait(WITHIN_S)
    asked, _ = farm.submissions[-1]
    assert (asked.trials, asked.seed, asked.question, handle.step, handle.job.job_id) == (3, 5, None, 7, JOB_ID)


@pytest.mark.parametrize(
    ("known", "bar", "against"), [(0.8, 0.8, None), ("j" + "a" * 12, None, "j" + "a" * 12), ("f" * 64, None, "f" * 64)]
)
def test_a_number_is_a_bar_and_anything_else_is_compared_with(farm, policy, known, bar, against):
    farm.report = REPORT
    trifarm.evaluate(policy, "push", 50, until_known=known).result(WITHIN_S)
    asked, _ = farm.submissions[-1]
    assert (asked.question.bar, asked.question.against) == (bar, against)
    assert asked.trials in (50, 3), "a job that is compared with has three"


def test_what_says_nothing_together_is_said_before_anything_is_sent(farm, policy):
    with pytest.raises(UsageProblem, match="a success rate such as"):
        trifarm.evaluate(policy, "push", until_known=True)
    with pytest.raises(UsageProblem, match="name it with env="):
        trifarm.evaluate(object(), "push")
    with pytest.raises(UsageProblem, match="manifest beside it"):
        trifarm.evaluate(policy, "push", env=object())
    assert farm.submissions == []


def test_errors_come_with_the_result(home, policy):
    handle = trifarm.evaluate(policy, "push", farm="http://127.0.0.1:9")
    with pytest.raises(ClientError):
        handle.result(WITHIN_S)
    handle = trifarm.evaluate("nowhere.safetensors", "push", farm="http://127.0.0.1:9")
    with pytest.raises(ClientError, match=r"nowhere\.safetensors"):
        handle.result(WITHIN_S)


def test_stable_baselines3_records_what_the_farm_says_while_it_learns(farm, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.logger import KVWriter, Logger

    monkeypatch.setattr("trifarm.evaluation.LOOK_EVERY_S", 0.02)
    farm.report = REPORT
    model, _, _ = trained.stable_baselines3()
    written = []

    class Kept(KVWriter):
        def write(self, key_values, key_excluded, step=0):
            written.append(dict(key_values))

        def close(self):
            pass

    model.set_logger(Logger(None, [Kept()]))
    callback = trifarm.EvaluateOnFarm("push", every=16, trials=3, seed=5, timeout_s=WITHIN_S)
    model.learn(32, callback=callback)
    assert [each.step for each in callback.found if each.report] == [each.step for each in callback.found]
    assert callback.found[0].step == 16 and len(farm.submissions) == len(callback.found) >= 1
    last = [row for row in written if "farm/success_rate" in row][-1]
    assert last["farm/success_rate"] == callback.found[-1].report.success_rate
    assert last["farm/of_step"] == callback.found[-1].step and last["farm/low_80"] <= last["farm/success_rate"]


def test_rsl_rl_records_what_the_farm_says_while_it_learns(farm, monkeypatch, tmp_path):
    pytest.importorskip("rsl_rl", reason="rsl_rl is not installed")
    monkeypatch.setattr("trifarm.evaluation.LOOK_EVERY_S", 0.02)
    farm.report = REPORT
    runner, _, _ = trained.rsl_rl()
    written = []

    class Writer:
        def add_scalar(self, name, value, step):
            written.append((name, value, step))

        def __getattr__(self, _name):
            return lambda *_given, **_named: None

    runner.logger.writer, runner.logger.log_dir = Writer(), str(tmp_path)
    monkeypatch.setattr(runner.logger, "init_logging_writer", lambda: None)
    monkeypatch.setattr(runner, "save", lambda *_given: None)
    log = runner.logger.log
    with trifarm.evaluate_runner(runner, "push", every=2, trials=3, seed=5, timeout_s=WITHIN_S) as evaluations:
        runner.learn(4)
    assert runner.logger.log == log, "the runner is as it was"
    assert evaluations.found and all(each.report for each in evaluations.found)
    assert len(farm.submissions) == len(evaluations.found)
    assert ("farm/success_rate", evaluations.found[0].report.success_rate) in [each[:2] for each in written]


def test_one_evaluation_goes_on_at_a_time_and_a_farm_that_is_away_ends_no_training(farm, policy, monkeypatch):
    monkeypatch.setattr("trifarm.evaluation.LOOK_EVERY_S", 0.02)
    farm.state, farm.report, recorded = JobState.RUNNING, REPORT, {}
    several = Evaluations("push", 10, {"trials": 3})
    for step in (10, 20, 25, 30):
        several.look(step, policy, None, recorded.__setitem__)
    assert several.skipped == [20, 30] and several.found == [] and recorded == {}
    farm.state = JobState.FAILED
    several.finish(recorded.__setitem__, WITHIN_S)
    (found,) = several.found
    assert (found.step, found.report) == (10, None) and "robot-1 vanished" in found.problem
    away = Evaluations("push", 10, {"farm": "http://127.0.0.1:9"})
    away.look(10, policy, None, recorded.__setitem__)
    away.finish(recorded.__setitem__, WITHIN_S)
    assert away.found[0].problem and recorded == {}
