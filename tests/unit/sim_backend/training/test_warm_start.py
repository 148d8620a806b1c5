"""PPO that begins with a policy that is there already."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.training.demonstrations.recipe import ImitationRecipe  # noqa: E402
from sim_backend.training.demonstrations.run import ImitationRun  # noqa: E402
from sim_backend.training.export import ExportedPolicy, read_policy, write_policy  # noqa: E402
from sim_backend.training.recipe import Recipe  # noqa: E402
from sim_backend.training.train import Run  # noqa: E402
from tests.disk_steps import in_place, noted_steps  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # torch's own
BATCH = 200


def run_in(folder: Path, iterations: int = 2, **changes) -> Run:
    settings = {
        "task": "push",
        "layout": "push",
        "episode_s": 0.4,
        "samples": BATCH * iterations,
        "networks": {"actor": (16, 12), "critic": (16,), "privileged": True},
        "ppo": {"robots": 25, "steps": 8, "epochs": 2, "minibatch": 100, "learning_rate": 0.01},
        "evaluation": {"every_samples": 10_000, "trials": 2, "final_trials": 0},
    }
    return Run("mine", Recipe.model_validate(settings | changes), folder, threads=1, tell=lambda _: None)


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("first")
    run = run_in(folder)
    run.learn()
    return write_policy(run.exported(), folder, "first")


def apart(first: ExportedPolicy, second: ExportedPolicy) -> float:
    """Largest difference of their torques (N m) on observations that both may see."""
    tensors = first.tensors
    spread = np.sqrt(tensors["running_var"])
    seen = tensors["running_mean"] + spread * np.random.default_rng(0).normal(size=(50, len(spread)))
    return float(np.abs(first(seen) - second(seen)).max())


def test_it_begins_as_that_policy_and_the_critic_learns_alone_at_first(tmp_path, trained):
    warm, before = {"policy": str(trained), "critic_first": 2}, read_policy(trained)
    run = run_in(tmp_path, iterations=2, warm_start=warm)
    critic = run.policy.value_net.weight.clone()
    assert apart(run.exported(), before) < 1e-5
    run.learn()
    assert apart(run.exported(), before) < 1e-5, "only the critic may have learned"
    assert (run.policy.value_net.weight != critic).any()
    run = run_in(tmp_path, iterations=3, warm_start=warm)
    run.learn()
    assert apart(run.exported(), before) > 1e-4


def test_the_critic_has_a_learning_rate_of_its_own_while_it_is_alone(tmp_path, trained):
    warm = {"policy": str(trained), "critic_first": 2, "critic_learning_rate": 0.5}
    run, rates = run_in(tmp_path, iterations=4, warm_start=warm), []
    optimizer = run.policy.optimizer
    optimizer.register_step_pre_hook(lambda *_: rates.append(optimizer.param_groups[0]["lr"]))
    run.learn()
    assert rates == [0.5] * 8 + [0.01] * 8  # four updates in each iteration


def test_a_run_goes_on_from_another_with_its_critic_under_another_recipe(tmp_path):
    first = run_in(tmp_path / "first")
    (tmp_path / "first").mkdir()
    first.learn()
    first.keep()
    second = run_in(tmp_path / "second", warm_start={"run": str(tmp_path / "first")}, physics="real", seed=7)
    for name, values in first.policy.state_dict().items():
        assert torch.equal(second.policy.state_dict()[name], values), name
    assert second.returns.variance == first.returns.variance != 1.0
    assert second.model.policy.optimizer.state_dict()["state"], "what Adam knows is taken over, too"
    mean = second.policy.features_extractor.mean.clone()
    second.learn()
    assert apart(second.exported(), first.exported()) > 1e-4
    assert torch.equal(second.policy.features_extractor.mean, mean), "the scaling of the inputs stays"
    assert (second.samples, second.iterations) == (2 * BATCH, 2), "it counts from its own begin"


def test_a_checkpoint_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    run, steps = run_in(tmp_path), noted_steps(monkeypatch)
    run.keep()
    assert steps == in_place("checkpoint.pt.new", tmp_path / "checkpoint.pt")


def test_a_run_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no .*checkpoint.pt to begin with"):
        run_in(tmp_path, warm_start={"run": str(tmp_path)})
    run_in(tmp_path).keep()
    with pytest.raises(ValueError, match="another layout"):
        run_in(tmp_path, warm_start={"run": str(tmp_path)}, layout="move")


def test_an_imitating_student_begins_as_that_policy(tmp_path, trained):
    settings = {"method": "dagger", "task": "push", "layout": "push", "samples": 100, "teacher": {"policy": "push-scratch"}}
    found = ImitationRecipe.model_validate(settings | {"student": {"hidden": (16, 12)}, "warm_start": {"policy": str(trained)}})
    run = ImitationRun("mine", found, tmp_path, threads=1, tell=lambda _: None)
    assert apart(run.exported(), read_policy(trained)) < 1e-5
    with pytest.raises(ValueError, match="has no cells"):
        ImitationRecipe.model_validate(settings | {"student": {"cell": "gru"}, "warm_start": {"policy": str(trained)}})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"networks": {"actor": (16, 16), "critic": (16,)}}, r"hidden layers of \[16, 12\] and the recipe of \[16, 16\]"),
        ({"layout": "move"}, "cannot be begun with by this recipe: it sees "),
        ({"action": "joint position"}, "gives torque at 50 Hz, the recipe joint_position"),
    ],
)
def test_a_policy_that_does_not_fit_is_refused(tmp_path, trained, changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        run_in(tmp_path, warm_start={"policy": str(trained)}, **changes)
