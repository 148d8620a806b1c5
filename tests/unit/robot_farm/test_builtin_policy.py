"""A built-in policy runs in a process of its own as a network does."""

import numpy as np
import pytest

from api_schemas.builtin_policies import BUILTIN_NAMES, GRASP, builtin_content, builtin_digest
from api_schemas.policy import OBSERVATION_SIZES
from api_schemas.trial import OutcomeKind
from robot_farm.jail import BUILTIN_PROCESS, POLICY_PROCESS, JailedPolicy, PolicyFailedError
from sim_backend.grasping.controller import GraspPolicy
from sim_backend.trifinger import constants as c


def observation() -> np.ndarray:
    parts = {
        "joint_position_rad": c.START_JOINT_POSITION_RAD,
        "cube_position_world_m": [0.0, 0.0, c.CUBE_REST_HEIGHT_M],
        "cube_quat_wxyz": [1.0, 0.0, 0.0, 0.0],
        "tracker_delay_s": [0.09],
        "goal_position_world_m": [0.05, 0.0, c.CUBE_REST_HEIGHT_M],
    }
    assert [len(parts[name]) for name in GRASP.observation] == [OBSERVATION_SIZES[name] for name in GRASP.observation]
    return np.concatenate([parts[name] for name in GRASP.observation]).astype(np.float32)


def test_it_acts_as_the_controller_and_forgets_between_trials(tmp_path):
    file = tmp_path / "builtin"
    file.write_bytes(builtin_content("grasp"))
    seen, controller = observation(), GraspPolicy()
    expected = [controller(seen[None])[0].astype(np.float32) for _ in range(30)]
    with JailedPolicy(builtin_digest("grasp"), file, module=BUILTIN_PROCESS) as policy:
        for _ in range(2):
            policy.reset()
            np.testing.assert_array_equal([policy.act(seen)[0] for _ in range(30)], expected)
        assert policy.jail is not None


def test_a_version_that_it_does_not_know_is_no_fault_of_the_policy(tmp_path):
    file = tmp_path / "builtin"
    file.write_bytes(builtin_content("grasp") + b"later")
    with (
        JailedPolicy("x", file, module=BUILTIN_PROCESS) as policy,
        pytest.raises(PolicyFailedError, match="no such built-in") as caught,
    ):
        policy.reset()
    assert caught.value.kind is OutcomeKind.PLATFORM_ERROR


def test_a_robot_that_lacks_it_says_that_it_is_too_old_and_takes_it_for_no_broken_network(tmp_path):
    file = tmp_path / "builtin"
    file.write_bytes(builtin_content("grasp").replace(b"grasp, version 1", b"juggle, version 2"))
    with JailedPolicy("x", file, module=POLICY_PROCESS) as policy, pytest.raises(PolicyFailedError) as caught:
        policy.reset()
    assert caught.value.kind is OutcomeKind.PLATFORM_ERROR
    assert "too old for it: it does not know the trifarm built-in policy juggle, version 2; update" in str(caught.value)


def test_its_digest_names_it():
    assert BUILTIN_NAMES[builtin_digest("grasp")] == "grasp"
