"""A policy with memory in a real robot policy process and in the vectorised evaluation: kept in a trial, gone after it."""

import numpy as np
import onnxruntime
import pytest

from api_schemas.policy import LAYOUTS, OutputScaling
from api_schemas.policy_network import Cell, FrameStack
from robot_farm.policy.jail import JailedPolicy
from robot_farm.trial import log_channels, run_trial
from services.policies import graph
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.evaluation import evaluate
from sim_backend.reality_gap.success.policy_file import GraphPolicy
from sim_backend.tasks import TASKS
from tests.unit.conftest import lease

PUSH = LAYOUTS["rrc2022-push"]
OBSERVATIONS = np.random.default_rng(2).normal(size=(6, 54)).astype(np.float32)


def tensors(cells, gates, takes=54):
    rng = np.random.default_rng(7)
    shapes = {"weight_ih": (gates * cells, takes), "weight_hh": (gates * cells, cells)}
    shapes |= {"bias_ih": (gates * cells,), "bias_hh": (gates * cells,)}
    made = {f"recurrent.{name}_l0": rng.normal(scale=0.3, size=shape) for name, shape in shapes.items()}
    made |= {"layer0.weight": rng.normal(size=(9, cells)), "layer0.bias": np.zeros(9)}
    return {name: values.astype(np.float32) for name, values in made.items()}


def manifest(cell):
    return PUSH.model_copy(update={"recurrent": cell, "output_scaling": OutputScaling(clip=1.0, scale=0.3)})


@pytest.fixture(params=[(Cell.LSTM, 4), (Cell.GRU, 3)], ids=["lstm", "gru"])
def remembering(request, tmp_path):
    cell, gates = request.param
    asked = manifest(cell)
    path = tmp_path / "policy.onnx"
    path.write_bytes(graph.from_tensors(tensors(12, gates), asked).SerializeToString())
    return path, asked


def trial_of(policy):
    policy.reset()
    return np.stack([policy.act(row)[0] for row in OBSERVATIONS])


def test_memory_is_kept_within_a_trial_and_forgotten_between_trials(remembering):
    path, _ = remembering
    with JailedPolicy("remembers", path) as policy:
        first = trial_of(policy)
        second = trial_of(policy)
        policy.reset()
        fifth_alone = policy.act(OBSERVATIONS[5])[0]
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[5] - fifth_alone).max() > 0.01, "the fifth action depends on the four observations before it"


def test_trials_side_by_side_have_memories_of_their_own(remembering):
    path, _ = remembering
    with JailedPolicy("remembers", path) as policy:
        alone = trial_of(policy)
        policy.reset(3)
        later = np.stack([OBSERVATIONS[0], *OBSERVATIONS[:-1]])  # of a trial that looks twice at its first
        together = [policy.act_each(np.stack(rows)) for rows in zip(OBSERVATIONS, later, OBSERVATIONS, strict=True)]
        again = trial_of(policy)
    first, second, third = np.stack(together, axis=1)
    np.testing.assert_array_equal(first, alone)
    np.testing.assert_array_equal(third, alone)
    np.testing.assert_array_equal(again, alone)
    assert np.abs(second[1:] - alone[:-1]).max() > 1e-6, "its memory is that of one observation more"


def test_a_stack_begins_anew_with_each_trial(tmp_path):
    asked = PUSH.model_copy(update={"frame_stack": FrameStack(count=3), "output_scaling": OutputScaling(scale=0.1)})
    weights = {"layer0.weight": np.random.default_rng(0).normal(size=(9, 162)), "layer0.bias": np.zeros(9)}
    path = tmp_path / "policy.onnx"
    path.write_bytes(graph.from_tensors(weights, asked).SerializeToString())
    with JailedPolicy("stacks", path) as policy:
        first, second = trial_of(policy), trial_of(policy)
    np.testing.assert_array_equal(first, second)
    rows = np.concatenate([OBSERVATIONS[:1], OBSERVATIONS[:1], OBSERVATIONS])
    wanted = np.concatenate([rows[i : i + 6] for i in range(3)], axis=1) @ weights["layer0.weight"].T * 0.1
    np.testing.assert_allclose(first, wanted, atol=1e-5)


def test_a_trial_and_the_evaluation_of_many_agree(remembering, tmp_path):
    """The robot's process keeps one memory; the evaluation one for each simulation. Both see the same physics."""
    path, asked = remembering
    task = TASKS["reach"]
    policy = GraphPolicy(onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]))
    seeds = [11, 12]
    many = evaluate(policy, asked, task, seeds, threads=1)
    again = evaluate(policy, asked, task, seeds, threads=1)
    np.testing.assert_array_equal(many.position_error_m, again.position_error_m)
    with JailedPolicy("remembers", path) as process:
        for index, seed in enumerate(seeds):
            given = lease(task="reach", seed=seed).model_copy(update={"manifest": asked})
            log = tmp_path / f"{seed}.mcap"
            outcome = run_trial(given, process, SimulatedDriver(), log_channels(), log, stop_reason=lambda: None)
            assert outcome.measures is not None, outcome.reason
            assert outcome.measures.final_position_error_m == many.position_error_m[index]
