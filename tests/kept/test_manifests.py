"""Manifests of earlier versions are accepted, and their policies keep their digests."""

import json

import pytest

from api_schemas.policy import LAYOUTS, PolicyManifest, policy_digest
from tests.kept.versions import HERE, VERSIONS, told

DIGESTS = {(version, name): digest for version in VERSIONS for name, digest in told(version, "digests").items()}
NO_WEIGHTS = "0" * 64
"""Stands for the weights' digest in the kept ones."""


@pytest.mark.parametrize(("version", "name"), DIGESTS)
def test_a_manifest_says_today_what_it_said(version, name):
    written = (HERE / version / "manifests" / f"{name}.json").read_text()
    manifest = PolicyManifest.model_validate_json(written)
    assert policy_digest(NO_WEIGHTS, manifest) == DIGESTS[version, name]
    understood = manifest.model_dump(mode="json")
    for field, value in json.loads(written).items():
        if isinstance(value, dict):
            assert value.items() <= understood[field].items()
        else:
            assert understood[field] == value


@pytest.mark.parametrize("version", VERSIONS)
def test_ready_made_layouts_are_what_they_were(version):
    kept = {
        name.removeprefix("layout-"): digest for name, digest in told(version, "digests").items() if name.startswith("layout-")
    }
    assert kept.items() <= {name: policy_digest(NO_WEIGHTS, manifest) for name, manifest in LAYOUTS.items()}.items()


@pytest.mark.parametrize("version", VERSIONS)
def test_every_manifest_has_a_digest(version):
    files = {path.stem for path in (HERE / version / "manifests").glob("*.json")}
    assert files == set(told(version, "digests"))
