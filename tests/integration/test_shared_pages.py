"""Shares: links that need no token lead to one report or one trial, as long as they are open, and nobody else gets in by them."""

import json
import re
import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import httpx
import pytest

from services.api.rate_limits import BURST_S
from services.dashboard.shared_page import OPENINGS_PER_S
from tests.integration.farm_process import services, small_policy

HOSTILE = "<b>\"'&{{7*7}}"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("shared") / "farm", shares="true", anonymous_requests_per_s=0) as running:
        running.start_robots(2, trial_s=0.02)
        yield running


@pytest.fixture(scope="module")
def ann(farm):
    return farm.client(farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()["secret"])


@pytest.fixture(scope="module")
def bob(farm):
    return farm.client(farm.admin.post("/v1/tokens", json={"owner": "bob", "scopes": ["submit"]}).json()["secret"])


@pytest.fixture(scope="module")
def job(farm, ann):
    weights, manifest = small_policy()
    digest = farm.upload(weights, manifest.model_copy(update={"name": HOSTILE}), client=ann).json()["digest"]
    job_id = farm.submit(digest, client=ann, trials=3).json()["job_id"]
    farm.wait_for_end(job_id)
    return job_id


@pytest.fixture
def anybody():
    with httpx.Client() as client:
        yield client


def shared(client, **wish):
    made = client.post("/v1/shares", json=wish)
    assert made.status_code == 201, made.text
    return made.json()


def test_a_report_is_seen_without_a_token_until_it_is_revoked(farm, ann, anybody, job):
    made = shared(ann, job=job)
    seen = anybody.get(made["url"])
    assert seen.status_code == 200 and "&lt;b&gt;" in seen.text and "<b>\"'" not in seen.text
    for answer in (seen, anybody.get(made["url"][:-1] + "_")):
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["cache-control"] == "no-store"
        assert "noindex" in answer.headers["x-robots-tag"]
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "unsafe" not in answer.headers["content-security-policy"]
    assert ann.delete(f"/v1/shares/{made['share_id']}").status_code == 204
    assert anybody.get(made["url"]).status_code == 404, "at once"
    assert [(each["is_open"], each["revoked_at"] is None) for each in ann.get("/v1/shares").json()["shares"]] == [(False, False)]


def test_a_trial_is_seen_from_its_moment_and_nothing_else_of_the_farm(farm, ann, anybody, job):
    made = shared(ann, trial=f"{job}-001", at_s=2.7)
    page = anybody.get(made["url"])
    assert page.status_code == 200 and made["url"].endswith("?t=2.70") and 'data-at="2.7"' in page.text
    assert "<script>" not in page.text and " style=" not in page.text
    inside = set(re.findall(r'(?:href|src|data-source|action)="([^"]*)"', page.text))
    own = made["url"].removeprefix(farm.api).partition("?")[0]
    assert {each for each in inside if not each.startswith(("/static/", "#", "?"))} == {"/", f"{own}/replay"}
    assert f"/jobs/{job}" not in page.text and f"{job}-000" not in page.text
    assert anybody.get(f"{farm.api}{own}/replay").status_code == 503, "a scripted robot's log is none that can be read"
    for path in (f"/trials/{job}-001", f"/v1/trials/{job}-001", f"/v1/trials/{job}-001/log"):
        assert anybody.get(farm.api + path).status_code == 401
    report = shared(ann, job=job)["url"]
    assert anybody.get(f"{report}/replay").status_code == 404


def test_links_are_long_and_kept_as_hashes_and_stand_in_no_log(farm, ann, anybody, job):
    links = [shared(ann, job=job)["url"] for _ in range(3)]
    secrets = [link.rpartition("/")[2] for link in links]
    assert len({len(each) for each in secrets}) == 1 and len(secrets[0]) * 6 >= 128 and len(set(secrets)) == 3
    anybody.get(links[0])
    with sqlite3.connect(f"file:{farm.data / 'farm.sqlite'}?mode=ro", uri=True) as database:
        kept = json.dumps(database.execute("select * from share").fetchall())
    said = farm.errors.read_text()
    assert not any(each in kept or each in said for each in secrets)
    lines = [line for line in said.splitlines() if "share" in line]
    assert any("share made" in line and "ann" in line for line in lines) and any("share read" in line for line in lines)
    assert any("POST /v1/shares" in line and "audit" in line for line in lines)


