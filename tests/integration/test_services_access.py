"""Who may do what, and how bad requests are answered: never with a 500."""

import httpx
import pytest

from tests.integration.farm_process import PATIENCE_S, services, small_policy


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("access") / "farm") as running:
        yield running


@pytest.fixture(scope="module")
def policy(farm):
    return farm.policy()


def user(farm, owner, *scopes):
    made = farm.admin.post("/v1/tokens", json={"owner": owner, "scopes": scopes})
    assert made.status_code == 201, made.text
    return made.json(), farm.client(made.json()["secret"])


def test_tokens_are_private_and_only_hashes_are_stored(farm):
    assert (farm.data / "tokens.json").stat().st_mode & 0o777 == 0o600
    stored = (farm.data / "farm.sqlite").read_bytes() + (farm.data / "farm.sqlite-wal").read_bytes()
    for bearer in farm.tokens.values():
        assert bearer.encode() not in stored
        kind, token_id, secret = bearer.split("_", 2)  # a secret may have underscores of its own
        assert kind == "trifarm" and token_id and len(secret) > 20
        assert secret.encode() not in stored


def test_a_user_sees_his_own_jobs_only(farm, policy):
    (_, ann), (_, bob), (_, operator) = (user(farm, *who) for who in (("ann", "submit"), ("bob", "submit"), ("op", "operate")))
    assert farm.submit(policy, client=ann).json()["type"] == "/problems/policy-not-found"  # it is the administrator's
    assert farm.upload(*small_policy(), client=ann).status_code == 201  # though it was there
    assert farm.upload(*small_policy(), client=ann).status_code == 200
    job_id = farm.submit(policy, client=ann).json()["job_id"]
    paths = [f"/v1/jobs/{job_id}{tail}" for tail in ("", "/trials", "/report", "/events", "/history", "/report/text")]
    paths += [f"/v1/trials/{job_id}-000", f"/v1/trials/{job_id}-000/log"]
    for path in paths:
        assert bob.get(path).status_code == 404, path
    assert bob.post(f"/v1/jobs/{job_id}/cancel").status_code == 404
    assert bob.get("/v1/jobs").json()["jobs"] == []
    assert [job["job_id"] for job in ann.get("/v1/jobs").json()["jobs"]] == [job_id]
    assert operator.post(f"/v1/jobs/{job_id}/cancel").json()["state"] == "cancelled"
    assert farm.submit(policy, client=operator).status_code == 403


def test_only_operators_go_before_the_others(farm, policy):
    (_, dora), (_, both) = user(farm, "dora", "submit"), user(farm, "both", "submit", "operate")
    assert farm.upload(*small_policy(), client=dora).is_success
    refused = farm.submit(policy, client=dora, priority="high")
    assert (refused.status_code, refused.json()["type"]) == (403, "/problems/priority-too-high")
    ladder = {"name": "l", "task": "push", "trials": 1, "rungs": [{"policy": policy, "step": 1}]}
    assert dora.post("/v1/ladders", json=ladder | {"priority": "high"}).status_code == 403
    assert dora.get("/v1/jobs").json()["jobs"] == []
    made = dora.post("/v1/ladders", json=ladder | {"priority": "low"}).json()["rungs"][0]["job_id"]
    allowed = [farm.job(made), farm.submit(policy, client=dora, priority="low").json()]
    allowed += [farm.submit(policy, client=dora).json(), farm.submit(policy, client=both, priority="high").json()]
    assert [job["priority"] for job in allowed] == ["low", "low", "normal", "high"]
    for job in allowed:
        farm.admin.post(f"/v1/jobs/{job['job_id']}/cancel")


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("GET", "/v1/jobs", {"submit", "operate", "admin"}),
        ("GET", "/v1/policies", {"submit", "operate", "admin"}),
        ("GET", "/v1/robots", {"submit", "operate", "robot", "admin"}),
        ("GET", "/v1/status", {"submit", "operate", "robot", "admin"}),
        ("POST", "/v1/robots/robot-0/drain", {"operate", "admin"}),
        ("POST", "/v1/leases/j-000/renew", {"robot", "admin"}),
        ("GET", "/v1/tokens", {"admin"}),
    ],
)
def test_each_scope_opens_its_routes_and_no_others(farm, method, path, allowed):
    for scope in ("submit", "operate", "robot", "admin"):
        _, client = user(farm, f"only-{scope}", scope)
        if scope == "robot":
            client = farm.client(client.post("/v1/robots/robot-8/token").json()["secret"])
        status = client.request(method, path).status_code
        assert (status != 403) == (scope in allowed), (scope, status)
    assert httpx.request(method, farm.api + path).status_code == 401


