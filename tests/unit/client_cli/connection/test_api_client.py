import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from client_cli.connection.api_client import job_events
from tests.unit.client_cli.farm_server import JOB_ID, event

PAGE = b"<html>Sign in to the network</html>"


@contextmanager
def answering(body, **headers):
    """A server that answers everything with 200 and this, as a proxy before the farm may; gives its address."""

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            for name, value in {"content-length": str(len(body)), **headers}.items():
                self.send_header(name.replace("_", "-"), value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            """Says nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


REPORTS = [["report", JOB_ID], ["report", JOB_ID, "--html", "page.html"], ["compare", JOB_ID, JOB_ID]]


@pytest.mark.parametrize("body", [PAGE, b"[" * 100_000, b"[]"], ids=["page", "deep", "list"])
@pytest.mark.parametrize("command", REPORTS, ids=" ".join)
def test_what_is_no_report_is_not_shown_as_one(trifarm, monkeypatch, tmp_path, command, body):
    monkeypatch.chdir(tmp_path)
    with answering(body, content_type="text/html") as url:
        monkeypatch.setenv("TRIFARM_URL", url)
        ended, as_json = trifarm(*command), trifarm(*command, "--json")
    assert (ended.code, ended.out) == (1, "")
    assert "with something that is not a" in ended.err and len(ended.err.splitlines()) == 1
    assert as_json.code == as_json.document["error"]["exit_code"] == 1


def test_an_answer_that_cannot_be_unpacked_is_none(trifarm, monkeypatch):
    with answering(PAGE, content_encoding="gzip") as url:
        monkeypatch.setenv("TRIFARM_URL", url)
        ended = trifarm("status", "--json")
    assert ended.code == ended.document["error"]["exit_code"] == 4


@pytest.mark.parametrize("host", ["xn--a.example", f"{'a' * 100}.example", "a..example"])
def test_a_host_that_cannot_be_looked_up_is_wrong_usage(trifarm, monkeypatch, host):
    monkeypatch.setenv("TRIFARM_URL", f"http://{host}")
    ended = trifarm("status", "--json")
    assert ended.code == ended.document["error"]["exit_code"] == 2


def test_events_and_comments_are_told_apart():
    first, second = event(1, "job_queued"), event(2, "trial_leased", ordinal=0)
    lines = ["event: job_queued", "id: 1", f"data: {first.model_dump_json()}", "", ": alive", ""]
    lines += [f"data:{second.model_dump_json()}", ""]
    assert list(job_events(lines)) == [first, None, second]


def test_data_over_several_lines_are_one_event():
    whole = event(1, "job_queued")
    lines = [f"data: {line}" for line in whole.model_dump_json(indent=1).splitlines()]
    assert list(job_events([*lines, ""])) == [whole]


def test_an_event_that_was_cut_is_left_out():
    assert list(job_events(['data: {"id": 1,'])) == []
