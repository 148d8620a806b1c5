"""Names and notes of jobs, and what pages offer beside them: goals in common, a word at the end, boards for everybody."""

import httpx
import pytest

from tests.integration.farm_process import services, small_policy
from tests.integration.test_dashboard import signed_in, user_token, word

HOSTILE = "<img src=x onerror=alert(1)>\"'&{{7*7}}\u202e"
SHOWN = "&lt;img src=x onerror=alert(1)&gt;&#34;&#39;&amp;{{7*7}}\\u202e"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("labels") / "farm", webhooks="true", public_leaderboard="true") as running:
        running.start_robots(2, trial_s=0.02)
        yield running


@pytest.fixture(scope="module")
def ann(farm):
    return farm.client(user_token(farm, "ann")["secret"])


@pytest.fixture(scope="module")
def page(farm):
    return signed_in(farm, user_token(farm, "ann")["secret"])


@pytest.fixture(scope="module")
def policies(farm, ann):
    return [farm.upload(*small_policy(seed=seed), client=ann).json()["digest"] for seed in range(2)]


@pytest.fixture(scope="module")
def jobs(farm, ann, policies):
    """Two jobs of two policies that drew different seeds, the first with a name and a note."""
    label = {"name": HOSTILE, "note": "before the new reward\nask Bea"}
    made = [farm.submit(policies[0], client=ann, seed=None, **label), farm.submit(policies[1], client=ann, seed=None)]
    ids = [each.json()["job_id"] for each in made]
    for each in ids:
        farm.wait_for_end(each)
    return ids


def test_names_and_notes_are_kept_found_and_changed(ann, jobs):
    first, second = jobs
    assert ann.get(f"/v1/jobs/{first}").json()["name"] == HOSTILE
    for text in ("NEW REWARD", "onerror", first):
        assert [each["job_id"] for each in ann.get("/v1/jobs", params={"q": text}).json()["jobs"]] == [first], text
    assert ann.get("/v1/jobs", params={"q": "100%_nothing"}).json()["jobs"] == []
    changed = ann.patch(f"/v1/jobs/{second}", json={"note": " a note "}).json()
    assert (changed["name"], changed["note"]) == (None, "a note")
    assert ann.patch(f"/v1/jobs/{second}", json={"name": "b"}).json()["note"] == "a note", "what is not given stays"
    assert ann.patch(f"/v1/jobs/{second}", json={"note": "", "name": None}).json()["note"] is None
    assert ann.patch(f"/v1/jobs/{second}", json={"note": "x" * 2001}).status_code == 422


def test_all_trials_are_a_table_a_click_away(page, jobs):
    first, _ = jobs
    assert f'href="/jobs/{first}/trials.csv"' in page.get(f"/jobs/{first}").text
    table = page.get(f"/jobs/{first}/trials.csv")
    assert len(table.text.splitlines()) == 5 and table.headers["cache-control"] == "no-store"


def test_only_a_jobs_people_name_it(farm, jobs):
    bob = farm.client(user_token(farm, "bob")["secret"])
    assert bob.patch(f"/v1/jobs/{jobs[0]}", json={"name": "mine"}).status_code == 404
    assert bob.get("/v1/jobs", params={"q": "reward"}).json()["jobs"] == []
    assert signed_in(farm, user_token(farm, "bob")["secret"]).post(f"/jobs/{jobs[0]}/label").status_code in (403, 404)


def test_hostile_names_are_text_on_pages_and_forms_set_them(page, jobs):
    first, second = jobs
    for path in ("/jobs", "/jobs?q=reward", f"/jobs/{first}"):
        shown = page.get(path).text
        assert SHOWN in shown and "<img" not in shown.replace('<img src="/static/mark.svg"', ""), path
    form = {"csrf": word(page), "name": HOSTILE, "note": "</textarea><script>alert(2)</script>"}
    assert page.post(f"/jobs/{second}/label", data=form).status_code == 303
    shown = page.get(f"/jobs/{second}").text
    assert "<script>" not in shown and "</textarea><" not in shown.replace("</textarea>\n<p>", "")
    assert page.post(f"/jobs/{second}/label", data=form | {"csrf": "0" * 64}).status_code == 403
    assert page.post(f"/jobs/{second}/label", data={"csrf": word(page)}).status_code == 303
    assert "alert(2)" not in page.get(f"/jobs/{second}").text, "empty fields take both away"


def test_a_policy_is_tried_on_the_goals_of_another_job_by_a_button(farm, page, jobs, policies):
    first, second = jobs
    refused = page.get(f"/compare?jobs={first},{second}").text
    assert "cannot be compared" in refused and f"trifarm submit FILE --like {first}" in refused
    form = {"csrf": word(page), "like": first, "of": second}
    answer = page.post("/compare/again", data=form)
    made = answer.headers["location"].rpartition("/")[2]
    ended = farm.wait_for_end(made)
    assert (ended["policy"], ended["seed"]) == (policies[1], farm.job(first)["seed"])
    compared = page.get(f"/compare?jobs={first},{made}").text
    assert "95 % interval" in compared and "N = 4" in compared
    assert "/compare/again" not in compared, "there is nothing left to try"
    bob = signed_in(farm, user_token(farm, "bob")["secret"])
    assert bob.post("/compare/again", data=form | {"csrf": word(bob)}).status_code == 404


def test_a_job_that_is_there_is_given_its_webhook(farm, ann, page, policies):
    job = farm.submit(policies[0], client=ann, trials=1000).json()["job_id"]
    assert "https address that the farm calls then" in page.get(f"/jobs/{job}").text
    form = {"csrf": word(page), "url": "https://hooks.example.org/<b>"}
    assert page.post(f"/jobs/{job}/webhook", data=form).status_code == 422
    assert page.post(f"/jobs/{job}/webhook", data=form | {"url": "https://hooks.example.org/a"}).status_code == 303
    assert "hooks.example.org/a</code> when this job has ended" in page.get(f"/jobs/{job}").text
    again = ann.put(f"/v1/jobs/{job}/webhook", json={"url": "https://hooks.example.org/b"})
    assert (again.status_code, again.json()["type"]) == (409, "/problems/webhook-set")
    ann.post(f"/v1/jobs/{job}/cancel")


def test_everybody_sees_the_boards_where_the_operator_wants_it_and_nothing_else(farm, jobs, policies):
    for cookies in ({}, {"trifarm_session": "of another time"}):
        seen = httpx.get(f"{farm.api}/leaderboard", headers={"Accept": "text/html"}, cookies=cookies)
        assert seen.status_code == 200 and policies[0][:12] in seen.text
        assert "ann" not in seen.text.replace("cannot", "") and 'aria-label="Pages"' not in seen.text
        assert httpx.get(f"{farm.api}/jobs", headers={"Accept": "text/html"}, cookies=cookies).status_code == 303
    assert httpx.get(f"{farm.api}/v1/leaderboard").status_code == 401