def test_a_revoked_or_expired_token_stops_working(farm):
    token, client = user(farm, "gone", "submit")
    assert client.get("/v1/jobs").status_code == 200
    assert farm.admin.delete(f"/v1/tokens/{token['token_id']}").status_code == 204
    answer = client.get("/v1/jobs")
    assert (answer.status_code, answer.json()["type"]) == (401, "/problems/token-revoked")
    assert answer.headers["www-authenticate"] == "Bearer"
    short = farm.admin.post("/v1/tokens", json={"owner": "brief", "scopes": ["submit"], "expires_in_days": 1e-9}).json()
    assert farm.client(short["secret"]).get("/v1/jobs").json()["type"] == "/problems/token-expired"
    listed = farm.admin.get("/v1/tokens").json()["tokens"]
    assert all("secret" not in each for each in listed)


@pytest.mark.parametrize("bearer", ["x", "trifarm__", "trifarm_a_b", "trifarm_" + "z" * 5000, "é"])
def test_bad_tokens_are_401(farm, bearer):
    answer = httpx.get(f"{farm.api}/v1/jobs", headers={"Authorization": f"Bearer {bearer}".encode()})
    assert answer.status_code == 401


@pytest.mark.parametrize(
    ("method", "path", "content", "status"),
    [
        ("POST", "/v1/jobs", b"", 422),
        ("POST", "/v1/jobs", b"{", 422),
        ("POST", "/v1/jobs", b"\xff", 400),
        ("POST", "/v1/jobs", b"[]", 422),
        ("POST", "/v1/jobs", b'{"policy":"' + b"a" * 64 + b'","task":"push"}', 404),
        ("POST", "/v1/jobs", b'{"policy":"' + b"a" * 64 + b'","task":"fly"}', 422),
        ("POST", "/v1/jobs", b'{"policy":"' + b"a" * 64 + b'","task":"push","trials":1e9}', 422),
        ("POST", "/v1/jobs", b'{"policy":"' + b"a" * 64 + b'","task":"push","seed":9223372036854775808}', 422),
        ("POST", "/v1/jobs", b'{"policy":"' + b"a" * 64 + b'","task":"push","extra":1}', 422),
        ("GET", "/v1/jobs?limit=0", b"", 422),
        ("GET", "/v1/jobs?cursor=%00%ff", b"", 422),
        ("GET", "/v1/jobs?cursor=bjk5OTk5OTk5OTk5OTk5OTk5OTk5OTk5OTk5OTk5", b"", 422),
        ("GET", "/v1/jobs/NO", b"", 422),
        ("GET", "/v1/jobs/nosuchjob", b"", 404),
        ("GET", "/v1/trials/nosuch-000", b"", 404),
        ("GET", "/v1/robots/nobody", b"", 404),
        ("POST", "/v1/robots/nobody/drain", b"", 404),
        ("PUT", "/v1/policies/" + "a" * 64, b"not a form", 422),
        ("PUT", "/v1/leases/nosuch-000/1/log", b"", 404),
        ("PUT", "/v1/leases/nosuch-000/99999999999999999999/log", b"", 422),
        ("DELETE", "/v1/tokens/nosuch", b"", 404),
        ("PATCH", "/v1/jobs", b"", 405),
        ("GET", "/v2/nothing", b"", 404),
    ],
)
def test_bad_requests_get_a_problem_document(farm, method, path, content, status):
    answer = farm.admin.request(method, path, content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["type"].startswith("/problems/")
    assert problem["status"] == status
    assert problem["detail"]


@pytest.mark.parametrize("last", ["x", "-1", "99999999999999999999"])
def test_a_bad_last_event_id_is_refused_before_the_stream_begins(farm, policy, last):
    job_id = farm.submit(policy).json()["job_id"]
    answer = farm.admin.get(f"/v1/jobs/{job_id}/events", headers={"Last-Event-ID": last})
    assert answer.status_code == 422


def test_given_tokens_are_registered_and_no_file_is_written(tmp_path):
    with services(tmp_path / "first") as one:
        pass
    given = one.tokens
    from tests.integration.farm_process import Services, until

    running = Services(tmp_path / "second", admin_token=given["admin"], robot_token=given["robot"])
    running.data.mkdir()
    (running.data / "tokens.json").write_text((tmp_path / "first" / "tokens.json").read_text())
    try:
        running.start()
        until(lambda: running.admin.get("/v1/tokens").status_code == 200, PATIENCE_S, "the given token")
        assert len(running.admin.get("/v1/tokens").json()["tokens"]) == 2
    finally:
        running.close()


def test_an_upload_over_the_limit_is_refused_early(tmp_path):
    with services(tmp_path / "farm", max_weights_bytes=100_000) as farm:
        weights, manifest = small_policy(width=2000)
        assert farm.upload(weights, manifest).status_code == 413

        def endless():
            for _ in range(100):
                yield b"x" * 100_000

        boundary = {"Content-Type": "multipart/form-data; boundary=b"}
        answer = farm.admin.put("/v1/policies/" + "a" * 64, content=endless(), headers=boundary)
        assert answer.status_code in (413, 422)
