import pytest
from pydantic import ValidationError

from api_schemas.excitation import ExcitationName, IdentificationRequest
from api_schemas.job import POLICY_TASKS, JobRequest, TaskName
from api_schemas.policy import LAYOUTS
from api_schemas.robot import Lease

POLICY = {"policy": "0" * 64, "manifest": LAYOUTS["pose"], "graph_sha256": "0" * 64}
LEASE = {"trial_id": "j-000", "job_id": "j", "ordinal": 0, "fence": 1, "robot": "robot-0", "seed": 1}


def test_all_excitations_once_unless_said_otherwise():
    assert IdentificationRequest(robot="any").courses() == tuple(ExcitationName)
    some = IdentificationRequest(robot="robot-3", excitations=("chirps", "slow_ramps"), repeats=2)
    assert some.courses() == ("chirps", "slow_ramps", "chirps", "slow_ramps")


def test_a_job_of_a_policy_cannot_identify():
    with pytest.raises(ValidationError, match="POST /v1/identifications asks for it"):
        JobRequest(policy="0" * 64, task=TaskName.IDENTIFY)
    assert [JobRequest(policy="0" * 64, task=task).task for task in POLICY_TASKS] == list(POLICY_TASKS)


def test_a_lease_is_of_a_policy_or_of_an_excitation():
    assert Lease(**LEASE, **POLICY, task="push").excitation is None
    assert Lease(**LEASE, task="identify", excitation="chirps").policy is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"task": "push"},
        {"task": "push", "excitation": "chirps"},
        {"task": "identify"},
        {"task": "identify", "excitation": "chirps", **POLICY},
        {"task": "push", **POLICY, "excitation": "chirps"},
        {"task": "push", **POLICY, "manifest": None},
    ],
)
def test_a_lease_is_never_of_both_nor_of_neither(wrong):
    with pytest.raises(ValidationError, match="must have"):
        Lease(**LEASE, **wrong)
