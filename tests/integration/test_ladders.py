"""A ladder and the leaderboard on a running farm, with the pages that show them."""

import json

import pytest

from tests.integration.farm_process import services, small_policy
from tests.integration.test_dashboard import HOSTILE, signed_in, user_token

SAME = ("success_rate", "interval_80", "interval_95")
"""What a rung has as the report of its job has it."""


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("ladders") / "farm") as running:
        yield running


@pytest.fixture(scope="module")
def robots(farm):
    """Two robots, which begin with whatever waits for them."""
    for number in range(2):
        farm.start_robot(f"robot-{number}", trial_s=0.3)


@pytest.fixture(scope="module")
def ladder(farm):
    digests = []
    for seed in range(3):
        weights, manifest = small_policy(seed=seed)
        digests.append(farm.upload(weights, manifest.model_copy(update={"name": HOSTILE})).json()["digest"])
    rungs = [{"policy": digest, "step": 100 * place} for place, digest in enumerate(digests)]
    body = {"name": HOSTILE, "task": "push", "trials": 6, "rungs": rungs}
    answer = farm.admin.post("/v1/ladders", json=body)
    assert answer.status_code == 201, answer.text
    assert answer.headers["Location"] == f"/v1/ladders/{answer.json()['ladder_id']}"
    return answer.json()


def test_a_ladder_is_watched_until_all_of_it_is_done(farm, ladder, request):
    seen, client = [], signed_in(farm, farm.tokens["admin"])
    with client.stream("GET", f"/ladders/{ladder['ladder_id']}/live") as answer:
        for line in answer.iter_lines():
            parts = json.loads(line.removeprefix("data: ")) if line.startswith("data: ") else {}
            if "head" in parts:
                seen.append(int(parts["head"].split('class="why">')[1].split(" of ")[0]))
                request.getfixturevalue("robots")  # now that somebody watches
            if seen and seen[-1] == 18:
                break
    assert seen == sorted(seen) and len(seen) > 2
    farm.wait_for_end(ladder["rungs"][-1]["job_id"])
    shown = farm.admin.get(f"/v1/ladders/{ladder['ladder_id']}").json()
    assert [rung["trials_done"] for rung in shown["rungs"]] == [6, 6, 6]
    for rung in shown["rungs"]:
        report = farm.admin.get(f"/v1/jobs/{rung['job_id']}/report").json()
        assert [rung[name] for name in SAME] == [report[name] for name in SAME]
        assert report["seed"] == shown["seed"]
    page = client.get(f"/ladders/{ladder['ladder_id']}").text
    assert page.count('class="stop"') == 3 and '<b>"' not in page and "&lt;b&gt;" in page
    link = page.split('href="/compare?jobs=')[1].split('"')[0]
    assert "N = 6" in client.get(f"/compare?jobs={link}").text, "the rungs are paired"
    assert "&lt;b&gt;" in client.get("/ladders").text


def test_the_board_names_policies_to_their_owners_only(farm, ladder, robots):
    wishes = [{"policy": rung["policy"], "task": "push", "trials": 6} for rung in ladder["rungs"]]
    for job in [farm.admin.post("/v1/jobs", json=wish).json() for wish in wishes]:
        farm.wait_for_end(job["job_id"])
    board = farm.admin.get("/v1/leaderboard/push").json()
    assert [row["trials"] for row in board["rows"]] == [6, 6, 6]
    bounds = [row["interval_95"][0] for row in board["rows"]]
    assert bounds == sorted(bounds, reverse=True)
    assert farm.admin.get("/v1/leaderboard").json()["contests"][0]["policies"] == 3
    bob = user_token(farm, "bob")["secret"]
    assert {row["policy_name"] for row in farm.client(bob).get("/v1/leaderboard/push").json()["rows"]} == {None}
    own, others = signed_in(farm, farm.tokens["admin"]).get("/leaderboard").text, signed_in(farm, bob).get("/leaderboard").text
    assert "&lt;b&gt;" in own and '<b>"' not in own
    assert "&lt;b&gt;" not in others and others.count("another user") == 3 and board["rows"][0]["policy"][:12] in others


def test_a_stranger_finds_no_ladder(farm, ladder):
    client = signed_in(farm, user_token(farm, "carl")["secret"])
    for path in (f"/ladders/{ladder['ladder_id']}", f"/ladders/{ladder['ladder_id']}/live"):
        assert client.get(path).status_code == 404
    assert ladder["ladder_id"] not in client.get("/ladders").text


@pytest.mark.parametrize("more", [{"rungs": []}, {"trials": 1000, "rungs": [{"policy": "0" * 64, "step": 1}] * 11}])
def test_too_little_and_too_much_are_refused(farm, more):
    body = {"name": "l", "task": "push", "rungs": [{"policy": "0" * 64, "step": 1}]} | more
    assert farm.admin.post("/v1/ladders", json=body).status_code == 422
