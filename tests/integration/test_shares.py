"""How much one user may queue, keep and ask for, how soon a revoked token stops, and that every change leaves an audit line."""

import itertools
import json
import re
import threading
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest

from services.api.policies import MOST_UPLOADS
from tests.hostile.valid import MANIFEST, SB3_NAMES, SIZE, sb3_entries, torch_file, zipped
from tests.integration.farm_process import PATIENCE_S, Services, services, small_policy
from tests.stalls import stalls

QUEUED, KEPT_BYTES = 3, 30_000
ANONYMOUS_PER_S, USER_PER_S = 1, 2
"""So few that any machine is quicker, however slow it is."""


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    settings = {"max_queued_jobs_per_user": QUEUED, "max_policy_bytes_per_user": KEPT_BYTES}
    with services(tmp_path_factory.mktemp("shares") / "farm", anonymous_requests_per_s=0, **settings) as running:
        yield running


@pytest.fixture
def strict(tmp_path):
    """A farm where nobody may ask often."""
    rates = {"requests_per_s": USER_PER_S, "anonymous_requests_per_s": ANONYMOUS_PER_S}
    with services(tmp_path / "strict", **rates) as running:
        yield running


def drawn(ask, most=500):
    """What is answered until somebody is asked to wait, and for how long that went on, in seconds."""
    began_s, answers = time.monotonic(), [ask()]
    while answers[-1].status_code != 429 and len(answers) < most:
        answers.append(ask())
    return answers, time.monotonic() - began_s


def user(farm, owner, *scopes):
    made = farm.admin.post("/v1/tokens", json={"owner": owner, "scopes": scopes or ["submit"]})
    assert made.status_code == 201, made.text
    return farm.client(made.json()["secret"]), made.json()["token_id"]


def test_a_user_queues_no_more_jobs_than_his_share_also_all_at_once(farm):
    (ann, _), (also_ann, _), (bob, _) = (user(farm, name) for name in ("ann", "ann", "bob"))
    weights, manifest = small_policy()
    digests = {farm.upload(weights, manifest, client=client).json()["digest"] for client in (ann, bob)}
    (digest,) = digests
    key = {"Idempotency-Key": "first"}
    first = farm.submit(digest, client=ann, headers=key)
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda n: farm.submit(digest, client=(ann, also_ann)[n % 2], seed=n), range(12)))
    assert sorted(answer.status_code for answer in answers) == [201] * (QUEUED - 1) + [429] * (13 - QUEUED)
    refused = next(answer for answer in answers if answer.status_code == 429)
    assert int(refused.headers["retry-after"]) > 0
    problem = refused.json()
    assert (problem["type"], problem["unended_jobs"], problem["limit"]) == ("/problems/queued-jobs-quota", QUEUED, QUEUED)
    assert "cancel one" in problem["detail"]
    assert len(ann.get("/v1/jobs").json()["jobs"]) == QUEUED  # nothing of the refused is there
    again = farm.submit(digest, client=ann, headers=key)  # a retry is no other job
    assert (again.status_code, again.json()["job_id"]) == (200, first.json()["job_id"])
    assert farm.identify(client=ann, excitations=["chirps"]).json()["type"] == "/problems/queued-jobs-quota"
    assert farm.submit(digest, client=bob).status_code == 201  # his own share
    both, _ = user(farm, "ann", "submit", "operate")
    assert farm.submit(digest, client=both).status_code == 201  # operators have no share
    ann.post(f"/v1/jobs/{first.json()['job_id']}/cancel")
    ann.post(f"/v1/jobs/{next(a for a in answers if a.status_code == 201).json()['job_id']}/cancel")
    assert farm.submit(digest, client=ann).status_code == 201


def stored(farm):
    return {path.name: path.stat().st_size for path in (farm.data / "files" / "sha256").rglob("*") if path.is_file()}


