"""Nothing of another user's can be read, changed or even be told from what does not exist, over every route that takes an id."""

import json
import random
import re
from importlib.metadata import version

import pytest

from tests.integration.farm_process import PATIENCE_S, services, small_policy, until

OUTCOME = {"kind": "failed", "fault": "none", "reason": "not his"}
REQUESTS = 500
NOTHING = {
    "job_id": "jaaaaaaaaaaaa",
    "trial_id": "jaaaaaaaaaaaa-000",
    "ladder_id": "laaaaaaaaaaaa",
    "task": "push",
    "digest": "0" * 64,
    "robot": "robot-9",
    "token_id": "0" * 8,
    "share_id": "saaaaaaaaaaaa",
    "ordinal": "0",
    "fence": "1",
    "name": "grasp",
}
"""Ids of the right form that nobody has."""
JOINING = {"/v1/robots/{robot}/token", "/v1/robots/{robot}/bus"}
OPEN_TO_ALL = {("GET", "/v1/robots/{robot}"), ("GET", "/v1/leaderboard/{task}")}
"""Robots and tasks are everybody's: that there is one is no secret, what it runs and whose policies were tried at it is."""


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("foreign") / "farm", shares="true", webhooks="true", pass_over_s=0.5) as running:
        running.start_robots(2, trial_s=0.02, truth=True)
        yield running


def user(farm, owner):
    made = farm.admin.post("/v1/tokens", json={"owner": owner, "scopes": ["submit"]}).json()
    return farm.client(made["secret"]), made["token_id"]


@pytest.fixture(scope="module")
def anns(farm):
    """What is Ann's: a policy, a job that has ended, an identification that has ended, one that waits; and her secrets."""
    ann, token_id = user(farm, "ann")
    weights, manifest = small_policy(seed=7)
    manifest = manifest.model_copy(update={"name": "anns-secret-policy"})
    digest = farm.upload(weights, manifest, client=ann).json()["digest"]
    done = farm.submit(digest, client=ann, trials=3).json()["job_id"]
    identified = farm.identify(client=ann, excitations=["chirps"]).json()["job_id"]
    for job_id in (done, identified):
        assert farm.wait_for_end(job_id)["state"] == "succeeded"
    for robot in farm.robots:
        farm.admin.post(f"/v1/robots/{robot}/drain")
    until(lambda: farm.robots_in("draining") == 2, PATIENCE_S, "drained robots")
    waiting = farm.submit(digest, client=ann, trials=2).json()["job_id"]
    rungs = [{"policy": digest, "step": 1}]
    ladder = ann.post(
        "/v1/ladders", json={"name": "anns-secret-policy", "task": "push", "trials": 1, "seed": 1, "rungs": rungs}
    ).json()
    trial = ann.get(f"/v1/trials/{done}-000").json()
    share = ann.post("/v1/shares", json={"job": done}).json()
    secrets = [
        digest,
        done,
        identified,
        waiting,
        token_id,
        ladder["ladder_id"],
        share["share_id"],
        share["url"].rpartition("/")[2],
        trial["log_sha256"],
        "anns-secret-policy",
        '"ann"',
    ]
    jobs = (done, identified, waiting)
    ids = {
        "job_id": jobs,
        "trial_id": [f"{job_id}-000" for job_id in jobs],
        "ladder_id": [ladder["ladder_id"]],
        "task": ["push"],
        "digest": [digest],
        "token_id": [token_id],
        "share_id": [share["share_id"]],
        "robot": sorted(farm.robots),
        "ordinal": ["0", "1"],
        "fence": ["1", "2"],
        "name": ["grasp"],
    }
    return ids, secrets


def routes(farm):
    """Every operation with a path parameter."""
    paths = farm.admin.get("/openapi.json").json()["paths"]
    methods = ("get", "put", "post", "delete", "patch", "head")
    return [(method.upper(), path) for path, each in paths.items() for method in each if method in methods and "{" in path]


BODIES = {
    "renew": {"robot": "robot-7", "fence": 1},
    "outcome": {"robot": "robot-7", "fence": 1, "outcome": OUTCOME},
    "bus": {"signing_request": "none", "version": version("trifarm")},
    "webhook": {"url": "https://198.51.100.7/another"},
}
"""Of the routes that end so."""


