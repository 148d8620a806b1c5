"""Robots that practise side by side do what each would do in a trial of its own, whenever its trial begins."""

import numpy as np
import pytest

from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.environments.action_space import BINS, ActionMode, ActionSpace
from sim_backend.environments.environment import PRIVILEGED_SIZE, Environment
from sim_backend.environments.practice import practice_of
from sim_backend.evaluation import begin_trials
from sim_backend.tasks import TASKS
from sim_backend.tasks.reward import Reward, RewardKind, State, nearness
from sim_backend.tasks.task import draw_trial
from tests.unit.sim_backend.driver.backends import BACKENDS, needs_warp

STEP_S, TRIAL_S = 0.004, 0.4
PERIODS = 20


class Robots:
    """Draws robots of ``real`` and keeps whose trial began when, on which robot."""

    def __init__(self) -> None:
        self.ranges, self.begun = load_ranges("real"), []

    def __call__(self, rng: np.random.Generator, robots: np.ndarray) -> Physics:
        drawn = self.ranges.draw_episode(rng, self.ranges.draw(rng, len(robots)))
        self.begun.append((robots, drawn))
        return drawn


class Seeds(Environment):
    """Keeps the seeds of the trials."""

    def _draw_seeds(self, n: int) -> np.ndarray:
        seeds = super()._draw_seeds(n)
        self.seeds = [*getattr(self, "seeds", []), seeds]
        return seeds


@pytest.mark.parametrize("layout", ["push", "rrc2022-push"])  # without and with a delay of the action
def test_a_trial_that_begins_among_others_is_the_trial_alone(layout):
    robots = Robots()
    practice = practice_of("push", layout=layout, physics=robots, episode_s=TRIAL_S, physics_step_s=STEP_S)
    environment = Seeds(practice, robots=25, threads=2)
    seen, actions = [environment.reset(np.random.default_rng(3))], []
    rng = np.random.default_rng(0)
    for _ in range(2 * PERIODS):
        actions.append(rng.uniform(-1, 1, (25, 9)))
        seen.append(environment.step(actions[-1]).observation)
    row = 9  # its first trial is cut to 8 of 20 periods, so that the next one begins among trials of all ages
    first = next(k for k, (rows, _) in enumerate(robots.begun[1:], 1) if row in rows)
    place = int(np.flatnonzero(robots.begun[first][0] == row)[0])
    begun = 20 * (row + 1) // 25
    physics, seed = robots.begun[first][1].row(place), int(environment.seeds[first][place])
    alone, _ = begin_trials(practice.manifest, TASKS["push"], [seed], physics=physics, physics_step_s=STEP_S)
    for step in range(begun, begun + PERIODS - 1):
        np.testing.assert_array_equal(seen[step][row], alone.observe()[0].astype(np.float32))
        alone.advance(actions[step][row][None] * practice.action_space.largest)