def test_a_user_keeps_no_more_bytes_of_policies_than_his_share_also_all_at_once(farm):
    carl, _ = user(farm, "carl")
    files = [small_policy(seed=seed, width=20) for seed in range(6)]
    first = farm.upload(*files[0], client=carl)
    assert first.status_code == 201
    weights_bytes = len(files[0][0])
    size = weights_bytes + stored(farm)[first.json()["graph_sha256"]]  # all of them have the same
    fitting = KEPT_BYTES // size
    assert 1 < fitting < len(files) - 2
    for weights, manifest in files[1 : fitting - 1]:
        assert farm.upload(weights, manifest, client=carl).status_code == 201
    before = len(stored(farm))
    with ThreadPoolExecutor(MOST_UPLOADS) as pool:
        answers = list(pool.map(lambda file: farm.upload(*file, client=carl), files[fitting - 1 : fitting + 2]))
    kept = [answer for answer in answers if answer.status_code == 201]
    assert len(kept) <= 1
    assert {answer.status_code for answer in answers} <= {201, 403}
    assert len(stored(farm)) == before + 2 * len(kept)  # weights and graph; nothing of those that were refused
    refused = farm.upload(*files[fitting - 1], client=carl) if not kept else farm.upload(*files[fitting + 2], client=carl)
    if not kept:  # each stood in the other's way; one after the other the first has room
        assert refused.status_code == 201
        refused = farm.upload(*files[fitting], client=carl)
    problem = refused.json()
    assert (refused.status_code, problem["type"]) == (403, "/problems/policy-bytes-quota")
    assert (problem["stored_bytes"], problem["limit_bytes"]) == (fitting * size, KEPT_BYTES)
    assert problem["upload_bytes"] in (weights_bytes, size)  # before and after its graph is known
    assert farm.upload(*files[0], client=carl).status_code == 200  # what he has is no more
    assert farm.upload(*files[fitting + 2]).status_code == 201  # an administrator has no share
    assert farm.upload(*files[fitting + 2], client=carl).status_code == 403  # that it is here already makes no room


def test_what_was_sent_packed_counts_as_what_it_becomes(farm):
    carla, _ = user(farm, "carla")
    shapes = ((120, SIZE), (120,), (9, 120), (9,))
    alike = [np.full(shape, 0.01, np.float32) for shape in shapes]
    entries = sb3_entries() | {"policy.pth": torch_file(dict(zip(SB3_NAMES, alike, strict=True)))}
    packed = zipped(entries, zipfile.ZIP_DEFLATED)
    assert len(packed) < 5_000
    before = stored(farm)
    refused = farm.upload(packed, MANIFEST, client=carla, filename="p.zip")
    problem = refused.json()
    assert (refused.status_code, problem["type"]) == (403, "/problems/policy-bytes-quota")
    assert problem["stored_bytes"] == 0 and problem["upload_bytes"] > KEPT_BYTES
    assert stored(farm) == before
    assert farm.upload(packed, MANIFEST, filename="p.zip").status_code == 201
    assert farm.upload(packed, MANIFEST, client=carla, filename="p.zip").status_code == 403  # also where it is here already


def test_a_token_is_asked_to_wait_and_others_are_not(strict):
    (dora, _), (emil, _) = user(strict, "dora"), user(strict, "emil")
    answers, lasted_s = drawn(lambda: dora.get("/v1/jobs"))
    last = answers[-1]
    assert (last.status_code, last.json()["type"]) == (429, "/problems/too-many-requests")
    # The first is not yet known to be hers.
    assert 10 * USER_PER_S <= len(answers) - 1 <= 1 + USER_PER_S * (10 + lasted_s)
    assert last.headers["ratelimit-policy"] == f'"requests";q={10 * USER_PER_S};w=10'
    assert emil.get("/v1/jobs").status_code == 200
    time.sleep(int(last.headers["retry-after"]))
    assert dora.get("/v1/jobs").status_code == 200


def test_guessers_are_stopped_before_the_database_is_asked_and_good_tokens_are_not(strict):
    frida, _ = user(strict, "frida")
    assert frida.get("/v1/jobs").status_code == 200
    with httpx.Client(base_url=strict.api) as guesser:

        def guess(number=itertools.count()):
            at = next(number)
            headers = {"Authorization": f"Bearer trifarm_{at:08x}_wrong", "X-Forwarded-For": f"10.0.0.{at % 256}"}
            return guesser.get("/v1/jobs", headers=headers)

        answers, _ = drawn(guess)
        assert {answer.status_code for answer in answers} == {401, 429} and len(answers) > 1
        same_address, _ = drawn(lambda: guesser.get("/healthz"))
        assert same_address[-1].status_code == 429
    assert frida.get("/v1/jobs").status_code == 200


