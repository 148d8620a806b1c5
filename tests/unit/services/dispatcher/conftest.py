"""A database with a policy and a running job of three trials that are to be added."""

import json

import pytest
from sqlalchemy import insert

from api_schemas.trial import TrialState
from services.database.tables import job, policy, trial

POLICY = {"number": 1, "digest": "d" * 64, "name": "p", "weights_format": "onnx", "weights_sha256": "w" * 64, "weights_bytes": 1}
POLICY |= {"graph_sha256": "g" * 64, "manifest": "{}", "warnings": "[]", "owner": "o", "created_at": "now"}
JOB = {"number": 1, "job_id": "j1", "state": "running", "policy": "d" * 64, "policy_name": "p", "task": "push", "trials": 3}
JOB |= {"seed": 1, "seed_drawn_by_server": False, "owner": "o", "created_at": "now", "created_s": 0.0}


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(job).values(JOB))
    return new_database


async def add_trials(database, orders, fence=0):
    rows = [
        {"trial_id": f"j1-{number:03d}", "job_number": 1, "ordinal": number, "state": TrialState.QUEUED, "seed": number}
        | {"robot_order": json.dumps(order), "first_choice": order[0], "fence": fence}
        for number, order in enumerate(orders)
    ]
    async with database.write() as tx:
        await tx.execute(insert(trial), rows)
