"""Signed links and webhooks on a running farm."""

from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from services.webhooks.calling import NO_ANSWER
from tests.integration.farm_process import PATIENCE_S, services, until
from tests.integration.test_dashboard import signed_in, user_token

SETTINGS = {
    "webhooks": True,
    "foxglove_url": "https://app.foxglove.dev/~/view?ds=remote-file&ds.url=",
    "lichtblick_url": "https://lichtblick.example/?ds=remote-file&ds.url=",
    "rerun_url": "https://rerun.io/viewer?url=",
}


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("links") / "farm", **SETTINGS) as running:
        running.start_robots(1, trial_s=0.02)
        yield running


@pytest.fixture(scope="module")
def trial(farm):
    job_id = farm.submit(farm.policy(), trials=2).json()["job_id"]
    farm.wait_for_end(job_id)
    return f"{job_id}-000"


def test_a_link_gives_one_log_to_whoever_has_it(farm, trial):
    made = farm.admin.post(f"/v1/trials/{trial}/link").json()
    log = farm.admin.get(f"/v1/trials/{trial}/log").content
    whole = httpx.get(made["url"], headers={"Origin": "https://app.foxglove.dev"})
    assert (whole.content, whole.headers["access-control-allow-origin"]) == (log, "*")
    part = httpx.get(made["url"], headers={"Range": "bytes=3-9"})
    assert (part.status_code, part.content) == (206, log[3:10])
    assert "content-range" in part.headers["access-control-expose-headers"].lower()
    assert httpx.head(made["url"]).headers["content-length"] == str(len(log))
    asked = httpx.options(made["url"], headers={"Origin": "https://x.example", "Access-Control-Request-Headers": "range"})
    assert asked.status_code == 204 and "Range" in asked.headers["access-control-allow-headers"]
    assert made["lasts_s"] == 600
    # The rest of the farm lets no other site in.
    assert "access-control-allow-origin" not in farm.admin.get("/v1/status", headers={"Origin": "https://x.example"}).headers


def test_a_changed_link_is_none(farm, trial):
    url = farm.admin.post(f"/v1/trials/{trial}/link").json()["url"]
    path = urlsplit(url).path
    _, links, expires, token, signature, name = path.split("/")
    other = trial.replace("-000", "-001")
    changed = [(str(int(expires) + 1), token, signature, name), (expires, "other", signature, name)]
    changed += [(expires, token, "0" * 64, name), (expires, token, signature, f"{other}.mcap"), ("1", token, signature, name)]
    for parts in changed:
        answer = httpx.get(f"{farm.api}/{links}/{'/'.join(parts)}")
        assert (answer.status_code, answer.json()["type"]) == (403, "/problems/link-not-ours"), parts


def test_a_link_ends_with_the_token_that_made_it(farm, trial):
    token = farm.admin.post("/v1/tokens", json={"owner": "op", "scopes": ["operate"]}).json()
    url = farm.client(token["secret"]).post(f"/v1/trials/{trial}/link").json()["url"]
    assert httpx.get(url).status_code == 200
    farm.admin.delete(f"/v1/tokens/{token['token_id']}")
    assert httpx.get(url).json()["type"] == "/problems/link-over"


def test_open_in_leads_to_the_viewer_with_a_link(farm, trial):
    operator, stranger = signed_in(farm, farm.tokens["admin"]), signed_in(farm, user_token(farm, "bob")["secret"])
    page = operator.get(f"/trials/{trial}").text
    for viewer, host, key in (
        ("foxglove", "app.foxglove.dev", "ds.url"),
        ("lichtblick", "lichtblick.example", "ds.url"),
        ("rerun", "rerun.io", "url"),
    ):
        assert f"/trials/{trial}/open/{viewer}" in page
        answer = operator.get(f"/trials/{trial}/open/{viewer}")
        to = urlsplit(answer.headers["location"])
        assert (answer.status_code, to.scheme, to.hostname) == (303, "https", host)
        assert httpx.get(parse_qs(to.query)[key][0]).status_code == 200
    assert operator.get(f"/trials/{trial}/open/vlc").status_code == 422
    assert operator.get(f"/trials/{trial}/open/rerun", headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert stranger.get(f"/trials/{trial}/open/rerun").status_code == 404
    assert farm.client(user_token(farm, "bob")["secret"]).post(f"/v1/trials/{trial}/link").status_code == 404


def test_a_farm_never_calls_its_own_network(farm):
    answer = farm.submit(farm.policy(), trials=1, webhook="https://127.0.0.1:8443/v1/status")
    job_id = answer.json()["job_id"]
    farm.wait_for_end(job_id)
    until(lambda: farm.admin.get(f"/v1/jobs/{job_id}/webhook").json()["said"], PATIENCE_S, "the call to be tried")
    assert farm.admin.get(f"/v1/jobs/{job_id}/webhook").json()["said"] == f"try 1 failed: {NO_ANSWER}"
    assert farm.submit(farm.policy(), webhook=f"https://127.0.0.1:{farm.port}/v1/status").status_code == 422
    assert farm.submit(farm.policy(), webhook="http://a.example/").status_code == 422


def test_studies_are_shown_and_nothing_of_them_runs(farm):
    folder = farm.data / "studies"
    (folder / "joints-1").mkdir(parents=True)
    hostile = "<title>Joints &amp; &lt;i&gt;</title><script>alert(1)</script><form action=/jobs/x/cancel method=post>"
    (folder / "joints-1" / "report.html").write_text(hostile)
    (folder / "stolen").mkdir()
    (folder / "stolen" / "report.html").symlink_to(farm.data / "tokens.json")
    (folder / ".hidden").mkdir()
    user = signed_in(farm, user_token(farm, "ann")["secret"])
    page = user.get("/studies").text
    assert "Joints &amp; &lt;i&gt;" in page and 'href="/studies/joints-1"' in page and "stolen" not in page
    answer = user.get("/studies/joints-1")
    assert answer.text == hostile
    shut_in = answer.headers["content-security-policy"]
    assert shut_in.startswith("sandbox; default-src 'none'") and "allow-" not in shut_in and "script-src" not in shut_in
    assert answer.headers["x-content-type-options"] == "nosniff"
    for name in ("stolen", ".hidden", "none", "..%2f..", "%2e%2e%2ftokens.json"):
        assert user.get(f"/studies/{name}").status_code in (404, 422), name
    assert httpx.get(f"{farm.api}/studies/joints-1").status_code == 401
