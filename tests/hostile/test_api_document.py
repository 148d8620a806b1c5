"""The served OpenAPI document tells the truth: the short form of ``python -m tests.hostile.fuzz_api``."""

import pytest

from tests.hostile import fuzz_api
from tests.integration.farm_process import services


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("document") / "farm", **fuzz_api.SETTINGS) as running:
        yield running


def test_no_answer_is_a_5xx_or_contradicts_the_document(farm):
    found = fuzz_api.passes(farm, farm.tokens["admin"], examples=3, seed=1, phases="fuzzing")
    operations = sum(len(path) for path in farm.admin.get("/openapi.json").json()["paths"].values())
    for name, run in found.items():
        assert (run["failures"], run["exit_code"]) == ({}, 0), (name, run)
    assert [run["operations"] for run in found.values()] == [operations - 1, operations - 1, 1]
    assert farm.admin.get("/v1/tokens").status_code == 200  # nobody was locked out on the way
    # What exists was found: answers of 404 alone would show little.
    for name, run in found.items():
        assert not {"GET /v1/jobs/{job_id}", "GET /v1/policies/{digest}"} & set(run["never_succeeded"]), (name, run)