def test_only_what_one_may_see_is_shared_and_only_ones_own_revoked(farm, ann, bob, anybody, job):
    assert bob.post("/v1/shares", json={"job": job}).status_code == 404
    assert bob.post("/v1/shares", json={"trial": f"{job}-000"}).status_code == 404
    made = shared(ann, job=job)
    assert bob.delete(f"/v1/shares/{made['share_id']}").status_code == 404
    assert bob.get("/v1/shares").json()["shares"] == []
    assert anybody.get(made["url"]).status_code == 200
    by_operator = shared(farm.admin, job=job)
    assert by_operator["share_id"] in {each["share_id"] for each in ann.get("/v1/shares").json()["shares"]}, "of her job"
    assert ann.delete(f"/v1/shares/{by_operator['share_id']}").status_code == 204
    assert anybody.get(by_operator["url"]).status_code == 404


def test_a_link_ends_by_itself_and_with_its_makers_token(farm, ann, anybody, job):
    short = shared(ann, job=job, days=1)
    assert anybody.get(short["url"]).status_code == 200
    token = farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()
    made = shared(farm.client(token["secret"]), job=job)
    farm.admin.delete(f"/v1/tokens/{token['token_id']}")
    assert anybody.get(made["url"]).status_code == 404
    with closing(sqlite3.connect(farm.data / "farm.sqlite")) as database, database:
        database.execute("UPDATE share SET expires_s = expires_s - 86401 WHERE share_id = ?", (short["share_id"],))
    assert anybody.get(short["url"]).status_code == 404


def test_a_wish_names_one_thing(ann, job):
    for wish in ({}, {"job": job, "trial": f"{job}-000"}, {"job": job, "at_s": 1}, {"job": job, "days": 91}):
        assert ann.post("/v1/shares", json=wish).status_code == 422


def test_a_link_is_opened_so_often_and_no_more(ann, anybody, job):
    made = shared(ann, job=job)
    started, codes = time.monotonic(), []
    with ThreadPoolExecutor(8) as visitors:  # together: one after the other a slow machine might never be too quick
        while 429 not in codes and len(codes) < 400:
            codes += visitors.map(lambda _: anybody.get(made["url"], timeout=60).status_code, range(8))
    assert set(codes) == {200, 429}
    held = OPENINGS_PER_S * BURST_S
    assert held <= codes.count(200) <= held + OPENINGS_PER_S * (time.monotonic() - started)
    assert anybody.get(shared(ann, job=job)["url"]).status_code == 200, "another link is not held up"


def test_a_button_shares_and_shows_the_link_once(farm, ann, anybody, job):
    token = farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()["secret"]
    with httpx.Client(base_url=farm.api) as browser:
        browser.post("/sign-in", data={"token": token})
        word = browser.get(f"/jobs/{job}").text.split('name="csrf" value="')[1].split('"')[0]
        assert f'action="/jobs/{job}/share"' in browser.get(f"/jobs/{job}").text
        assert browser.post(f"/jobs/{job}/share", data={"days": "1"}).status_code == 403, "only by a form of ours"
        shown = browser.post(f"/trials/{job}-000/share", data={"csrf": word, "days": "1", "at_s": "1.5"}).text
        link = re.search(r'value="(http[^"]*)"', shown)[1]
        assert link.endswith("?t=1.50") and anybody.get(link).status_code == 200
        listed = browser.get("/shares").text
        assert link.partition("?")[0] not in listed and f"trial {job}-000" in listed
        (share_id, *_) = re.findall(r"/shares/(s[a-z2-7]+)/revoke", listed)
        assert browser.post(f"/shares/{share_id}/revoke", data={"csrf": word}).status_code == 200
        assert anybody.get(link).status_code == 404


def test_a_farm_shares_nothing_unless_its_operator_wants_it(tmp_path, farm, ann, anybody, job):
    made = shared(ann, job=job)
    farm.stop()
    del farm.settings["TRIFARM_SHARES"]
    farm.start()
    assert anybody.get(made["url"]).status_code == 404
    refused = ann.post("/v1/shares", json={"job": job})
    assert (refused.status_code, refused.json()["type"]) == (422, "/problems/shares-off")
