"""A built-in policy runs in a process of its own as a network does."""

import numpy as np
import pytest

from api_schemas.builtin_policies import BUILTIN, BUILTIN_NAMES, builtin_content, builtin_digest, builtin_manifest
from api_schemas.observation import OBSERVATION_SIZES
from api_schemas.policy import PolicyManifest
from api_schemas.trial import OutcomeKind
from robot_farm.policy.jail import BUILTIN_PROCESS, POLICY_PROCESS, JailedPolicy, PolicyFailedError
from sim_backend.grasping.controller import GraspPolicy
from sim_backend.trifinger import constants as c


def observation(manifest: PolicyManifest) -> np.ndarray:
    parts = {
        "joint_position_rad": c.START_JOINT_POSITION_RAD,
        "cube_position_world_m": [0.0, 0.0, c.CUBE_REST_HEIGHT_M],
        "cube_quat_wxyz": [1.0, 0.0, 0.0, 0.0],
        "tracker_delay_s": [0.09],
        "goal_position_world_m": [0.05, 0.0, c.CUBE_REST_HEIGHT_M],
        "goal_quat_wxyz": [0.8, 0.0, 0.0, 0.6],
    }
    assert [len(parts[name]) for name in manifest.observation] == [OBSERVATION_SIZES[name] for name in manifest.observation]
    return np.concatenate([parts[name] for name in manifest.observation]).astype(np.float32)


@pytest.mark.parametrize("name", BUILTIN)
def test_it_acts_as_the_controller_and_forgets_between_trials(name, tmp_path):
    file = tmp_path / "builtin"
    file.write_bytes(builtin_content(name))
    seen, controller = observation(BUILTIN[name]), GraspPolicy(BUILTIN[name])
    expected = [controller(seen[None])[0].astype(np.float32) for _ in range(30)]
    with JailedPolicy(builtin_digest(name), file, module=BUILTIN_PROCESS) as policy:
        for _ in range(2):
            policy.reset()
            np.testing.assert_array_equal([policy.act(seen)[0] for _ in range(30)], expected)
        policy.reset(2)
        both = [policy.act_each(np.stack([seen, seen])) for _ in range(30)]
        np.testing.assert_array_equal(both, np.stack([expected, expected], axis=1))
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


@pytest.mark.parametrize("name", BUILTIN)
def test_its_digest_names_it(name):
    assert BUILTIN_NAMES[builtin_digest(name)] == name


def test_a_text_that_names_it_gives_its_manifest_and_others_none():
    assert [builtin_manifest(f"builtin:{name}") for name in BUILTIN] == list(BUILTIN.values())
    assert [builtin_manifest(text) for text in ("grasp", "builtin:", "builtin:gras", "push.safetensors")] == [None] * 4


def test_the_digest_of_the_first_is_what_it_was():
    assert builtin_digest("grasp") == "92ac97bb7b0061689592b72ae7b5954112dc7a79f64376b5bec2d0dce75e6a3c"
