"""What ``trifarm cluster status`` says."""

import json

from sim_backend.workers import __main__ as command
from sim_backend.workers.pool import WorkersError
from tests.cli_pages import SECTIONS, names_after

FOUND = {
    "address": "127.0.0.1:6379",
    "ray": "2.60.0",
    "sends_token": True,
    "nodes": [{"address": "127.0.0.1", "alive": True, "cpus": 2.0, "object_store_bytes": 1.0}],
    "cpus": 2.0,
    "free_cpus": 1.0,
}


def test_nodes_and_cores_are_shown(monkeypatch, capsys):
    monkeypatch.setattr(command, "status", lambda _: FOUND)
    assert command.main(["127.0.0.1:6379"]) == 0
    assert "127.0.0.1:6379, this side sends a token: 1 nodes, 1 of 2 cores free" in capsys.readouterr().out
    assert command.main(["127.0.0.1:6379", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == names_after("JSON keys", SECTIONS["cluster status"])


def test_a_cluster_that_cannot_be_had_is_an_error(monkeypatch, capsys):
    def refuse(_):
        raise WorkersError("nothing answers there")

    monkeypatch.setattr(command, "status", refuse)
    assert command.main(["127.0.0.1:6379"]) == 1
    assert capsys.readouterr().err == "error: nothing answers there\n"
