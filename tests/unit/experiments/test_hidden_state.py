"""What a memory knows is found where it is planted, and is not found where it is not."""

import numpy as np
import pytest

from experiments.design import HiddenState
from experiments.hidden_state import ask, known
from sim_backend.tasks import TASKS
from sim_backend.training import reference_policies
from sim_backend.training.export import read_policy

N = 400


def made_up(rng, noise):
    """State (N, 30) in whose mixture the target is hidden under noise, and an observation that knows nothing."""
    target = rng.normal(size=N)
    sources = rng.normal(size=(N, 30))
    sources[:, 0] = target + noise * rng.normal(size=N)
    return sources @ rng.normal(size=(30, 30)), rng.normal(size=(N, 12)), target


def test_a_planted_property_is_known_from_the_state_alone():
    state, observation, target = made_up(np.random.default_rng(1), noise=0.5)
    found = known(state, observation, target, np.random.default_rng(2))
    assert found.of_state == pytest.approx(0.8, abs=0.1)  # 1 / (1 + 0.5²), less what 30 weights cost
    assert found.of_observation < 0.1
    assert 0.5 < found.low <= found.difference <= found.high
    assert found.robots == N // 2


def test_a_property_that_is_nowhere_is_not_known():
    state, observation, _ = made_up(np.random.default_rng(3), noise=0.5)
    other = np.random.default_rng(4).normal(size=N)
    found = known(state, observation, other, np.random.default_rng(5))
    assert found.of_state < 0.1
    assert found.low < 0.1


def test_what_the_observation_shows_is_no_gain_of_the_memory():
    state, _, target = made_up(np.random.default_rng(6), noise=0.5)
    found = known(state, np.column_stack([state, state]), target, np.random.default_rng(7))
    assert found.low < 0.05 and abs(found.difference) < 0.1


def test_an_observation_that_predicts_worse_than_the_mean_does_not_make_a_memory_know_more():
    """With as many numbers as an observation has, ridge regression finds what is not there: its R2 is below 0."""
    lows, rng = [], np.random.default_rng(8)
    for _ in range(10):
        found = known(rng.normal(size=(N, 3)), rng.normal(size=(N, 120)), rng.normal(size=N), rng)
        assert found.of_observation < 0
        lows.append(found.low)
    assert sum(low > 0 for low in lows) <= 1


def test_a_state_adds_to_what_is_seen_where_each_knows_a_half():
    rng = np.random.default_rng(9)
    state, observation = rng.normal(size=(N, 5)), rng.normal(size=(N, 5))
    found = known(state, observation, state[:, 0] + observation[:, 0], rng)
    assert found.of_state == pytest.approx(0.5, abs=0.12) and found.of_observation == pytest.approx(0.5, abs=0.12)
    assert found.of_both > 0.9 and found.low > 0.3


def test_it_is_told_which_robots_are_above_the_mean():
    rng = np.random.default_rng(10)
    state, observation, target = made_up(rng, noise=0.1)
    found = known(state, observation, target, rng)
    assert found.told_by_state > 0.9
    assert 0.35 < found.told_by_observation < 0.65


def test_a_policy_with_a_memory_is_asked_on_robots_that_differ():
    policy = read_policy(reference_policies.folder() / "push-recurrent.safetensors")
    design = HiddenState(("lstm",), robots=16, at_s=(0.1, 0.2))
    found = ask(policy, TASKS["push"], design)
    assert [each["at_s"] for each in found["parameters"]["cube_size.factor"]] == [0.1, 0.2]
    assert set(found["parameters"]) == set(design.parameters)


def test_a_policy_without_a_memory_cannot_be_asked():
    policy = read_policy(reference_policies.folder() / "push-scratch.safetensors")
    with pytest.raises(ValueError, match="no memory"):
        ask(policy, TASKS["push"], HiddenState(("x",), robots=2, at_s=(0.02,)))
