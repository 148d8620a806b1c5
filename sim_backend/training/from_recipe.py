"""What a recipe describes, built: what the robots practise, and the arguments of the networks that learn it."""

from typing import Any

import numpy as np

from sim_backend.environments.action_space import ActionSpace
from sim_backend.environments.practice import Practice
from sim_backend.tasks import TASKS
from sim_backend.tasks.reward import Reward
from sim_backend.training.actor_critic import Inputs
from sim_backend.training.randomization import Randomizer
from sim_backend.training.recipe import Recipe


def practice_of_recipe(recipe: Recipe, randomizer: Randomizer) -> Practice:
    """What the recipe lets robots practise."""
    acts = ActionSpace(recipe.action, recipe.action_scale)
    task = recipe.curriculum[0].task if recipe.curriculum else recipe.task
    return Practice(
        TASKS[task],
        acts.manifest(recipe.manifest),
        acts,
        Reward(**recipe.reward.model_dump()),
        randomizer.draw,
        recipe.episode_s,
        recipe.physics_step_s,
    )


def network_arguments(recipe: Recipe) -> dict[str, Any]:
    """Of ``ActorCritic`` or ``RecurrentActorCritic``, spaces and learning rate apart."""
    networks = recipe.networks
    return {
        "actor": networks.actor,
        "critic": networks.critic,
        **({} if networks.memory is None else {"memory": networks.memory}),
        "features_extractor_class": Inputs,
        "features_extractor_kwargs": {"manifest": recipe.manifest},
        "log_std_init": float(np.log(recipe.ppo.first_deviation)),
    }