def body(method, path, ids):
    if (given := BODIES.get(path.rpartition("/")[2])) is not None and method in ("PUT", "POST"):
        return {"json": given}
    if method == "PATCH":
        return {"json": {"note": "of another"}}
    if method == "PUT" and "digest" in ids:
        return {"files": {"weights": ("w.safetensors", b"x" * 100)}, "data": {"manifest": small_policy()[1].model_dump_json()}}
    return {"content": b"some bytes"} if method in ("PUT", "POST") else {}


def ask(client, method, path, ids):
    answer = client.request(method, path.format_map(ids), **body(method, path, ids))
    text = answer.text.replace(path.format_map(ids), path)
    for name, value in ids.items():  # what he said himself is no news to him
        text = text.replace(value, f"<{name}>") if len(value) > 1 else text
    headers = answer.headers.get("content-disposition", "") + answer.headers.get("etag", "")
    return answer.status_code, text, headers


def test_five_hundred_requests_with_anothers_ids_get_the_answer_of_ids_that_nobody_has(farm, anns):
    ids, secrets = anns
    rng = random.Random(5)
    bob, _ = user(farm, "bob")
    farm.robot_client("robot-7")  # joined, and never had a lease
    clients = {"a user": bob, "a robot": farm.robot_client("robot-7"), "the robots' token": farm.client(farm.tokens["robot"])}
    before = everything(farm, ids)
    asked, statuses, found = 0, {}, routes(farm)
    assert {name for _, path in found for name in re.findall(r"{(\w+)}", path)} == set(ids) == set(NOTHING)
    while asked < REQUESTS:
        for method, path in found:
            usual = "a robot" if "/leases/" in path or path.endswith("/graph") else "a user"
            who = usual if rng.random() < 0.7 else rng.choice(sorted(clients))
            names = re.findall(r"{(\w+)}", path)
            if (who != "a user" and path in ("/v1/robots/{robot}/token", "/v1/robots/{robot}/bus")) or (
                method,
                path,
            ) in OPEN_TO_ALL:
                continue  # joining is what these tokens are for: below
            status, text, headers = ask(clients[who], method, path, {name: rng.choice(ids[name]) for name in names})
            nothing = ask(clients[who], method, path, {name: NOTHING[name] for name in names})
            assert (status, text, headers) == nothing, (who, method, path)
            assert status in (403, 404, 422), (who, method, path, status)
            assert status != 422 or path == "/v1/policies/{digest}", text  # an upload is read before anybody looks for it
            assert not [secret for secret in secrets if secret in text], (who, method, path)
            asked += 1
            statuses[status] = statuses.get(status, 0) + 1
    print(f"{asked} requests with another's ids over {len(found)} routes: {statuses}")
    assert everything(farm, ids) == before


def everything(farm, ids):
    """All of Ann's as an administrator sees it."""
    shown = [farm.admin.get(f"/v1/jobs/{job_id}{tail}").text for job_id in ids["job_id"] for tail in ("", "/trials")]
    tokens = [token for token in farm.admin.get("/v1/tokens").json()["tokens"] if token["token_id"] in ids["token_id"]]
    return [json.dumps({**token, "last_used_at": None}) for token in tokens], shown


def test_lists_bodies_and_queries_reveal_nothing_either(farm, anns):
    ids, secrets = anns
    bob, _ = user(farm, "bob")
    (digest,), (done, *_) = ids["digest"], ids["job_id"]
    answers = [bob.get(f"/v1/{name}") for name in ("jobs", "policies", "robots", "status", "robots/robot-0")]
    answers += [bob.get("/v1/tokens"), farm.submit(digest, client=bob), bob.get("/v1/jobs", params={"state": "queued"})]
    answers += [farm.submit(digest, client=bob, headers={"Idempotency-Key": done})]
    for answer in answers:
        assert answer.status_code in (200, 403, 404), answer.text
        assert not [secret for secret in secrets if secret in answer.text.replace(f"No policy has the digest {digest}", "")]
    assert bob.get("/v1/jobs").json()["jobs"] == bob.get("/v1/policies").json()["policies"] == []
    missing = farm.submit("0" * 64, client=bob)
    assert missing.text == farm.submit(digest, client=bob).text.replace(digest, "0" * 64)


