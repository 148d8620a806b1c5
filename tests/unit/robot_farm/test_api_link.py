"""What a robot keeps of what it fetched."""

import hashlib
import os

import httpx

from robot_farm.api_link import GRAPHS_KEPT, ApiLink


def test_the_graphs_that_were_wanted_last_are_kept(tmp_path, monkeypatch):
    with ApiLink("http://farm", "token") as link:
        asked = []

        def answer(_method, url):
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
