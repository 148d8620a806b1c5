"""The farm for programs: whatever a program gets wrong is a ClientError, and reports are written as what they are named."""

import subprocess
import sys
from pathlib import Path

import pytest

from api_schemas.builtin_policies import builtin_digest
from api_schemas.policy import LAYOUTS
from client_cli.commands import report
from client_cli.terminal.errors import ClientError
from services.jobs.reports import sign
from services.signing import FarmKey
from tests.unit.client_cli.farm_server import JOB_ID
from tests.unit.report_views.test_text import report as some_report
from tests.unit.report_views.test_text import trial
from trifarm import Farm

EXAMPLE = Path(__file__).resolve().parents[3] / "docs" / "examples" / "first_job.py"


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "push.onnx"
    path.write_bytes(b"weights")
    return path


@pytest.fixture
def signed(monkeypatch, tmp_path):
    body = some_report(trial(0))
    signature = sign(body.model_dump(mode="json"), FarmKey.of(tmp_path))
    monkeypatch.setattr(report, "_signed", lambda *_: (body, signature))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"task": "pusch"}, "'pusch' for a policy; choose from push, lift"),
        ({"task": "identify"}, "choose from push"),
        ({"trials": -1}, "trials is -1 and should be greater"),
        ({"priority": "soon"}, "priority is 'soon' and should be"),
        ({"object": "pear"}, "object is 'pear' and should be"),
        ({"webhook": "http://x"}, "https://"),
    ],
)
def test_what_cannot_be_asked_is_a_client_error(farm, weights, wrong, said):
    with Farm() as connection, pytest.raises(ClientError, match=said):
        connection.submit(weights, **{"task": "push", "layout": "rrc2022-push"} | wrong)
    assert not farm.submissions
    assert not farm.uploads


def test_a_webhook_is_passed_on(farm, weights):
    with Farm() as connection:
        connection.submit(weights, task="push", layout="rrc2022-push", webhook="https://example.org/ended")
    ((asked, _),) = farm.submissions
    assert asked.webhook == "https://example.org/ended"


def test_a_name_a_note_and_a_key_go_with_the_job(farm, weights):
    with Farm() as connection:
        connection.submit(weights, task="push", layout="rrc2022-push", name="third", note="more reward", idempotency_key="mine")
        with pytest.raises(ClientError, match="the name has 1000 characters"):
            connection.submit(weights, task="push", layout="rrc2022-push", name="n" * 1000)
    ((asked, key),) = farm.submissions
    assert (asked.name, asked.note, key) == ("third", "more reward", "mine")


def test_what_is_strange_about_a_policy_is_a_warning_before_the_job(farm, weights, tmp_path):
    farm.warnings = ("the output is constant",)
    other = tmp_path / "other.onnx"
    other.write_bytes(b"other weights")
    with Farm() as connection, pytest.warns(UserWarning) as heard:
        connection.submit(weights, task="lift", layout="rrc2022-push", against=str(other), until_known=True)
    of_another = "the policy reads rrc2022-push, the layout of push, and the job is lift, whose goals are of another kind"
    own = ["the output is constant", of_another]
    assert [str(each.message) for each in heard] == [f"other.onnx: {text}" for text in own] + own
    assert {each.filename for each in heard} == {__file__}, "they name the caller's line"
    assert len(farm.submissions) == 1
    with Farm() as connection, pytest.raises(UserWarning):  # as an error it leaves no job behind that nobody knows of
        connection.submit(weights, task="push", layout="rrc2022-push")
    assert len(farm.submissions) == 1


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"until_known": True}, "until_known needs against JOB|POLICY or bar RATE"),
        ({"bar": 0.5}, "against, bar, max_trials and at_least go with until_known; .* take like JOB and 'trifarm compare'"),
        ({"until_known": True, "bar": 0.5, "trials": 4}, "until_known takes max_trials N .*, not trials"),
        ({"task": None}, "task names what is asked"),
    ],
)
def test_what_contradicts_is_told_with_arguments(farm, weights, wrong, said):
    with Farm() as connection, pytest.raises(ClientError, match=said) as refused:
        connection.submit(weights, **{"task": "push", "layout": "rrc2022-push"} | wrong)
    assert "--" not in str(refused.value) == refused.value.detail


def test_files_may_be_named_by_strings(farm, weights, tmp_path):
    manifest = tmp_path / "other.json"
    manifest.write_text(LAYOUTS["rrc2022-push"].model_dump_json())
    with Farm() as connection:
        connection.submit(str(weights), task="push", manifest=str(manifest))
    assert len(farm.submissions) == 1


def test_a_policy_that_comes_with_the_farm_needs_no_file(farm):
    with Farm() as connection:
        connection.submit("builtin:grasp", task="push")
        with pytest.raises(ClientError, match="builtin:grasp-turn"):
            connection.submit("builtin:dance", task="push")
    ((asked, _),) = farm.submissions
    assert asked.policy == builtin_digest("grasp")


@pytest.mark.parametrize(("name", "begins"), [("r.html", b"<!"), ("r.pdf", b"%PDF"), ("r.PDF", b"%PDF")])
def test_a_report_is_what_its_name_says(farm, signed, tmp_path, name, begins):
    with Farm() as connection:
        connection.job(JOB_ID).save_report(tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.parametrize(
    ("path", "said"), [("/nonexistent/x.html", "cannot use /nonexistent/x.html"), ("x.txt", ".html or .pdf")]
)
def test_a_report_that_cannot_be_written_is_a_client_error(farm, signed, path, said):
    with Farm() as connection, pytest.raises(ClientError, match=said):
        connection.job(JOB_ID).save_report(path)


@pytest.mark.parametrize("named", [False, True])
def test_reports_and_trials_are_shared_by_themselves_or_by_their_ids(farm, named):
    with Farm() as connection:
        job = connection.job(JOB_ID)
        report = connection.share(job.id if named else job)
        first = next(job.trials())
        moment = connection.share(first.trial.trial_id if named else first, at_s=2.7, days=30)
        assert [each.share_id for each in connection.shares()] == ["s1"]
        connection.revoke_share("s1" if named else moment)
    assert (report.trial_id, report.url) == (None, "http://farm/shared/hush")
    assert (moment.trial_id, moment.at_s) == (first.trial.trial_id, 2.7)
    assert farm.commands == ["revoke s1"]


@pytest.mark.parametrize(
    ("what", "more", "said"),
    [
        ("job", {}, "'job' is neither a job nor a trial; a job reads like"),
        (JOB_ID, {"at_s": 1.0}, "a report has none"),
        (JOB_ID, {"days": 91}, "days is 91 and should be less"),
        (f"{JOB_ID}-007", {"at_s": -1.0}, "at_s is -1.0 and should be greater"),
    ],
)
def test_what_cannot_be_shared_is_a_client_error(farm, what, more, said):
    with Farm() as connection, pytest.raises(ClientError, match=said):
        connection.share(what, **more)


def test_the_example_says_how_it_is_used():
    ended = subprocess.run([sys.executable, EXAMPLE], stderr=subprocess.PIPE, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (1, "usage: python first_job.py WEIGHTS [TRIALS]\n")
