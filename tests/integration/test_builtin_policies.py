"""Policies that come with the farm are the operators'."""

import pytest

from api_schemas.builtin_policies import BUILTIN, GRASP, builtin_content, builtin_digest
from api_schemas.policy import canonical_json
from tests.integration.farm_process import services
from tests.integration.test_dashboard import user_token


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("builtin") / "farm") as running:
        yield running


@pytest.mark.parametrize("name", BUILTIN)
def test_an_operator_has_it_at_once_and_only_once(farm, name):
    first = farm.admin.put(f"/v1/policies/builtin/{name}")
    assert first.status_code == 201, first.text
    assert (first.json()["digest"], first.json()["weights_format"]) == (builtin_digest(name), "builtin")
    graph = first.json()["graph_sha256"]
    (farm.data / "files" / "sha256" / graph[:2] / graph).unlink()
    assert farm.admin.put(f"/v1/policies/builtin/{name}").status_code == 200
    assert farm.admin.get(f"/v1/policies/{first.json()['digest']}/graph").status_code == 200, "what was gone is there again"
    names = [policy["name"] for policy in farm.admin.get("/v1/policies").json()["policies"]]
    assert names.count(f"builtin-{name}") == 1
    job = farm.admin.post("/v1/jobs", json={"policy": first.json()["digest"], "task": "move_cube_2", "trials": 1})
    assert job.status_code == 201, job.text


def test_a_user_has_it_in_no_way(farm):
    farm.admin.put("/v1/policies/builtin/grasp")
    token = {"Authorization": f"Bearer {user_token(farm, 'ada')['secret']}"}
    assert farm.admin.put("/v1/policies/builtin/grasp", headers=token).status_code == 403
    form = {"files": {"weights": ("w.safetensors", builtin_content("grasp"))}, "data": {"manifest": canonical_json(GRASP)}}
    sent = farm.admin.put(f"/v1/policies/{builtin_digest('grasp')}", headers=token, **form)
    assert sent.json()["type"].endswith("policy-built-in"), "what stands for its weights is no secret"
    job = {"policy": builtin_digest("grasp"), "task": "push", "trials": 1}
    assert farm.admin.post("/v1/jobs", json=job, headers=token).json()["type"].endswith("policy-not-found")


def test_there_is_no_other(farm):
    assert farm.admin.put("/v1/policies/builtin/other").status_code == 422
