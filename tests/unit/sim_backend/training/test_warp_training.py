"""A tiny policy learns to reach with its robots on mujoco_warp, and is tried in MuJoCo."""

import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.driver.warp_batch import WarpBatch  # noqa: E402
from sim_backend.training.__main__ import main  # noqa: E402
from sim_backend.training.recipe import Recipe  # noqa: E402
from sim_backend.training.train import Run  # noqa: E402
from tests.unit.sim_backend.driver.backends import needs_warp  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # torch's own
REACH = {
    "task": "reach",
    "layout": "reach",
    "action": "joint position",
    "episode_s": 0.5,
    "samples": 24_576,
    "reward": {"joint_speed": 0.0},
    "networks": {"actor": (32,), "critic": (32,)},
    "ppo": {"robots": 64, "steps": 16, "epochs": 8, "minibatch": 256, "learning_rate": 3e-3, "discount": 0.8},
    "evaluation": {"every_samples": 10**6, "trials": 2, "physics": ("nominal",), "final_trials": 0},
}


@needs_warp
def test_a_policy_learns_on_warp_what_it_then_does_in_mujoco(tmp_path):
    run = Run("reach", Recipe.model_validate(REACH | {"physics_backend": "warp-cpu"}), tmp_path, threads=1, tell=lambda _: None)
    assert isinstance(run.robots.environment._driver._batch, WarpBatch)
    before = _rewards(run)
    run.learn()
    after = _rewards(run)
    assert after > before + 0.05, (before, after)


def _rewards(run: Run) -> float:
    """Mean reward of the policy as it is, in MuJoCo."""
    from sim_backend.environments.vec_env import TrifingerVecEnv

    robots = TrifingerVecEnv(run.robots.environment.practice, robots=32, threads=1, seed=7)
    seen, total = robots.reset(), 0.0
    for _ in range(24):
        robots.step_async(run.policy.predict(seen, deterministic=True)[0])
        seen, reward, _, _ = robots.step_wait()
        total += float(reward.mean())
    return total / 24


@needs_warp
def test_the_command_says_that_there_is_no_gpu(tmp_path, capsys):
    import warp

    if warp.is_cuda_available():
        pytest.skip("there is a GPU")
    (tmp_path / "mine.toml").write_text('task = "reach"\nlayout = "reach"\nsamples = 1\nphysics_backend = "warp"\n')
    assert main([str(tmp_path / "mine.toml"), "--out", str(tmp_path / "run")]) == 2
    assert "recipe mine: the physics back end 'warp' needs an NVIDIA GPU" in capsys.readouterr().err
