"""Audit lines have a file of their own where one is named; all others go to standard error."""

import json
import logging
import stat

import pytest
import structlog

from services.__main__ import _log
from services.errors import NotReady
from services.settings import AUDIT


@pytest.fixture(autouse=True)
def configured_anew():
    root = logging.getLogger()
    handlers = list(root.handlers)
    yield
    root.handlers = handlers
    structlog.reset_defaults()


@pytest.mark.parametrize("named", [True, False])
def test_audit_lines_go_into_their_file_and_others_do_not(tmp_path, capsys, named):
    file = tmp_path / "audit.jsonl"
    _log(file if named else None)
    structlog.get_logger(AUDIT).info(AUDIT, action="POST /v1/jobs")
    structlog.get_logger().info("serving")
    said = [json.loads(line)["event"] for line in capsys.readouterr().err.splitlines()]
    assert said == (["serving"] if named else [AUDIT, "serving"])
    if named:
        assert [json.loads(line)["action"] for line in file.read_text().splitlines()] == ["POST /v1/jobs"]
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_lines_are_added_to_those_of_the_last_start(tmp_path):
    file = tmp_path / "audit.jsonl"
    for _ in range(2):
        _log(file)
        structlog.get_logger(AUDIT).info(AUDIT)
    assert len(file.read_text().splitlines()) == 2


def test_a_file_that_cannot_be_written_to_is_named_at_the_start(tmp_path):
    with pytest.raises(NotReady, match=r"TRIFARM_AUDIT_FILE names .*missing/audit, which cannot be written to"):
        _log(tmp_path / "missing" / "audit")
