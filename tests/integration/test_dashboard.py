"""The dashboard without a browser: who gets in, what every answer forbids, and what a stranger or another site cannot do."""

import json
import time
from contextlib import ExitStack

import httpx
import pytest

from services.dashboard.farm_page import KEPT_S
from services.dashboard.live import MOST_STREAMS
from tests.integration.farm_process import PATIENCE_S, services, small_policy, until

HOSTILE = "<b>\"'&{{7*7}}"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("dashboard") / "farm") as running:
        running.start_robots(2, trial_s=0.02)
        yield running


@pytest.fixture(scope="module")
def job(farm):
    weights, manifest = small_policy()
    digest = farm.upload(weights, manifest.model_copy(update={"name": HOSTILE})).json()["digest"]
    job_id = farm.submit(digest, trials=8).json()["job_id"]
    farm.wait_for_end(job_id)
    return job_id


def signed_in(farm, token):
    client = httpx.Client(base_url=farm.api, timeout=PATIENCE_S)
    farm.clients.append(client)
    answer = client.post("/sign-in", data={"token": token, "then": "/jobs"})
    assert (answer.status_code, answer.headers.get("location")) == (303, "/jobs")
    return client


@pytest.fixture(scope="module")
def operator(farm):
    return signed_in(farm, farm.tokens["admin"])


def user_token(farm, owner):
    return farm.admin.post("/v1/tokens", json={"owner": owner, "scopes": ["submit"]}).json()


def word(client):
    return client.get("/jobs").text.split('name="csrf" value="')[1].split('"')[0]


def test_the_cookie_is_out_of_reach_and_holds_no_readable_token(farm):
    answer = httpx.post(f"{farm.api}/sign-in", data={"token": farm.tokens["admin"]})
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=lax" in cookie
    assert farm.tokens["admin"].split("_", 2)[2] not in cookie


@pytest.mark.parametrize("path", ["/", "/jobs", "/live", "/live/jobs", "/compare", "/jobs/jx", "/trials/jx-000", "/jobs/jx/live"])
def test_nothing_is_shown_without_a_session(farm, path):
    assert httpx.get(farm.api + path, headers={"Accept": "text/html"}).status_code == 303
    assert httpx.get(farm.api + path).status_code == 401
    assert httpx.get(farm.api + path, cookies={"trifarm_session": "made-up"}).status_code == 401


def test_an_address_that_leads_nowhere_leads_on(farm, operator):
    browser = {"Accept": "text/html,application/xhtml+xml"}
    found = operator.get("/nothing/<b>here", headers=browser)
    assert found.status_code == 404 and "default-src 'none'" in found.headers["content-security-policy"]
    assert 'href="/jobs"' in found.text and 'aria-label="Pages"' in found.text and "<b>here" not in found.text
    stranger = httpx.get(f"{farm.api}/nothing", headers=browser)
    assert stranger.status_code == 404 and 'aria-label="Pages"' not in stranger.text
    assert operator.get("/nothing").json()["type"] == "/problems/no-such-route", "programs get what they always got"