def test_sessions_share_the_limit_of_their_token_and_no_other_header_gets_round_it(strict):
    made = strict.admin.post("/v1/tokens", json={"owner": "gina", "scopes": ["submit"]}).json()
    with (
        httpx.Client(base_url=strict.api) as one,
        httpx.Client(base_url=strict.api) as other,
        httpx.Client(base_url=strict.api) as bare,
    ):
        began_s = time.monotonic()
        for browser in (one, other):
            assert browser.post("/sign-in", data={"token": made["secret"]}).status_code == 303
            assert browser.get("/jobs").status_code == 200  # from now on it is known whose session it is
        asked = [answer.status_code for answer in drawn(lambda: one.get("/healthz"))[0]]
        asked += [other.get("/healthz").status_code for _ in range(10 * USER_PER_S)]
        allowed = USER_PER_S * (10 + time.monotonic() - began_s)
        assert 10 * USER_PER_S - 2 <= asked.count(200) <= allowed, "another session has no more"
        began_s = time.monotonic()
        made_up = [
            one.get("/jobs", headers={"Authorization": f"Bearer made-up-{n}"}).status_code for n in range(30 * ANONYMOUS_PER_S)
        ]
        allowed = ANONYMOUS_PER_S * (10 + time.monotonic() - began_s)
        assert made_up.count(429) >= len(made_up) - allowed, "who shows a token that is not his counts as a stranger"
        assert bare.get("/v1/jobs").headers["ratelimit-policy"].startswith(f'"requests";q={10 * ANONYMOUS_PER_S};')


def test_a_revoked_token_stops_within_a_second_in_another_process_and_in_open_streams(farm):
    (gina, token_id), (policy, manifest) = user(farm, "gina"), small_policy()
    digest = farm.upload(policy, manifest, client=gina).json()["digest"]
    job_id = farm.submit(digest, client=gina).json()["job_id"]
    other = Services(farm.data)
    try:
        other.start()
        elsewhere = other.client(gina.headers["authorization"].partition(" ")[2])
        assert elsewhere.get("/v1/jobs").status_code == 200
        ended, opened = {}, threading.Barrier(4)

        def stream(name, client):
            with client.stream("GET", f"/v1/jobs/{job_id}/events") as answer:
                lines = answer.iter_lines()
                next(lines)
                opened.wait()
                for _ in lines:
                    pass
            ended[name] = time.monotonic()

        def poll():
            opened.wait()
            answer = gina.get(f"/v1/jobs/{job_id}/history", params={"after": 1})
            ended["long poll"] = time.monotonic() if answer.status_code == 401 else None

        threads = [threading.Thread(target=stream, args=each) for each in (("stream", gina), ("stream elsewhere", elsewhere))]
        threads.append(threading.Thread(target=poll))
        for thread in threads:
            thread.start()
        opened.wait()
        time.sleep(1)  # the long poll is there, and every process remembers the token
        assert elsewhere.get("/v1/jobs").status_code == 200
        assert ended == {}
        assert farm.admin.delete(f"/v1/tokens/{token_id}").status_code == 204
        revoked_s = time.monotonic()
        with stalls() as stalled:
            assert gina.get("/v1/jobs").status_code == 401  # at once where it was revoked
            while elsewhere.get("/v1/jobs").status_code == 200:
                pass
            ended["requests elsewhere"] = time.monotonic()
            for thread in threads:
                thread.join(PATIENCE_S)
    finally:
        other.close()
    took_s = {name: at_s - revoked_s for name, at_s in ended.items()}
    print({name: round(seconds, 2) for name, seconds in took_s.items()})
    assert set(took_s) == {"stream", "stream elsewhere", "long poll", "requests elsewhere"}
    assert max(took_s.values()) < 1.0 + stalled.seconds, took_s


