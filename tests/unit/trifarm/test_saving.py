"""What a library trained in trifarm's environment is saved with its manifest, and acts as the library's own policy does."""

import numpy as np
import pytest
import torch

import trifarm
from client_cli.policies.policy_files import read_policy
from sim_backend.trifinger import constants as c
from tests.unit.client_cli.packing.packed import packed_actions
from tests.unit.trifarm.trained import LIBRARIES

pytestmark = pytest.mark.filterwarnings("ignore")
"""What the libraries say of each other's versions."""


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_trained_policy_is_submitted_without_a_flag(library, tmp_path):
    pytest.importorskip(library, reason=f"{library} is not installed")
    torch.set_num_threads(1)
    torch.manual_seed(0)
    model, env, act = LIBRARIES[library]()
    saved = trifarm.save_policy(model, env, tmp_path / "mine")
    policy = read_policy(saved.weights, None, None)
    assert policy.manifest.name == "mine"
    assert policy.manifest.output_scaling.scale == (pytest.approx(c.MAX_TORQUE_NM),) * 9, "an action of 1 is the largest torque"
    assert not any("activation" in note for note in saved.notes)
    rows = np.random.default_rng(0).normal(size=(1, 25, policy.manifest.observation_size)).astype(np.float32)
    wanted = act(rows[0]) * c.MAX_TORQUE_NM
    assert np.abs(wanted).max() > 1e-3
    np.testing.assert_allclose(packed_actions(saved.weights, rows)[0], wanted, atol=1e-5)


def test_wrappers_that_change_what_is_seen_are_refused(tmp_path):
    import gymnasium

    env = gymnasium.wrappers.NormalizeObservation(trifarm.TrifingerEnv("push"))
    with pytest.raises(trifarm.ClientError, match="wrapped by NormalizeObservation"):
        trifarm.save_policy(torch.nn.Linear(75, 9), env, tmp_path / "p")


def test_what_is_no_policy_or_no_environment_of_trifarm_is_said(tmp_path):
    with pytest.raises(trifarm.ClientError, match="object is none of trifarm's environments"):
        trifarm.save_policy(torch.nn.Linear(75, 9), object(), tmp_path / "p")
    with pytest.raises(trifarm.ClientError, match="a dict is no model of stable-baselines3"):
        trifarm.save_policy({}, trifarm.TrifingerEnv("push"), tmp_path / "p")
    with pytest.raises(trifarm.ClientError, match=r"cannot be run on one observation of shape \(1, 75\)"):
        trifarm.save_policy(torch.nn.Linear(8, 9), trifarm.TrifingerEnv("push"), tmp_path / "p")
