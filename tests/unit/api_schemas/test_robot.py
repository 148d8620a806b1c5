"""What a robot is offered; robots of the version before take it as far as it asks for nothing that they do not know."""

import json

import pytest

from api_schemas.policy import LAYOUTS, canonical_json
from api_schemas.robot import Lease

LEASE = {"trial_id": "j-000", "job_id": "j", "ordinal": 0, "fence": 1, "robot": "robot-0", "task": "push", "seed": 1}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_lease_has_nothing_that_came_later_and_says_nothing(layout):
    manifest = LAYOUTS[layout]
    lease = Lease(**LEASE, policy="d" * 64, manifest=manifest, graph_sha256="a" * 64)
    told = json.loads(lease.model_dump_json())
    assert told["manifest"] == json.loads(canonical_json(manifest))
    assert told.keys().isdisjoint({"own_goal", "images"})
    assert Lease.model_validate_json(lease.model_dump_json()) == lease