def test_an_upload_under_way_ends_with_its_token(farm):
    hugo, token_id = user(farm, "hugo")

    def body():
        yield b"--b\r\n" + b'Content-Disposition: form-data; name="weights"; filename="w.onnx"\r\n\r\n'
        farm.admin.delete(f"/v1/tokens/{token_id}")
        for _ in range(1000):  # until it is refused, which the client does not see before it has sent everything
            time.sleep(0.05)
            yield b"x" * 1000
            if any((line["token_id"], line["status"]) == (token_id, 401) for line in audited(farm)):
                return

    headers = {"Content-Type": "multipart/form-data; boundary=b"}
    answer = hugo.put("/v1/policies/" + "a" * 64, content=body(), headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (401, "/problems/token-revoked")


def audited(farm):
    return [line for line in map(json.loads, log_lines(farm)) if line["event"] == "audit"]


def log_lines(farm):
    return [line for line in farm.errors.read_text().splitlines() if line.startswith("{")]


def test_every_route_that_can_change_something_leaves_one_line_also_when_it_refuses(farm):
    ida, ida_id = user(farm, "ida")
    ids = {"job_id": "jaaaaaaaaaaaa", "trial_id": "jaaaaaaaaaaaa-000", "ladder_id": "l0", "digest": "0" * 64, "robot": "robot-9"}
    ids |= {"token_id": "nobody", "share_id": "s0", "ordinal": "0", "fence": "1", "name": "grasp"}
    paths = farm.admin.get("/openapi.json").json()["paths"]
    changing = [(method.upper(), path) for path, each in paths.items() for method in each if method not in ("get", "head")]
    assert len(changing) >= 14
    for method, path in changing:
        names = re.findall(r"{(\w+)}", path)
        for client, owner, token_id in ((farm.admin, "operator", farm.tokens["admin"].split("_")[1]), (ida, "ida", ida_id)):
            before = len(audited(farm))
            answer = client.request(method, path.format_map(ids))
            (line,) = audited(farm)[before:]
            assert line["action"] == f"{method} {path}"
            assert line["on"] == {name: ids[name] for name in names}
            assert (line["owner"], line["token_id"]) == (owner, token_id)
            assert line["status"] == answer.status_code
            assert line["outcome"] == ("done" if answer.is_success else "refused")
            assert line["request_id"] == answer.headers["x-request-id"]
            if not answer.is_success:
                assert answer.json()["type"] == f"/problems/{line['problem']}"


def test_what_was_made_and_who_was_sent_away_is_in_the_line(farm):
    jane, jane_id = user(farm, "jane")
    weights, manifest = small_policy()
    digest = farm.upload(weights, manifest, client=jane).json()["digest"]
    job_id = farm.submit(digest, client=jane).json()["job_id"]
    before = len(audited(farm))
    farm.submit(digest, client=jane, headers={"Idempotency-Key": "k"})
    farm.submit(digest, client=jane, headers={"Idempotency-Key": "k"}, trials=9)
    jane.post("/v1/policies", files={"weights": ("w.safetensors", weights)}, data={"manifest": manifest.model_dump_json()})
    jane.post(f"/v1/jobs/{job_id}/cancel")
    jane.post(f"/v1/jobs/{job_id}/cancel")
    farm.admin.delete(f"/v1/tokens/{jane_id}")
    jane.post(f"/v1/jobs/{job_id}/cancel")
    httpx.post(f"{farm.api}/v1/jobs", json={})
    httpx.post(f"{farm.api}/nowhere/trifarm_a_secret", json={})
    lines = audited(farm)[before:]
    assert [line["status"] for line in lines] == [201, 409, 200, 200, 200, 204, 401, 401, 404]
    assert re.fullmatch(r"/v1/jobs/j\w+", lines[0]["made"])
    assert lines[2]["made"] == f"/v1/policies/{digest}"
    assert [line["problem"] for line in lines[6:]] == ["token-revoked", "token-missing", "no-such-route"]
    assert (lines[6]["token_id"], lines[6]["owner"]) == (jane_id, None)
    assert lines[8]["action"] == "POST (no such route)"
