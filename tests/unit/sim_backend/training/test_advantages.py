"""Advantages of rollouts that an older policy made."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from gymnasium import spaces  # noqa: E402
from stable_baselines3.common.buffers import RolloutBuffer  # noqa: E402

from sim_backend.training.returns import advantages_by_importance  # noqa: E402

DISCOUNT, GAE_LAMBDA, STEPS, ROBOTS = 0.97, 0.9, 12, 5


def drawn():
    rng = np.random.default_rng(29)
    rewards, values = rng.normal(size=(2, STEPS, ROBOTS)).astype(np.float32)
    return rewards, values, rng.normal(size=ROBOTS).astype(np.float32), rng.random((STEPS, ROBOTS)) < 0.2


def test_where_the_policy_is_the_same_they_are_those_of_stable_baselines():
    rewards, values, last_values, dones = drawn()
    space = spaces.Box(-1, 1, (1,), np.float32)
    buffer = RolloutBuffer(STEPS, space, space, gamma=DISCOUNT, gae_lambda=GAE_LAMBDA, n_envs=ROBOTS)
    buffer.rewards, buffer.values = rewards, values
    buffer.episode_starts[1:] = dones[:-1]
    buffer.compute_returns_and_advantage(torch.from_numpy(last_values), dones[-1])
    same = np.ones_like(rewards)
    advantages, targets = advantages_by_importance(rewards, values, last_values, dones, same, DISCOUNT, GAE_LAMBDA)
    np.testing.assert_allclose(advantages, buffer.advantages, atol=1e-5)
    np.testing.assert_allclose(targets, buffer.returns, atol=1e-5)


def test_two_steps_by_hand():
    """The older policy acted so always, the present one would with 0.8 and with 0.3: means over what it would get are these."""
    shares = np.array([[0.8], [0.3]], np.float32)
    rewards, values = np.array([[1.0], [2.0]], np.float32), np.array([[0.5], [0.25]], np.float32)
    dones = np.array([[False], [True]])
    advantages, targets = advantages_by_importance(rewards, values, np.zeros(1, np.float32), dones, shares, DISCOUNT, 1.0)
    second = 0.3 * (2.0 - 0.25)
    first = 0.8 * (1.0 + DISCOUNT * (0.25 + second) - 0.5)
    np.testing.assert_allclose(advantages[:, 0], [first, second], rtol=1e-6)
    np.testing.assert_allclose(targets[:, 0], [0.5 + first, 0.25 + second], rtol=1e-6)


def test_what_nobody_would_do_now_teaches_nothing_and_hides_what_came_after():
    rewards, values, last_values, dones = drawn()
    weights = np.ones_like(rewards)
    weights[6] = 0.0
    dones[:] = False
    advantages, _ = advantages_by_importance(rewards, values, last_values, dones, weights, DISCOUNT, GAE_LAMBDA)
    assert (advantages[6] == 0.0).all()
    rewards[7:] += 100.0
    again, _ = advantages_by_importance(rewards, values, last_values, dones, weights, DISCOUNT, GAE_LAMBDA)
    np.testing.assert_array_equal(again[:7], advantages[:7])
