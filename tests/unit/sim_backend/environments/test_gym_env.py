"""Every registered environment is one in Gymnasium's sense, and its docstring's tables are true."""

import re

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'learning' is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from api_schemas.policy import LAYOUTS  # noqa: E402
from sim_backend.environments import gym_env  # noqa: E402
from sim_backend.environments.action_space import ActionMode  # noqa: E402
from sim_backend.environments.observation_space import FIELDS, observation_space  # noqa: E402
from sim_backend.layouts import layout_of  # noqa: E402
from sim_backend.tasks import TASKS  # noqa: E402
from sim_backend.tasks.task import draw_trial  # noqa: E402

OURS = [name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("sim_backend.")]


def test_every_task_is_registered():
    assert sorted(gym_env.IDS.values()) == sorted(TASKS)
    assert sorted(OURS) == sorted(gym_env.IDS)


@pytest.mark.parametrize("name", OURS)
def test_gymnasium_finds_nothing_wrong(name):
    environment = gymnasium.make(name, physics_step_s=0.004)
    check_env(environment.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("action", [mode.value for mode in ActionMode])
@pytest.mark.parametrize("reward", ["keypoint kernel", "position+rotation"])
def test_actions_and_rewards_by_name(action, reward):
    environment = gymnasium.make(
        "trifarm/FloorPose-v0", action=action, reward=reward, physics="real", layout="pose", episode_s=0.2, physics_step_s=0.004
    )
    observation, info = environment.reset(seed=4)
    environment.action_space.seed(4)
    for step in range(10):
        assert environment.observation_space.contains(observation)
        observation, value, terminated, truncated, info = environment.step(environment.action_space.sample())
        assert np.isfinite(value) and not terminated
        assert truncated == (step == 9)
    assert set(info) == {"success", "position_error_m", "angle_error_rad"}


def test_a_trial_of_the_farm_can_be_asked_for():
    environment = gymnasium.make("trifarm/Push-v0", layout="pose")
    observation, _ = environment.reset(seed=0, options={"trial_seed": 77})
    start, goal = draw_trial(TASKS["push"], 77)
    np.testing.assert_allclose(observation[18:21], start.cube_position_world_m[0], atol=1e-7)
    np.testing.assert_allclose(observation[25:28], goal.cube_position_world_m[0], atol=1e-7)


def test_unknown_names_are_told_the_known_ones():
    for name, value in (("layout", "nothing"), ("physics", "nothing"), ("task", "nothing")):
        with pytest.raises(ValueError, match=r"nothing.*choose from"):
            gym_env.TrifingerEnv(**{name: value})


@pytest.mark.parametrize("layout", ["keypoints", "reach", "pose"])
def test_tables_of_the_docstring_are_those_of_the_code(layout):
    text = gym_env.TrifingerEnv.__doc__.split(f"layout ``{layout}``")[1]
    rows = re.findall(
        r"^ *\| (\d+) to (\d+) \| (\w+): (.*?) \| (\S+) \| (\S+) \|", text.split("with the layout")[0], re.MULTILINE
    )
    manifest, space = layout_of(layout), observation_space(layout_of(layout))
    assert f"Box({space.shape[0]},)" in text.split("|")[0]
    assert tuple(row[2] for row in rows) == manifest.observation
    for first, last, name, meaning, low, high in rows:
        assert meaning == FIELDS[name].meaning
        for index in (int(first), int(last)):
            assert space.low[index] == pytest.approx(float(low), abs=0.005)
            assert space.high[index] == pytest.approx(float(high), abs=0.005)
    assert int(rows[-1][1]) == space.shape[0] - 1


def test_every_layout_has_bounds_for_all_it_shows():
    for manifest in LAYOUTS.values():
        assert observation_space(manifest).shape == (manifest.observation_size,)