@needs_warp
def test_a_trial_among_others_on_warp_is_the_trial_alone_on_mujoco():
    robots = Robots()
    practice = practice_of("push", layout="push", physics=robots, episode_s=TRIAL_S, physics_step_s=STEP_S)
    environment = Seeds(practice, robots=5, physics_backend=PhysicsBackend.WARP_CPU)
    seen = [environment.reset(np.random.default_rng(3))]
    actions = np.random.default_rng(0).uniform(-1, 1, (2 * PERIODS - 1, 5, 9))
    seen += [environment.step(action).observation for action in actions]
    assert len(robots.begun) == 2, "all trials ended once"
    for row in range(5):
        physics, seed = robots.begun[1][1].row(row), int(environment.seeds[1][row])
        alone, _ = begin_trials(practice.manifest, TASKS["push"], [seed], physics=physics, physics_step_s=STEP_S)
        for step in range(PERIODS, 2 * PERIODS):
            difference = np.abs(seen[step][row] - alone.observe()[0])
            assert np.median(difference) < 1e-4 and difference.max() < 0.1
            if step < 2 * PERIODS - 1:
                alone.advance(actions[step][row][None] * practice.action_space.largest)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_robot_is_a_row_of_many(backend):
    def practice(physics):
        return practice_of("reach", physics=physics, episode_s=TRIAL_S, physics_step_s=STEP_S)

    real = Robots()
    many = Seeds(practice(real), robots=3, physics_backend=backend)
    rng = np.random.default_rng(1)
    first = many.reset(np.random.default_rng(8))
    for row in range(3):
        physics, seed = real.begun[0][1].row(row), int(many.seeds[0][row])
        one = Environment(practice(lambda _rng, _robots, physics=physics: physics), physics_backend=backend)
        np.testing.assert_array_equal(one.reset(rng, trial_seed=seed)[0], first[row])
    actions = rng.uniform(-1, 1, (PERIODS - 1, 3, 9))
    for action in actions:
        together, alone = many.step(action), one.step(action[2:])
        np.testing.assert_array_equal(together.observation[2], alone.observation[0])
        np.testing.assert_allclose(together.reward[2], alone.reward[0], rtol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_first_trials_end_at_different_times_and_later_ones_last_their_time(backend):
    practice = practice_of("reach", episode_s=1.0, physics_step_s=STEP_S)
    environment = Environment(practice, robots=50, physics_backend=backend)
    environment.reset(np.random.default_rng(0))
    ends = {robot: [] for robot in range(50)}
    for step in range(1, 101):
        ended = environment.step(np.zeros((50, 9))).ended
        for robot in () if ended is None else ended.robots:
            ends[robot].append(step)
    assert len({tuple(each) for each in ends.values()}) == 25
    assert all(np.diff(each).tolist() == [50] * (len(each) - 1) for each in ends.values())
    assert {each[0] for each in ends.values()} == set(range(2, 51, 2))


@pytest.mark.parametrize("backend", BACKENDS)
def test_privileged_state_is_finite_and_of_its_size(backend):
    practice = practice_of("push", physics="real", physics_step_s=STEP_S)
    environment = Environment(practice, robots=2, physics_backend=backend)
    environment.reset(np.random.default_rng(0))
    environment.step(np.zeros((2, 9)))
    state = environment.privileged()
    assert state.shape == (2, PRIVILEGED_SIZE)
    assert np.isfinite(state).all()
    assert (state[0] != state[1]).any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_simulation_that_becomes_unstable_begins_anew_and_leaves_the_others_alone(backend):
    practice = practice_of("reach", episode_s=1.0, physics_step_s=STEP_S)
    environment = Environment(practice, robots=3, physics_backend=backend)
    environment.reset(np.random.default_rng(0))
    environment._driver._qvel[1] = 1e12
    stepped = environment.step(np.zeros((3, 9)))
    assert stepped.ended is not None
    assert stepped.ended.robots.tolist() == [1] and stepped.ended.diverged.all()
    assert np.isfinite(stepped.observation).all() and np.isfinite(stepped.ended.observation).all()
    assert environment.step(np.zeros((3, 9))).ended is None


@pytest.mark.parametrize("mode", ActionMode)
def test_actions_are_what_their_manifest_says(mode):
    acts = ActionSpace(mode)
    manifest = acts.manifest(practice_of("push").manifest)
    least, most = (0, BINS - 1) if mode is ActionMode.BINS else (-1, 1)
    scaling = manifest.output_scaling
    offset = 0.0 if scaling.offset is None else np.array(scaling.offset)
    np.testing.assert_allclose(acts.to_command(np.full((1, 9), most))[0], offset + np.array(scaling.scale))
    np.testing.assert_allclose(acts.to_command(np.full((1, 9), least))[0], offset - np.array(scaling.scale))
    assert (manifest.bins == BINS) == (mode is ActionMode.BINS)


@pytest.mark.parametrize("kind", RewardKind)
@pytest.mark.parametrize("name", TASKS)
def test_at_the_goal_is_nearest(name, kind):
    task = TASKS[name]
    _, goal = draw_trial(task, 5)
    tips = goal.fingertip_position_world_m
    at_goal = State(goal.cube_position_world_m, goal.cube_quat_wxyz, tips, np.zeros((1, 9)))
    away = State(goal.cube_position_world_m + 0.05, goal.cube_quat_wxyz, tips + 0.05, np.zeros((1, 9)))
    most = 0.25 + (1 / 3 if kind is RewardKind.POSITION_ROTATION and task.moves_cube and task.orientation_counts else 0)
    reward = Reward(kind)
    assert nearness(reward, task, goal, at_goal)[0] == pytest.approx(most)
    assert nearness(reward, task, goal, away)[0] < 0.7 * most


def test_a_sharper_kernel_makes_the_last_centimetres_count():
    _, goal = draw_trial(TASKS["push"], 5)
    near = State(
        goal.cube_position_world_m + np.array([0.02, 0, 0]),
        goal.cube_quat_wxyz,
        goal.fingertip_position_world_m,
        np.zeros((1, 9)),
    )
    lost = [0.25 - nearness(Reward(kernel_per_m=per_m), TASKS["push"], goal, near)[0] for per_m in (50.0, 100.0)]
    np.testing.assert_allclose(lost, [0.25 - 1 / (np.exp(x) + 2 + np.exp(-x)) for x in (1.0, 2.0)])
    both = nearness(Reward(kernel_per_m=50.0, fine_kernel_per_m=100.0), TASKS["push"], goal, near)[0]
    assert 0.25 - both == pytest.approx(np.mean(lost))
    of_position = Reward(kind=RewardKind.POSITION_ROTATION, fine_kernel_per_m=100.0)
    assert nearness(of_position, TASKS["push"], goal, near)[0] == pytest.approx(both), "its own first kernel is of 50 per metre"


def test_approaching_is_rewarded_and_haste_is_not():
    environment = Environment(practice_of("push", reward=Reward(goal=0.0, joint_speed=0.0), physics_step_s=STEP_S))
    environment.reset(np.random.default_rng(0))
    before = environment._away_m.copy()
    reward = environment.step(np.full((1, 9), -0.5)).reward
    np.testing.assert_allclose(reward, 2.5 * (before - environment._away_m), rtol=1e-9)
    hasty = Environment(practice_of("push", reward=Reward(goal=0.0, approach=0.0), physics_step_s=STEP_S))
    hasty.reset(np.random.default_rng(0))
    assert hasty.step(np.full((1, 9), -0.5)).reward[0] < 0.0


@pytest.mark.parametrize("layout", ["push", "rrc2022-push"])  # torques, and positions with a delay of the action
@pytest.mark.parametrize("physics", ["nominal", "real"])
def test_another_environment_goes_on_from_a_state_with_the_same_bits(physics, layout):
    practice = practice_of("push", layout=layout, physics=physics, episode_s=TRIAL_S, physics_step_s=STEP_S)
    first, second = (Environment(practice, robots=6, threads=1) for _ in range(2))
    actions = np.random.default_rng(0).uniform(-1, 1, (2 * PERIODS, 6, 9))
    first.reset(np.random.default_rng(3))
    for action in actions[: PERIODS - 5]:
        seen = first.step(action).observation
    np.testing.assert_array_equal(second.restore(first.state()), seen)
    for environment in (first, second):
        environment.draw_by(np.random.default_rng(4))
    for action in actions[PERIODS - 5 :]:  # beyond the end of all trials
        one, other = (environment.step(action) for environment in (first, second))
        np.testing.assert_array_equal(one.observation, other.observation)
        np.testing.assert_array_equal(one.reward, other.reward)
        np.testing.assert_array_equal(first.privileged(), second.privileged())
