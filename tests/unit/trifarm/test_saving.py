"""What a library trained in trifarm's environment is saved with its manifest, and acts as the library's own policy does."""

import contextlib
import functools

import gymnasium
import numpy as np
import pytest
import torch

import trifarm
from api_schemas.policy import LAYOUTS
from client_cli.policies.policy_files import read_policy
from sim_backend.trifinger import constants as c
from tests.unit.client_cli.packing.packed import packed_actions
from tests.unit.trifarm.trained import LIBRARIES
from trifarm.saving import manifest_of

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
    env = gymnasium.wrappers.NormalizeObservation(trifarm.TrifingerEnv("push"))
    with pytest.raises(trifarm.ClientError, match="wrapped by NormalizeObservation"):
        trifarm.save_policy(torch.nn.Linear(75, 9), env, tmp_path / "p")


class Small(gymnasium.Env):
    """Says what it shows as trifarm's environments do, and costs nothing."""

    observation_space, action_space = (gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32) for size in (75, 9))
    manifest = property(lambda self: LAYOUTS["push"])


def wrapped(*wrappers):
    env = Small()
    for wrapper in wrappers:
        env = wrapper(env)
    return env


@pytest.mark.parametrize("kind", ["SubprocVecEnv", "AsyncVectorEnv"])
def test_wrappers_in_other_processes_are_seen(kind):
    from gymnasium.wrappers import ClipAction, NormalizeObservation

    with contextlib.closing(in_processes(kind, [ClipAction], [ClipAction])) as env:
        assert manifest_of(env) == LAYOUTS["push"], "a clip is what the robot does anyway"
    with (
        contextlib.closing(in_processes(kind, *2 * [[NormalizeObservation, ClipAction]])) as env,
        pytest.raises(trifarm.ClientError, match=r"NormalizeObservation.* changes what the policy sees"),
    ):
        manifest_of(env)


def in_processes(kind, *robots):
    made = [functools.partial(wrapped, *wrappers) for wrappers in robots]
    if kind == "SubprocVecEnv":
        vec_env = pytest.importorskip("stable_baselines3.common.vec_env", reason="stable-baselines3 is not installed")
        return vec_env.SubprocVecEnv(made, start_method="fork")
    from gymnasium.vector import AsyncVectorEnv

    return AsyncVectorEnv(made, context="fork")


def test_vec_normalize_counts_for_a_model_that_does_not_know_it(tmp_path):
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.vec_env import VecNormalize

    torch.manual_seed(0)
    env = VecNormalize(trifarm.TrifingerVecEnv(trifarm.practice_of("push", episode_s=0.2), robots=2, threads=1))
    size = env.observation_space.shape[0]
    rng = np.random.default_rng(0)
    env.obs_rms.mean, env.obs_rms.var = rng.normal(size=size), rng.uniform(0.5, 2.0, size)
    rows = rng.normal(size=(1, 5, size)).astype(np.float32)
    model = stable.PPO("MlpPolicy", env.venv, n_steps=8, batch_size=8, device="cpu")
    actor = torch.nn.Sequential(torch.nn.Linear(size, 16), torch.nn.Tanh(), torch.nn.Linear(16, 9))
    seen = env.normalize_obs(rows[0]).astype(np.float32)
    wanted = {
        "archive": np.clip(model.predict(seen, deterministic=True)[0], -1, 1),
        "module": np.clip(actor(torch.from_numpy(seen)).detach().numpy(), -1, 1),
    }
    for name, trained in (("archive", model), ("module", actor)):
        saved = trifarm.save_policy(trained, env, tmp_path / name)
        np.testing.assert_allclose(packed_actions(saved.weights, rows)[0], wanted[name] * c.MAX_TORQUE_NM, atol=1e-5)


def test_what_is_no_policy_or_no_environment_of_trifarm_is_said(tmp_path):
    with pytest.raises(trifarm.ClientError, match="object is none of trifarm's environments"):
        trifarm.save_policy(torch.nn.Linear(75, 9), object(), tmp_path / "p")
    with pytest.raises(trifarm.ClientError, match="a dict is no model of stable-baselines3"):
        trifarm.save_policy({}, trifarm.TrifingerEnv("push"), tmp_path / "p")
    with pytest.raises(trifarm.ClientError, match=r"cannot be run on one observation of shape \(1, 75\)"):
        trifarm.save_policy(torch.nn.Linear(8, 9), trifarm.TrifingerEnv("push"), tmp_path / "p")