def test_what_does_not_change_is_sent_packed_and_once(operator):
    packed = operator.get("/static/three.js")
    assert packed.headers["content-encoding"] == "gzip" and int(packed.headers["content-length"]) < 150_000
    plain = operator.get("/static/three.js", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers and plain.text == packed.text
    again = operator.get("/static/three.js", headers={"If-None-Match": packed.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_trials_are_a_table_for_whoever_may_see_them(farm, job):
    with httpx.Client(headers={"Authorization": f"Bearer {user_token(farm, 'eve')['secret']}"}) as stranger:
        assert stranger.get(f"{farm.api}/v1/jobs/{job}/trials.csv").status_code == 404
    lines = farm.admin.get(f"/v1/jobs/{job}/trials.csv").text.splitlines()
    assert lines[0].startswith("job_id,trial,trial_id,state,") and len(lines) == 9


def test_every_page_forbids_what_is_foreign_and_shows_names_as_text(operator, job):
    for path in ("/", "/jobs", f"/jobs/{job}", f"/trials/{job}-000", f"/compare?jobs={job}", "/jobs/jnone", "/static/live.js"):
        answer = operator.get(path)
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy, path
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert " style=" not in answer.text and "<style" not in answer.text and "<script>" not in answer.text
        assert '<b>"' not in answer.text
    assert "&lt;b&gt;&#34;&#39;&amp;{{7*7}}" in operator.get(f"/jobs/{job}").text
    report = operator.get(f"/jobs/{job}/report")
    assert "unsafe" not in report.headers["content-security-policy"]
    assert "&lt;b&gt;" in report.text


def test_a_stranger_sees_nothing_of_others(farm, job):
    client = signed_in(farm, user_token(farm, "bob")["secret"])
    for path in (f"/jobs/{job}", f"/jobs/{job}/live", f"/jobs/{job}/report", f"/trials/{job}-000", f"/trials/{job}-000/log"):
        assert client.get(path).status_code == 404, path
    assert job not in client.get("/jobs").text
    assert client.get(f"/compare?jobs={job},{job[::-1]}").status_code == 404
    assert client.post(f"/jobs/{job}/cancel", data={"csrf": word(client)}).status_code == 404
    assert client.post("/robots/robot-0/drain", data={"csrf": word(client)}).status_code == 403


def test_only_our_own_forms_change_anything(farm, operator):
    path, good = "/robots/robot-0/drain", {"csrf": word(operator)}
    assert operator.post(path).status_code == 403
    assert operator.post(path, data={"csrf": "0" * 64}).status_code == 403
    assert operator.post(path, data=good, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert operator.post(path, data=good, headers={"Sec-Fetch-Site": "same-site"}).status_code == 403
    foreign = {"Sec-Fetch-Site": "cross-site"}
    assert httpx.post(f"{farm.api}/sign-in", data={"token": farm.tokens["admin"]}, headers=foreign).status_code == 403
    assert farm.robots_in("draining") == 0
    assert operator.post(path, data=good).status_code == 303
    assert farm.robots_in("draining") == 1
    assert operator.post("/robots/robot-0/resume", data=good).status_code == 303
    until(lambda: farm.robots_in("idle") == 2, PATIENCE_S, "both robots to be idle")


def test_a_revoked_token_ends_its_pages_and_its_streams(farm):
    token = user_token(farm, "carl")
    client = signed_in(farm, token["secret"])
    with client.stream("GET", "/live") as answer:
        lines = answer.iter_lines()
        assert next(lines) == "event: parts"
        assert "robot-robot-0" in json.loads(next(lines).removeprefix("data: "))
        farm.admin.delete(f"/v1/tokens/{token['token_id']}")
        list(lines)  # ends, which it would not while the token is good
    assert client.get("/", headers={"Accept": "text/html"}).headers["location"] == "/sign-in?then=/"


def test_each_viewer_sees_of_a_robot_what_is_his_whoever_looked_before(farm):
    secret = user_token(farm, "alice")["secret"]
    alice, bob = signed_in(farm, secret), signed_in(farm, user_token(farm, "bob")["secret"])
    farm.start_robot("robot-long", trial_s=600)
    until(lambda: farm.robots_in("idle") == 3, PATIENCE_S, "a third robot")
    client = farm.client(secret)
    asked = []  # who comes is written down a tenth of a second later, and nobody else can be asked for

    def is_asked():
        asked.append(farm.identify(client, robot="robot-long"))
        return asked[-1].is_success

    until(is_asked, PATIENCE_S, "the robot to be written down")
    job_id = asked[-1].json()["job_id"]
    until(lambda: farm.robots_in("running") == 1, PATIENCE_S, "the robot to run it")

    def pages(*viewers):
        time.sleep(2 * KEPT_S)
        return [each.get("/").text.split('id="robot-robot-long"')[1].split("</div></dl>")[0] for each in viewers]

    (first_of_alice, second_of_bob), (first_of_bob, second_of_alice) = pages(alice, bob), pages(bob, alice)
    assert farm.robots_in("running") == 1, "the trial ran all the while"
    for seen in (first_of_alice, second_of_alice):
        assert f"{job_id}-0" in seen and "another user" not in seen
    for seen in (first_of_bob, second_of_bob):
        assert job_id not in seen and "another user's</dd>" in seen, "and not how far it is"
    farm.admin.post(f"/v1/jobs/{job_id}/cancel")
    farm.wait_for_end(job_id)
    farm.robots["robot-long"].terminate()


def test_a_session_that_was_signed_out_is_over_for_whoever_has_its_cookie(farm):
    secret = user_token(farm, "dora")["secret"]
    client, other = signed_in(farm, secret), signed_in(farm, secret)
    copied = dict(client.cookies)
    with client.stream("GET", "/live") as answer:
        lines = answer.iter_lines()
        assert next(lines) == "event: parts"
        assert client.post("/sign-out", data={"csrf": word(client)}).headers["location"] == "/sign-in"
        assert "event: anew" in list(lines)
    assert httpx.get(f"{farm.api}/jobs", cookies=copied).status_code == 401
    assert other.get("/jobs").status_code == 200, "each session ends by itself"


def test_an_owner_has_so_many_live_pages_and_no_more(farm):
    secret = user_token(farm, "emma")["secret"]
    client, other = signed_in(farm, secret), signed_in(farm, user_token(farm, "finn")["secret"])
    with ExitStack() as opened:
        for _ in range(MOST_STREAMS):
            assert opened.enter_context(client.stream("GET", "/live/jobs")).status_code == 200
        refused = client.get("/live", headers={"Accept": "text/event-stream"})
        assert (refused.status_code, refused.json()["type"]) == (429, "/problems/too-many-streams")
        assert int(refused.headers["Retry-After"]) > 0
        with other.stream("GET", "/live") as answer:
            assert answer.status_code == 200, "another owner is not held up"

    def may_again():
        with client.stream("GET", "/live") as answer:
            return answer.status_code == 200

    until(may_again, PATIENCE_S, "closed pages to be forgotten")


def test_the_signed_report_is_the_same_for_all_who_ask(farm, operator, job):
    page = operator.get(f"/jobs/{job}/report").text
    signature = farm.admin.get(f"/v1/jobs/{job}/report/signature").json()
    assert signature["signature"] in page
    saved = operator.get(f"/jobs/{job}/report?save=true")
    assert (saved.text, f"report-{job}.html" in saved.headers["content-disposition"]) == (page, True)
    assert signature["key"] == farm.admin.get("/v1/key").json()["key"]
    assert signature["report_sha256"] == farm.admin.get(f"/v1/jobs/{job}/report").headers["etag"].strip('"')


def test_a_log_that_is_none_is_said_and_nothing_breaks(operator, job):
    answer = operator.get(f"/trials/{job}-000/replay")  # a scripted robot's logs are bytes without sense
    assert answer.status_code == 503
    assert "could not be read" in answer.text


@pytest.mark.parametrize(
    "path",
    ["/jobs?state=nonsense", "/jobs?cursor=%00", "/jobs/UPPER", "/compare?" + "&".join(["job=a"] * 13), "/static/../mount.py"],
)
def test_what_is_not_understood_is_said_politely(operator, path):
    assert operator.get(path).status_code in (404, 422)


def test_a_page_of_a_job_is_renewed_until_its_end(farm, operator):
    farm.start_robot("robot-slow", trial_s=0.3)
    job_id = farm.submit(farm.policy(), trials=6).json()["job_id"]
    done = []
    with operator.stream("GET", f"/jobs/{job_id}/live") as answer:
        for line in answer.iter_lines():
            parts = json.loads(line.removeprefix("data: ")) if line.startswith("data: ") else {}
            if "progress" in parts:
                done.append(int(parts["progress"].split("<dt>done</dt><dd>")[1].split(" ")[0]))
            if "done</span>" in parts.get("head", "") or done[-1:] == [6]:
                break
    assert done == sorted(done)
    assert done[-1] == 6
