"""From a recipe to the farm's report: a small policy is trained for real, submitted, and better than one that was not."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.training.export import write_policy
from sim_backend.training.recipe import RECIPES, Recipe, load_recipe
from sim_backend.training.train import Run
from tests.end_to_end import commands
from tests.end_to_end.farm import TRIFARM, Farm

TRIALS = 16


@pytest.fixture
def farm_of_two(tmp_path):
    """Takes jobs of both policies on the same goals."""
    with Farm(tmp_path / "farm", robots=2) as farm:
        yield farm


def trained(recipe: str, folder: Path) -> list[Path]:
    """The policy of a recipe that was run by the command, and of one that was not."""
    _, settings = load_recipe(recipe)
    assert isinstance(settings, Recipe)
    untrained = write_policy(Run("untrained", settings, folder, threads=1).exported(), folder, "untrained")
    command = [*TRIFARM, "train", recipe, "--out", str(folder / "run"), "--threads", "1"]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
    policy = folder / "run" / "reach.safetensors"
    checked = commands.run("check", str(policy), env=os.environ)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    return [policy, untrained]


def judged(farm: Farm, policies: list[Path]) -> list[dict]:
    """Their reports; none was at fault."""
    reports = [farm.report(job) for job in [farm.submit(policy, task="reach", trials=TRIALS, seed=17) for policy in policies]]
    assert [report["policy_faults"] for report in reports] == [0, 0]
    return reports


@pytest.mark.timeout(900)  # training is computing alone
@pytest.mark.filterwarnings("default")  # torch's own
def test_an_eighth_of_a_recipe_s_samples_brings_fingertips_closer_than_none(tmp_path, farm_of_two):
    whole = (RECIPES / "reach.toml").read_text()
    short = tmp_path / "reach.toml"
    for found, less in (("131_072", "16_384"), ("trials = 32", "trials = 4"), ("final_trials = 20", "final_trials = 1")):
        assert found in whole
        whole = whole.replace(found, less)
    short.write_text(whole)
    learned, first = judged(farm_of_two, trained(str(short), tmp_path))
    errors_m = [[row["outcome"]["measures"]["final_position_error_m"] for row in each["per_trial"]] for each in (learned, first)]
    assert binomtest(int(np.less(errors_m[0], errors_m[1]).sum()), TRIALS).pvalue < 1e-3, errors_m


@pytest.mark.scale
@pytest.mark.timeout(900)
@pytest.mark.filterwarnings("default")
def test_a_policy_trained_by_a_recipe_succeeds_more_often_than_an_untrained_one(tmp_path, farm_of_two):
    """`test_an_eighth_of_a_recipe_s_samples_brings_fingertips_closer_than_none` trains for an eighth of it."""
    learned, first = judged(farm_of_two, trained("reach", tmp_path))
    assert learned["interval_80"][0] > first["interval_80"][1], (learned["success_rate"], first["success_rate"])
