"""Recipes: every shipped one holds, and what does not hold is told where."""

import subprocess
import sys

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")

from sim_backend.training.randomization import ranges_to_train_on
from sim_backend.training.recipe import RecipeError, load_recipe, shipped_recipes
from tests import ROOT

LEAST = 'task = "reach"\nlayout = "reach"\nsamples = 16384\n'


@pytest.mark.parametrize("name", shipped_recipes())
def test_shipped_recipes_hold(name):
    found, recipe = load_recipe(name)
    assert found == name
    assert recipe.about


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('task = "juggle"', "unknown task 'juggle'; choose from push"),
        ('layout = "smell"', "unknown layout 'smell'; choose from"),
        ("robots = 4", "robots: Extra inputs are not permitted"),
        ("[ppo]\nminibatch = 1000", "minibatch is 1000; it must divide robots times steps, 16384"),
        ("nominal_share = 0.5\n[randomization]\nmethod = 'adr'", "ADR begins with nominal robots by itself"),
        ("[warm_start]\npolicy = 'push'\n[networks]\nmemory = 8", "goes with PPO without a memory only"),
        ("[warm_start]\npolicy = 'push'\nrun = 'runs/push'", "a policy or the folder of a run"),
        ("[warm_start]\nrun = 'runs/push'\ncritic_first = 3", "has no meaning"),
        ("samples = 0", "samples: Input should be greater than or equal to 1"),
    ],
)
def test_what_does_not_hold_is_told_where(tmp_path, line, sentence):
    path = tmp_path / "mine.toml"
    key = line.split(" =")[0]
    path.write_text("".join(old + "\n" for old in LEAST.splitlines() if not old.startswith(key + " =")) + line + "\n")
    with pytest.raises(RecipeError, match="mine") as caught:
        load_recipe(str(path))
    assert sentence in str(caught.value)


def test_a_missing_recipe_is_told_what_there_is():
    with pytest.raises(RecipeError, match=r"no recipe 'pull'; choose from .*push.*or name a TOML file"):
        load_recipe("pull")


def test_ranges_lie_beside_the_recipe_that_names_them(tmp_path):
    (tmp_path / "mine.toml").write_text('physics = "robots.toml"\n' + LEAST)
    (tmp_path / "robots.toml").write_text("")
    _, recipe = load_recipe(str(tmp_path / "mine.toml"))
    assert recipe.physics_source == str(tmp_path / "robots.toml")
    assert recipe.model_dump()["physics"] == "robots.toml", "a record names no folder of its machine"
    _, shipped = load_recipe("push-randomized")
    assert ranges_to_train_on(shipped.physics_source).name == "contacts"


def test_what_cannot_be_trained_is_refused_before_torch_is_loaded(tmp_path):
    (tmp_path / "checkpoint.pt").touch()
    asked = [["no-such-recipe"], ["push", "--out", str(tmp_path)]]
    program = "import sys; from sim_backend.training.__main__ import main\n"
    program += f"print([main(asked) for asked in {asked}], 'torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[2, 2] False", done.stdout + done.stderr