def test_a_running_trial_of_another_is_not_named(farm, anns):
    ann, _ = user(farm, "ann")
    bob, _ = user(farm, "bob")
    farm.start_robot("robot-5", trial_s=600)
    until(lambda: farm.admin.get("/v1/robots/robot-5").json().get("trial"), PATIENCE_S, "robot-5 to be at work")
    assert ann.get("/v1/robots/robot-5").json()["job"] in anns[0]["job_id"]
    farm.upload(*small_policy(), client=bob)
    mine = farm.submit(farm.policy(), client=bob, trials=1).json()["job_id"]
    said = [bob.get(path).text for path in ("/v1/robots", "/v1/robots/robot-5", f"/v1/jobs/{mine}", f"/v1/jobs/{mine}/trials")]
    assert "running a trial of another job" in said[2] + said[3] or "ahead" in said[2], said
    assert not [text for text in said for secret in anns[1] if secret in text]
    for job_id in (mine, *anns[0]["job_id"]):
        farm.admin.post(f"/v1/jobs/{job_id}/cancel")


def test_the_farms_robot_token_opens_nothing_but_joining_and_a_robots_own_nothing_but_itself(farm):
    shared, own = farm.client(farm.tokens["robot"]), farm.robot_client("robot-7")
    body = {"robot": "robot-7", "fence": 1}
    for path, more in (("renew", body), ("outcome", body | {"outcome": OUTCOME})):
        answer = shared.post(f"/v1/leases/jaaaaaaaaaaaa-000/{path}", json=more)
        assert (answer.status_code, answer.json()["type"]) == (403, "/problems/token-of-no-robot")
        answer = own.post(f"/v1/leases/jaaaaaaaaaaaa-000/{path}", json=more | {"robot": "robot-0"})
        assert (answer.status_code, answer.json()["type"]) == (403, "/problems/token-of-another-robot")
    assert shared.get("/v1/policies/" + "0" * 64 + "/graph").status_code == 403
    answer = own.post("/v1/robots/robot-0/token")
    assert (answer.status_code, answer.json()["type"]) == (403, "/problems/token-of-another-robot")
    once, again, itself = (client.post("/v1/robots/robot-7/token").json() for client in (shared, shared, own))
    assert once["secret"] == again["secret"] == itself["secret"]
    assert once["robot"] == "robot-7"
    for name in ("submit", "operate"):
        made = farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": [name]}).json()
        assert farm.client(made["secret"]).post("/v1/robots/robot-7/token").status_code == 403


def test_a_robot_gets_the_graphs_of_its_live_leases_and_acts_on_no_others(farm, anns):
    farm.policy()
    farm.start_robot("robot-6", trial_s=600)
    digest = farm.upload(*small_policy(seed=8)).json()["digest"]
    job_id = farm.submit(digest, trials=1).json()["job_id"]
    until(lambda: farm.job(job_id)["trials_running"] == 1, PATIENCE_S, "the trial to run")
    trial = f"{job_id}-000"
    holder = farm.admin.get(f"/v1/trials/{trial}").json()["robot"]
    mine, others = farm.robot_client(holder), farm.robot_client("robot-7")
    assert mine.get(f"/v1/policies/{digest}/graph").status_code == 200
    (foreign,) = anns[0]["digest"]
    assert mine.get(f"/v1/policies/{foreign}/graph").status_code == others.get(f"/v1/policies/{digest}/graph").status_code == 404
    said = [others.put(f"/v1/leases/{trial}/1/{kind}", content=b"x").status_code for kind in ("log", "truth")]
    said += [others.post(f"/v1/leases/{trial}/renew", json={"robot": "robot-7", "fence": 1}).status_code]
    said += [others.post(f"/v1/leases/{trial}/outcome", json={"robot": "robot-7", "fence": 1, "outcome": OUTCOME}).status_code]
    assert said == [404] * 4
    assert mine.post(f"/v1/leases/{trial}/renew", json={"robot": holder, "fence": 1}).status_code == 200
    farm.admin.post(f"/v1/jobs/{job_id}/cancel")
    farm.wait_for_end(job_id)
    assert mine.get(f"/v1/policies/{digest}/graph").status_code == 404  # the lease has ended


def test_a_robots_token_ends_with_the_farms_and_by_itself(farm):
    parent = farm.admin.post("/v1/tokens", json={"owner": "lab", "scopes": ["robot"]}).json()
    lab = farm.client(parent["secret"])
    first, second = (lab.post(f"/v1/robots/lab-{number}/token").json() for number in (1, 2))
    assert first["secret"] != second["secret"]
    farm.admin.delete(f"/v1/tokens/{first['token_id']}")
    assert lab.post("/v1/robots/lab-1/token").json()["type"] == "/problems/token-revoked"
    assert farm.client(second["secret"]).get("/v1/status").status_code == 200
    farm.admin.delete(f"/v1/tokens/{parent['token_id']}")
    assert farm.client(second["secret"]).get("/v1/status").json()["type"] == "/problems/token-revoked"
