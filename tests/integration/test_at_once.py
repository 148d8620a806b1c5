"""What one user has under way at once keeps no other out: uploads, logs to be verified, streams of events."""

import os
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from services.api.history import MOST_READERS
from services.api.policies import MOST_UPLOADS
from services.api.truth import MCAP_MAGIC
from tests.integration.farm_process import PATIENCE_S, services, small_policy, until
from tests.integration.test_bodies import FORM, PART, answer_of, begun
from tests.integration.test_services_access import user


@pytest.fixture(scope="module")
def spool(tmp_path_factory):
    """Where the services put what comes in: a folder for each request that they have begun to take."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("TMPDIR", str(tmp_path_factory.mktemp("spool")))
        yield Path(os.environ["TMPDIR"])


@pytest.fixture(scope="module")
def farm(tmp_path_factory, spool):
    settings = {"anonymous_requests_per_s": 0, "requests_per_s": 0, "body_stall_s": 300}
    with services(tmp_path_factory.mktemp("at-once") / "farm", **settings) as running:
        running.start_robots(1, trial_s=0.02, truth=True)
        yield running


@pytest.fixture(scope="module")
def ann(farm):
    return user(farm, "ann", "submit")[1]


@contextmanager
def half_sent(farm, client, route, body, *headers):
    """A request of which the head and the first bytes are there, and the others never come."""
    with begun(farm, route, f"Authorization: {client.headers['authorization']}", "Content-Length: 9999", *headers) as connection:
        connection.sendall(body)
        yield connection


def refused(answer, slug):
    status, headers, problem = answer
    assert (status, problem["type"]) == (429, f"/problems/{slug}")
    assert int(headers["retry-after"]) > 0
    return True


def whole(answer):
    return answer.status_code, {name.lower(): value for name, value in answer.headers.items()}, answer.json()


def test_two_uploads_and_the_third_is_refused_before_its_body_comes(farm, ann, spool):
    put, form = f"PUT /v1/policies/{'0' * 64}", f"Content-Type: {FORM}"
    (_, also_ann), (_, bob) = user(farm, "ann", "submit"), user(farm, "bob", "submit")
    with ExitStack() as sending:
        for route in (put, "POST /v1/policies")[:MOST_UPLOADS]:
            sending.enter_context(half_sent(farm, ann, route, PART, form))
        until(lambda: len(list(spool.glob("trifarm-upload-*"))) == MOST_UPLOADS, PATIENCE_S, "both uploads to have begun")
        with half_sent(farm, also_ann, put, b"", form) as third:
            assert refused(answer_of(third), "too-many-uploads")
        assert refused(whole(farm.upload(*small_policy(), client=ann)), "too-many-uploads")
        for other in (bob, farm.admin):
            assert farm.upload(*small_policy(), client=other).is_success
    until(lambda: farm.upload(*small_policy(), client=ann).is_success, PATIENCE_S, "what was broken off to be forgotten")


def test_one_log_is_verified_and_another_refused_before_it_comes(farm, ann, spool):
    job_id = farm.submit(farm.policy(ann), client=ann, trials=1).json()["job_id"]
    farm.wait_for_end(job_id)
    path = f"/v1/jobs/{job_id}/trials/0/verify"

    def verified(client, content=MCAP_MAGIC + b"log"):
        return client.post(path, content=content)

    with half_sent(farm, ann, f"POST {path}", MCAP_MAGIC):
        until(lambda: list(spool.glob("trifarm-verify-*")), PATIENCE_S, "the first to have begun")
        with half_sent(farm, ann, f"POST {path}", b"") as second:
            assert refused(answer_of(second), "too-many-verifications")
        assert verified(farm.admin).json()["type"] == "/problems/log-unfit"
    until(
        lambda: verified(ann, b"log").json()["type"] == "/problems/log-unfit", PATIENCE_S, "what was broken off to be forgotten"
    )


def test_so_many_streams_and_long_polls_of_events(farm, ann):
    farm.admin.post("/v1/robots/robot-0/drain")
    try:
        job_id = farm.submit(farm.policy(ann), client=ann, trials=1).json()["job_id"]
        path = f"/v1/jobs/{job_id}/events"
        with ExitStack() as opened:
            for _ in range(MOST_READERS):
                assert opened.enter_context(ann.stream("GET", path)).status_code == 200
            for other in (path, f"/v1/jobs/{job_id}/history?after=1"):
                assert refused(whole(ann.get(other)), "too-many-event-readers")
            with farm.admin.stream("GET", path) as answer:
                assert answer.status_code == 200
            (_, bob) = user(farm, "bob", "submit")
            own = farm.submit(farm.policy(bob), client=bob, trials=1).json()["job_id"]
            with bob.stream("GET", f"/v1/jobs/{own}/events") as answer:
                assert answer.status_code == 200

        def may_again():
            with ann.stream("GET", path) as answer:
                return answer.status_code == 200

        until(may_again, PATIENCE_S, "closed streams to be forgotten")
    finally:
        farm.admin.post("/v1/robots/robot-0/resume")
