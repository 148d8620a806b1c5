"""All experiments by name, in the order of their letters; those that are asked again at the end."""

from experiments.catalogue.farm_only import CONSECUTIVE, OBJECTS
from experiments.catalogue.learning import DEMONSTRATIONS, MEMORY, OBSERVATIONS
from experiments.catalogue.robots import ABLATION, RANDOMIZATION
from experiments.catalogue.with_power import ABLATION_AGAIN, DEMONSTRATIONS_AGAIN, OBJECTS_AGAIN, OBSERVATIONS_AGAIN
from experiments.design import Experiment

CATALOGUE: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        *(OBSERVATIONS, RANDOMIZATION, DEMONSTRATIONS, MEMORY, ABLATION, CONSECUTIVE, OBJECTS),
        *(OBSERVATIONS_AGAIN, DEMONSTRATIONS_AGAIN, ABLATION_AGAIN, OBJECTS_AGAIN),
    )
}
HOURS_ALLOWED = 6.0
"""For the first of all together on two cores."""
HOURS_AGAIN = 12.0
"""For all that are asked again."""
