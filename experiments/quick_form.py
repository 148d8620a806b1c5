"""The quick form of an experiment: all of its pieces, so small that they show only that it runs."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from experiments.agreement import training_of
from experiments.design import Experiment, Training

QUICK_PPO = {"robots": 64, "steps": 16, "minibatch": 512}
QUICK_SAMPLES = 2048


def quick_form(experiment: Experiment) -> Experiment:
    """The same with so little of everything that it shows only that it runs: one seed, few cells, samples and trials.

    A cell with the runs of another experiment trains its own here, since a quick form has a folder to itself.
    """
    wanted = [name for contrast in experiment.contrasts[:1] for name in (contrast.first, contrast.other)]
    cells = tuple(
        replace(cell, seeds=(1,), training=_quick_training(training_of(cell)), runs_of=None, runs_of_cell=None)
        for cell in experiment.cells
        if cell.name in wanted
    )
    trials, many, hidden = experiment.trials, experiment.many_goals, experiment.hidden
    farms = tuple(replace(farm, robots=2) for farm in trials.farms) if trials else ()
    return replace(
        experiment,
        quick=True,
        cells=cells,
        contrasts=experiment.contrasts[:1],
        trials=trials and replace(trials, blocks=1, block=2, farms=farms[-1:]),
        many_goals=many and replace(many, trials=2, goals=2, limit_s=6.0, physics_step_s=0.004),
        hidden=hidden
        and replace(hidden, robots=24, at_s=hidden.at_s[:1], cells=tuple(name for name in hidden.cells if name in wanted)),
    )


def _quick_training(training: Training | None) -> Training | None:
    if training is None:
        return None
    recipe = _quick_recipe(training.recipe)
    demonstrations = training.demonstrations
    if demonstrations is not None:
        recipe["demonstrations"] = {"clone_updates": 20, "batch": 256, "critic_first": 1}
        demonstrations = replace(demonstrations, count=2)
    start = training.start and replace(training.start, recipe=_quick_recipe(training.start.recipe))
    return replace(training, recipe=recipe, demonstrations=demonstrations, start=start)


def _quick_recipe(full: Mapping[str, Any]) -> dict[str, Any]:
    recipe = dict(full) | {
        "samples": QUICK_SAMPLES,
        "evaluation": {"every_samples": QUICK_SAMPLES, "trials": 2, "physics": ["nominal"], "final_trials": 1},
    }
    if "imitation" in recipe:
        return recipe | {"imitation": dict(recipe["imitation"]) | {"robots": 32, "updates": 2, "batch": 256, "least_memory": 512}}
    return recipe | {"ppo": dict(recipe["ppo"]) | QUICK_PPO}
