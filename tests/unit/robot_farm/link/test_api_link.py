"""What a robot keeps of what it fetched."""

import hashlib
import os

import httpx
import pytest

from robot_farm.link.api_link import GRAPHS_KEPT, ApiLink


def test_the_graphs_that_were_wanted_last_are_kept(tmp_path, monkeypatch):
    with ApiLink("http://farm", "token") as link:
        asked = []

        def answer(_method, url, **_):
            asked.append(url)
            return httpx.Response(200, content=url.split("/")[3].encode())

        monkeypatch.setattr(link, "_patiently", answer)

        def fetch(number):
            return link.fetch_graph(f"{number}", hashlib.sha256(f"{number}".encode()).hexdigest(), tmp_path)

        for number in range(GRAPHS_KEPT):
            os.utime(fetch(number), (number, number))
        assert fetch(0).read_bytes() == b"0" and len(asked) == GRAPHS_KEPT
        fetch(GRAPHS_KEPT)
        kept = {path.read_bytes() for path in tmp_path.iterdir()}
    assert kept == {b"%d" % number for number in range(GRAPHS_KEPT + 1) if number != 1}


@pytest.mark.parametrize("left", [b"", b"gra", b"GRaph"])
def test_what_a_power_cut_left_of_a_graph_is_fetched_anew(tmp_path, monkeypatch, left):
    with ApiLink("http://farm", "token") as link:
        monkeypatch.setattr(link, "_patiently", lambda _method, _url, **_: httpx.Response(200, content=b"graph"))
        for _ in range(2):
            path = link.fetch_graph("digest", hashlib.sha256(b"graph").hexdigest(), tmp_path)
            assert path.read_bytes() == b"graph"
            path.write_bytes(left)
