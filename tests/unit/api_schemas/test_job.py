"""A job's history: every kind of line has a name, a writer and a place in the documents, and those of other versions are read."""

import re

import pytest

from api_schemas.job import EventKind, JobEvent, JobState
from tests import ROOT


def line(kind):
    counts = {"trials_done": 0, "trials": 1, "successes": 0, "state": JobState.RUNNING}
    return JobEvent.model_validate({"id": 1, "job_id": "j", "at": "now", "kind": kind, "text": "t", **counts})


@pytest.mark.parametrize("kind", EventKind)
def test_known_kinds_are_names(kind):
    assert line(str(kind)).kind is kind


def test_a_kind_of_another_version_is_read_as_it_is():
    assert line("trial_paused").kind == "trial_paused"
    assert line("trial_paused").model_dump(mode="json")["kind"] == "trial_paused"


def test_every_kind_is_written_by_the_services_and_documented():
    code = "".join(path.read_text() for path in (ROOT / "services/jobs").glob("*.py"))
    assert set(re.findall(r"EventKind\.([A-Z_]+)", code)) == {kind.name for kind in EventKind}
    (documented,) = re.findall(r"`kind` of an event is (.*?)\.\s", (ROOT / "docs/http.md").read_text(), re.DOTALL)
    assert re.findall(r"`(\w+)`", documented) == [str(kind) for kind in EventKind]
