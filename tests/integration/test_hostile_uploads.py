"""Hostile files sent to a real server: typed problems, nothing kept, no canary fires, and the server goes on."""

import socket

import numpy as np
import pytest

from tests.hostile.corpus import corpus
from tests.hostile.mutations import KINDS
from tests.hostile.valid import MANIFEST, VALID
from tests.integration.farm_process import services

SENT = (
    "pickle protocol 4 as onnx",
    "pickle named pkl",
    "pickle in policy.pth",
    "VecNormalize beside",
    "TorchScript",
    "torch.export",
    "opcodes an instance",
    "ratio",
    "lies about its size",
    "nested",
    "dots",
    "link",
    "deep lists",
    "overlap",
    "no number",
    "external data",
    "external data in a sparse tensor",
    "a library's operator",
    "a million fields",
)


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("hostile") / "farm") as running:
        yield running


def stored(farm):
    return {path.name for path in (farm.data / "files").rglob("*") if path.is_file()}


def problem_of(answer):
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == answer.status_code
    assert problem["type"].startswith("/problems/")
    assert {"title", "detail", "file", "part", "instead"} <= set(problem)
    return problem


def test_hostile_files_are_refused_by_the_server(farm, tmp_path):
    canary, before = tmp_path / "canary", stored(farm)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        cases = corpus(canary, server.getsockname()[1])
        for name in SENT:
            case = cases[name]
            answer = farm.upload(case.content, MANIFEST, filename=case.filename)
            assert answer.status_code == 422, (name, answer.text)
            problem = problem_of(answer)
            assert problem["file"] == case.filename
            assert case.slug in ("", problem["type"].removeprefix("/problems/")), name
            assert ("trifarm pack" in problem["detail"]) == case.packs, name
        with pytest.raises(BlockingIOError):
            server.accept()
    assert not canary.exists()
    assert stored(farm) == before
    assert farm.admin.get("/v1/policies").json()["policies"] == []


@pytest.mark.parametrize("kind", KINDS)
def test_mutations_are_refused_or_taken_by_the_server(farm, kind):
    suffix, make = KINDS[kind]
    rng = np.random.default_rng(11)
    for each in range(6):
        answer = farm.upload(make(each % 3, rng)[1], MANIFEST, filename=f"p.{suffix}")
        assert answer.status_code in (200, 201, 422), answer.text
        if answer.status_code == 422:
            problem_of(answer)


@pytest.mark.parametrize("kind", VALID)
def test_valid_files_of_each_kind_are_taken_by_the_same_server(farm, kind):
    answer = farm.upload(VALID[kind](seed=2), MANIFEST, filename=f"policy.{kind}")
    assert answer.status_code in (200, 201), answer.text
    assert answer.json()["warnings"] == []
    assert answer.json()["weights_format"] == kind


def test_the_wrong_digest_names_file_and_remedy(farm):
    content = VALID["zip"]()
    answer = farm.admin.put(
        f"/v1/policies/{'0' * 64}", files={"weights": ("a b.zip", content)}, data={"manifest": MANIFEST.model_dump_json()}
    )
    assert (answer.status_code, problem_of(answer)["type"]) == (422, "/problems/digest-mismatch")
    assert answer.json()["file"] == "a b.zip"
