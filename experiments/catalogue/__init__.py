"""All experiments by name, in the order of their letters."""

from experiments.catalogue.farm_only import CONSECUTIVE, OBJECTS
from experiments.catalogue.learning import DEMONSTRATIONS, MEMORY, OBSERVATIONS
from experiments.catalogue.robots import ABLATION, RANDOMIZATION
from experiments.design import Experiment

CATALOGUE: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (OBSERVATIONS, RANDOMIZATION, DEMONSTRATIONS, MEMORY, ABLATION, CONSECUTIVE, OBJECTS)
}
HOURS_ALLOWED = 6.0
"""For all of them together on two cores."""
