"""Effects are taken away one group at a time, all noise stays, and what is blamed is compared with a control."""

import dataclasses

import numpy as np
import pytest

from api_schemas.policy import LAYOUTS
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.replays import counterfactual
from sim_backend.replays.counterfactual import Again, End, Verdict, ends, explain, surely_more
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
    """A policy that moves by what it sees, keeps it, and takes so many trials at a time."""

    def __init__(self, together=16):
        self.together = together
        self.seen = []

    def most(self, _observation_size):
        return self.together

    def begin(self, trials):
        self.seen.append([])
        self.trials = trials

    def act(self, observation):
        assert len(observation) == self.trials
        self.seen[-1].append(observation)
        return 0.1 * np.sin(9 * observation[:, :9]).astype(float)

    def rows(self):
        """What each trial saw, shape (trials, periods, size)."""
        return np.concatenate([np.stack(each, axis=1) for each in self.seen])


def trial_of(physics, duration_s=0.2):
    start, goal = draw_trial(TASKS["push"], 3)
    start = dataclasses.replace(start, noise_seed=np.array([12345]))
    task = dataclasses.replace(TASKS["push"], duration_s=duration_s)
    return Again(task, goal, LAYOUTS["rrc2022-push"], CUBE, start, physics, ())


def test_taking_an_effect_away_leaves_the_noise_of_all_others():
    policy, names, trial = Watching(), LAYOUTS["rrc2022-push"].observation, trial_of(PHYSICS)
    ends([trial, trial.without(("tracking_noise",))], policy)
    full, without = policy.rows()
    joints = slice(0, 18)
    assert names[:2] == ("joint_position_rad", "joint_velocity_rad_s")
    assert np.array_equal(full[:, joints], without[:, joints])
    assert not np.array_equal(full, without)


def real_trial():
    rng = np.random.default_rng(0)
    physics = load_ranges("real").draw(rng, 1)
    ideal = trial_of(Physics.nominal())
    lies_m = ideal.start.cube_position_world_m * [1, 1, physics.value("cube_size.factor")[0]]
    return ideal, dataclasses.replace(
        ideal, physics=physics, start=dataclasses.replace(ideal.start, cube_position_world_m=lies_m)
    )


def test_all_effects_of_a_real_robot_away_is_the_ideal_robot():
    policy, (ideal, trial) = Watching(), real_trial()
    ends([trial.without(tuple(name for cause in trial.causes for name in cause.effects)), ideal], policy)
    away, nominal = policy.rows()
    np.testing.assert_allclose(away, nominal, atol=1e-6)  # another size is undone up to rounding


def test_replays_together_are_those_alone_bit_by_bit():
    """Rows with and without effects, with a fault that comes in the middle, under other seeds: as a robot alone has them."""
    _, trial = real_trial()
    fault = trial.physics.changed({"coulomb_friction.torque_nm": 0.3})
    faulty = dataclasses.replace(trial, changes=((100, fault),))
    causes = [trial.without(cause.effects) for cause in trial.causes]
    trials = [trial, faulty, trial.without((), 77), faulty.without(("coulomb_friction",)), *causes]
    alone, together = Watching(1), Watching(6)
    assert ends(trials, alone) == ends(trials, together)
    assert len(alone.seen) == len(trials) > 2 * len(together.seen)
    np.testing.assert_array_equal(alone.rows(), together.rows())
    assert not np.array_equal(alone.rows()[0], alone.rows()[1])


def test_a_replay_whose_physics_becomes_unstable_fails_alone():
    trial = trial_of(Physics.nominal())
    lost = dataclasses.replace(trial, start=dataclasses.replace(trial.start, cube_position_world_m=np.full((1, 3), 1e11)))
    found = ends([trial, lost, trial], Watching())
    assert found[0] == found[2]
    assert np.isfinite(found[0].error_m)
    assert found[1] == End(False, np.inf)


def answers(monkeypatch, succeeds):
    """Replays that succeed as a function of what is away and of the noise's seed."""
    had = [name for cause in trial_of(PHYSICS).causes for name in cause.effects]

    def answered(trials, _policy):
        seeds = [int(trial.start.noise_seed[0]) for trial in trials]
        away = [frozenset(name for name in had if not trial.physics.has(name)) for trial in trials]
        given = zip(away, (None if seed == 12345 else seed for seed in seeds), strict=True)
        return [End(bool(succeeds(*each)), 0.01) for each in given]

    monkeypatch.setattr(counterfactual, "ends", answered)
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


def test_a_trial_that_fails_without_any_effect_blames_none(monkeypatch):
    """However often it succeeds without one of them: of a chaotic policy some replay always does."""
    found = answers(monkeypatch, lambda away, _seed: away == {"coulomb_friction"})
    assert (found.verdict, found.blamed, found.replays) == (Verdict.POLICY, (), 1 + len(found.groups) + 8)
    unlucky = answers(monkeypatch, lambda away, seed: len(away) == 1 if seed is None else "coulomb_friction" in away)
    assert [each.name for each in unlucky.blamed] == ["joint_friction"], "under other noise the ideal robot succeeds"


def test_of_many_groups_that_turn_a_trial_each_must_be_surer(monkeypatch):
    """4 of 4 beside 2 of 4 of the control is enough for one group, and not where four turn the trial."""
    alone = answers(monkeypatch, lambda away, _seed: "coulomb_friction" in away)
    assert [each.name for each in alone.blamed] == ["joint_friction"]
    assert alone.blamed[0].needed == 0.95
    several = answers(monkeypatch, lambda away, _seed: bool(away))
    assert {each.needed for each in several.groups} == {1 - 0.05 / len(several.groups)}
    assert alone.blamed[0].needed < surely_more(4, 4, 2, 4) < several.groups[0].needed


@pytest.mark.parametrize(("won", "control", "low", "high"), [(4, 0, 0.99, 1.0), (2, 2, 0.49, 0.51), (0, 4, 0.0, 0.01)])
def test_the_probability_that_one_chance_is_larger(won, control, low, high):
    rng = np.random.default_rng(1)
    drawn = rng.beta(won + 0.5, 4.5 - won, 200_000) > rng.beta(control + 0.5, 4.5 - control, 200_000)
    assert low <= surely_more(won, 4, control, 4) <= high
    assert surely_more(won, 4, control, 4) == pytest.approx(drawn.mean(), abs=0.005)
