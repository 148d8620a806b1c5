"""Effects are taken away one group at a time, all noise stays, and what is blamed is compared with a control."""

import dataclasses

import numpy as np
import pytest

from api_schemas.policy import LAYOUTS
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.replays import counterfactual
from sim_backend.replays.counterfactual import Again, End, Verdict, explain, replayed, surely_more
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial
from sim_backend.trifinger.objects import CUBE

PHYSICS = Physics.of(
    1,
    {
        "coulomb_friction.torque_nm": 0.02,
        "joint_noise.position_rad": 0.01,
        "joint_noise.velocity_rad_s": 0.1,
        "tracking_noise.position_m": 0.004,
        "tracking_latency.extra_s": 0.1,
    },
)


class Watching:
    """A policy that holds still and keeps what it sees."""

    def begin(self):
        self.seen = []

    def act(self, observation):
        self.seen.append(observation)
        return np.zeros(9)


def trial_of(physics, duration_s=0.2):
    start, goal = draw_trial(TASKS["push"], 3)
    start = dataclasses.replace(start, noise_seed=np.array([12345]))
    task = dataclasses.replace(TASKS["push"], duration_s=duration_s)
    return Again(task, goal, LAYOUTS["rrc2022-push"], CUBE, start, physics, ())


def test_taking_an_effect_away_leaves_the_noise_of_all_others():
    policy, names = Watching(), LAYOUTS["rrc2022-push"].observation
    replayed(trial_of(PHYSICS), policy)
    full = np.array(policy.seen)
    replayed(trial_of(PHYSICS), policy, ("tracking_noise",))
    without = np.array(policy.seen)
    joints = slice(0, 18)
    assert names[:2] == ("joint_position_rad", "joint_velocity_rad_s")
    assert np.array_equal(full[:, joints], without[:, joints])
    assert not np.array_equal(full, without)


def test_all_effects_of_a_real_robot_away_is_the_ideal_robot():
    rng = np.random.default_rng(0)
    physics = load_ranges("real").draw(rng, 1)
    ideal, policy = trial_of(Physics.nominal()), Watching()
    lies_m = ideal.start.cube_position_world_m * [1, 1, physics.value("cube_size.factor")[0]]
    trial = dataclasses.replace(ideal, physics=physics, start=dataclasses.replace(ideal.start, cube_position_world_m=lies_m))
    replayed(trial, policy, tuple(name for cause in trial.causes for name in cause.effects))
    away = np.array(policy.seen)
    replayed(ideal, policy)
    np.testing.assert_allclose(away, np.array(policy.seen), atol=1e-6)  # another size is undone up to rounding


def answers(monkeypatch, succeeds):
    """Replays that succeed as a function of what is away and of the noise's seed."""
    monkeypatch.setattr(
        counterfactual, "replayed", lambda _trial, _policy, away=(), seed=None: End(bool(succeeds(frozenset(away), seed)), 0.01)
    )
    return explain(trial_of(PHYSICS), Watching())


def test_the_group_without_which_it_succeeds_is_blamed_and_its_effect_named(monkeypatch):
    found = answers(monkeypatch, lambda away, _seed: "tracking_latency" in away)
    assert (found.verdict, [each.name for each in found.blamed]) == (Verdict.CAUSE, ["late_camera"])
    assert [(each.name, each.explains) for each in found.effects] == [("tracking_latency", True)]
    assert (found.control_successes, found.control_replays) == (0, 4)


def test_a_trial_that_any_other_noise_turns_is_chance_and_blames_nothing(monkeypatch):
    found = answers(monkeypatch, lambda away, seed: seed is not None or "coulomb_friction" in away)
    assert (found.verdict, found.blamed) == (Verdict.CHANCE, ())


def test_a_success_under_the_trials_own_noise_alone_blames_nothing(monkeypatch):
    found = answers(monkeypatch, lambda away, seed: seed is None and "coulomb_friction" in away)
    assert (found.verdict, found.blamed) == (Verdict.TOGETHER if found.ideal.success else Verdict.POLICY, ())


def test_without_any_turn_it_is_the_policy_or_several_together(monkeypatch):
    assert answers(monkeypatch, lambda _away, _seed: False).verdict is Verdict.POLICY
    assert answers(monkeypatch, lambda away, _seed: len(away) == 4).verdict is Verdict.TOGETHER


@pytest.mark.parametrize(("won", "control", "low", "high"), [(4, 0, 0.99, 1.0), (2, 2, 0.49, 0.51), (0, 4, 0.0, 0.01)])
def test_the_probability_that_one_chance_is_larger(won, control, low, high):
    rng = np.random.default_rng(1)
    drawn = rng.beta(won + 0.5, 4.5 - won, 200_000) > rng.beta(control + 0.5, 4.5 - control, 200_000)
    assert low <= surely_more(won, 4, control, 4) <= high
    assert surely_more(won, 4, control, 4) == pytest.approx(drawn.mean(), abs=0.005)
