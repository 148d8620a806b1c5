"""Why trials failed: a log is simulated here by another program, trials and jobs are the farm's to explain."""

import json
import sys
from typing import cast

import pytest

from api_schemas.error import Problem
from api_schemas.trial import FAULT_OF, Outcome, OutcomeKind, Trial, TrialState
from api_schemas.why import TrialWhy, Why, WhyEffect, WhyGroup, WhyState, WhyVerdict
from client_cli.commands import why as command
from client_cli.connection.api_client import ApiClient
from client_cli.terminal.errors import Refused

GROUP = WhyGroup(name="late_camera", words="a late camera", explains=True, turned=True, successes=4, replays=4)
EFFECT = WhyEffect(name="tracking_latency", turned=True, successes=4, replays=4, explains=True, values={"extra_s": 0.4})
FOUND = Why(
    trial="j1-000",
    verdict=WhyVerdict.CAUSE,
    groups=(GROUP,),
    control_successes=0,
    control_replays=4,
    effects=(EFFECT,),
    replays=9,
)


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / name for name in ("trial-000.mcap", "trial-000.truth.mcap")]
    for path in paths:
        path.write_bytes(b"bytes")
    return [str(path) for path in paths]


@pytest.fixture
def explaining(monkeypatch):
    def use(document, code=0):
        program = f"import sys; print({document!r}); sys.exit({code})"
        monkeypatch.setattr(command, "module_command", lambda *_rest: [sys.executable, "-c", program])

    return use


def test_a_log_is_explained_with_effects_and_values(trifarm, files, explaining):
    explaining(FOUND.model_dump_json())
    ended = trifarm("why", files[0], "--truth", files[1], "--policy", "builtin:grasp")
    assert ended.code == 0
    assert "it succeeds without a late camera (4 of 4 replays); 0 of 4 replays with other noise alone" in ended.out
    assert "tracking_latency" in ended.out and "extra_s 0.4" in ended.out
    ended = trifarm("why", files[0], "--truth", files[1], "--policy", "builtin:grasp", "--json")
    assert Why.model_validate_json(ended.out) == FOUND


@pytest.mark.parametrize("code", [2, 6, 10])
def test_a_log_that_cannot_be_explained_is_refused_with_the_reason(trifarm, files, explaining, code):
    explaining(json.dumps({"error": "the log is of scene form 0.1.0"}), code)
    ended = trifarm("why", files[0], "--truth", files[1], "--policy", "builtin:grasp")
    assert (ended.code, "scene form 0.1.0" in ended.err) == (code, True)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ([], "give both"),
        (["--truth", "nothing.mcap", "--policy", "builtin:grasp"], "there is no file nothing.mcap"),
    ],
)
def test_a_log_needs_its_truth_and_its_policy(trifarm, files, more, said):
    ended = trifarm("why", files[0], *more)
    assert (ended.code, said in ended.err) == (2, True)


class Server:
    """Answers of a farm: the first question waits a little, the last is beyond the budget."""

    looks = 0

    def trials(self, job_id):
        kinds = [OutcomeKind.FAILED, OutcomeKind.SUCCEEDED, OutcomeKind.FAILED, OutcomeKind.FAILED]
        return [
            Trial.model_construct(
                trial_id=f"{job_id}-{number:03d}",
                state=TrialState.DONE,
                outcome=Outcome(kind=kind, fault=FAULT_OF[kind], reason="it ended"),
            )
            for number, kind in enumerate(kinds)
        ]

    def ask_why(self, trial_id):
        if trial_id.endswith("3"):
            problem = {"type": "/problems/why-budget-used", "title": "Too many", "status": 429, "detail": "asked 20 times"}
            raise Refused(Problem.model_validate(problem))
        return TrialWhy(trial=trial_id, state=WhyState.QUEUED)

    def why(self, trial_id):
        self.looks += 1
        return TrialWhy(trial=trial_id, state=WhyState.DONE, sentence=FOUND.for_users().sentence, why=FOUND.for_users())


def test_a_job_is_a_table_of_groups_and_says_what_was_refused(monkeypatch, capsys):
    monkeypatch.setattr(command, "LOOK_EVERY_S", 0.0)
    table = command._of_job(cast("ApiClient", Server()), "j1", 20)
    assert (table.failed, table.answered, [group.trials for group in table.groups]) == (3, 2, [2])
    err = capsys.readouterr().err
    assert "j1-003 is left out: asked 20 times" in err
    assert "2 of 2 trials" in err
    command._show_job(table)
    out = capsys.readouterr().out
    assert "100%" in out and "the cause is a group in 2, chance in 0" in out
