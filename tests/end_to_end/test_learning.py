"""From a recipe to the farm's report: a small policy is trained for real, submitted, and better than one that was not."""

import os
import subprocess

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.training.export import write_policy
from sim_backend.training.recipe import Recipe, load_recipe
from sim_backend.training.train import Run
from tests.end_to_end import commands
from tests.end_to_end.farm import TRIFARM, Farm

TRIALS = 16


@pytest.mark.timeout(900)  # training is computing alone
@pytest.mark.filterwarnings("default")  # torch's own
def test_a_policy_trained_by_a_recipe_does_better_on_the_farm_than_an_untrained_one(tmp_path):
    _, recipe = load_recipe("reach")
    assert isinstance(recipe, Recipe)
    untrained = write_policy(Run("untrained", recipe, tmp_path, threads=1).exported(), tmp_path, "untrained")
    command = [*TRIFARM, "train", "reach", "--out", str(tmp_path / "run"), "--threads", "1"]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
    trained = tmp_path / "run" / "reach.safetensors"
    checked = commands.run("check", str(trained), env=os.environ)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    with Farm(tmp_path / "farm", robots=2) as farm:
        jobs = [farm.submit(file, task="reach", trials=TRIALS, seed=17) for file in (trained, untrained)]
        learned, first = (farm.report(job) for job in jobs)
    assert learned["policy_faults"] == first["policy_faults"] == 0
    assert learned["interval_80"][0] > first["interval_80"][1], (learned["success_rate"], first["success_rate"])
