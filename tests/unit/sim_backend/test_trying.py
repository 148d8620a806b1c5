"""Short trials notice what a policy makes of another layout: its normaliser's range, and a cube that does not come nearer."""

import numpy as np
import pytest
import safetensors.numpy

from api_schemas.policy import InputScaling, OutputScaling, PolicyManifest
from services.policies import graph
from sim_backend.tasks import TASKS
from sim_backend.trying import Trials, outside_range, run, warnings_of

SEEN = ("joint_position_rad", "goal_position_world_m")
MANIFEST = PolicyManifest(
    observation=SEEN, input_scaling=InputScaling(clip=5.0), output_scaling=OutputScaling(clip=1.0, scale=0.1)
)


def network(mean):
    """A graph that normalises by a mean and a deviation of 0.1."""
    rng = np.random.default_rng(0)
    tensors = {"layer0.weight": rng.normal(size=(9, 12)), "layer0.bias": np.zeros(9), "running_mean": mean}
    tensors |= {"running_var": np.full(12, 0.01)}
    as_float32 = {name: values.astype(np.float32) for name, values in tensors.items()}
    return graph.from_tensors(safetensors.numpy.load(safetensors.numpy.save(as_float32)), MANIFEST).SerializeToString()


def test_numbers_beyond_the_normaliser_are_named():
    observations = np.random.default_rng(1).normal(scale=0.05, size=(30, 4, 12)).astype(np.float32)
    mean = np.zeros(12)
    assert outside_range(network(mean), MANIFEST, observations) == []
    mean[[2, 10]] = 3.0
    outside = outside_range(network(mean), MANIFEST, observations)
    assert outside == [2, 10]
    still = Trials(np.full(20, 0.1), np.full(20, 0.1), observations, diverged=False)
    said = warnings_of(still, outside, MANIFEST, "push")
    assert "the cube ends nearer to the goal in only 0" in said[0]
    assert "2 of 12 numbers (joint_position_rad[2], goal_position_world_m[1])" in said[1]


@pytest.mark.parametrize(("ended_m", "warned"), [(0.05, False), (0.095, True)])
def test_a_cube_that_comes_nearer_is_no_news(ended_m, warned):
    found = Trials(np.full(20, 0.1), np.full(20, ended_m), np.zeros((1, 20, 12)), diverged=False)
    assert bool(warnings_of(found, [], MANIFEST, "push")) == warned


def test_a_network_of_observations_as_they_are_has_no_range():
    bare = MANIFEST.model_copy(update={"input_scaling": InputScaling()})
    tensors = {"layer0.weight": np.ones((9, 12), np.float32), "layer0.bias": np.zeros(9, np.float32)}
    assert outside_range(graph.from_tensors(tensors, bare).SerializeToString(), bare, np.full((2, 2, 12), 9.0, np.float32)) == []


def test_trials_are_run():
    found = run(network(np.zeros(12)), MANIFEST, TASKS["reach"])
    assert found.began_m.shape == found.ended_m.shape == (20,)
    assert found.observations.shape == (250, 20, 12)
