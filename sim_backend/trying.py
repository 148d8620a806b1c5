"""A policy tried in 20 short trials in a small nominal simulation: ``python -m sim_backend.trying GRAPH MANIFEST --task TASK``.

Not a measure of how good it is: a policy that sees another layout than it was trained on is noticed, by what it makes of the goal
and by how far its observations lie from what its own normaliser expects. Prints one JSON document.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx

from api_schemas import policy_graph
from api_schemas.observation import number_name
from api_schemas.policy import PolicyManifest
from api_schemas.policy_graph import OBSERVATION, GraphRunner
from sim_backend.driver.simulated import PhysicsDivergedError
from sim_backend.evaluation import begin_trials
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Task

TRIALS = 20
TRIAL_S = 6.0
STEP_S = 0.002
FIRST_SEED = 25_000
NEARER_M = 0.01
"""The cube, or the tips of ``reach``, came nearer to the goal if they end by so much nearer than they began."""
FEWEST_NEARER = 0.4
"""A policy of which fewer of the trials end nearer is said not to do the task."""
OUTSIDE = 4.9
"""What enters a trained network is seldom so many deviations from what it saw in its training; clips are mostly at 5 or 10."""
MOST_OUTSIDE = 0.5
"""A number is outside its range if it is so in more of the steps, in more than this share of the trials."""
NAMED = 6


@dataclass(frozen=True)
class Trials:
    """What was found in n trials.

    ``began_m`` and ``ended_m`` (n,) are the distances from the goal; ``observations`` (steps, n, size) is what the policy saw;
    ``diverged`` says that the simulation became unstable.
    """

    began_m: np.ndarray
    ended_m: np.ndarray
    observations: np.ndarray
    diverged: bool


def run(graph: bytes, manifest: PolicyManifest, task: Task, first_seed: int = FIRST_SEED) -> Trials:
    """Try the goals of 20 seeds, each for a few seconds."""
    seeds = list(range(first_seed, first_seed + TRIALS))
    episode, goal = begin_trials(manifest, task, seeds, threads=1, physics_step_s=STEP_S)
    session = policy_graph.session(graph)
    policies = [GraphRunner(session) for _ in seeds]

    def away_m() -> np.ndarray:
        state = episode.measurement
        found = score(task, goal, state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
        return found.position_error_m

    began_m, seen, diverged = away_m(), [], False
    try:
        for _ in range(round(min(TRIAL_S, task.duration_s) * manifest.rate_hz)):
            observation = episode.observe().astype(np.float32)
            seen.append(observation)
            episode.advance(np.concatenate([policy.act(row[None]) for policy, row in zip(policies, observation, strict=True)]))
    except PhysicsDivergedError:
        diverged = True
    return Trials(began_m, away_m(), np.stack(seen), diverged)


def warnings_of(found: Trials, outside: Sequence[int], manifest: PolicyManifest, task: str) -> list[str]:
    """What a user should know of the trials, as sentences."""
    said = []
    what = "tip" if not TASKS[task].moves_cube else "cube"
    nearer = int((found.ended_m < found.began_m - NEARER_M).sum())
    if found.diverged:
        said.append(
            f"in a small nominal simulation of {task} the policy makes the physics unstable: check what an action of 1 is"
        )
    elif nearer < FEWEST_NEARER * len(found.began_m):
        said.append(
            f"in {len(found.began_m)} trials of {task} in a small nominal simulation the {what} ends nearer to the goal in "
            f"only {nearer}: if it did this task in its training, the order of its observation, --scale or --task is another"
        )
    if outside:
        names = ", ".join(number_name(manifest.observation, index) for index in outside[:NAMED])
        more = f" and {len(outside) - NAMED} more" if len(outside) > NAMED else ""
        said.append(
            f"observations leave the range of the policy's own normaliser in {len(outside)} of {manifest.observation_size} "
            f"numbers ({names}{more}): is this the layout that it was trained on?"
        )
    return said


def outside_range(graph: bytes, manifest: PolicyManifest, observations: np.ndarray) -> list[int]:
    """Numbers of the observation that lie beyond the normaliser most of the time, by what enters the first matrix of the network.

    Args:
        graph: the policy as robots run it.
        manifest: the policy's.
        observations: shape (steps, n, size).

    Returns:
        Their indices; none for a network that takes observations as they are, or whose graph has another form.
    """
    inner = _before_first_matrix(graph)
    if inner is None or manifest.frame_stack is not None:
        return []
    session, name = inner
    steps = observations[:: max(1, len(observations) // 25)]
    given = _Feed(session, name)
    entered = np.stack([[given(row) for row in trials] for trials in steps])
    base, seen = entered[0, 0], steps[0, 0]
    far = ((np.abs(entered) >= OUTSIDE).mean(axis=0) > MOST_OUTSIDE).mean(axis=0) > MOST_OUTSIDE
    if not far.any() or np.array_equal(base, seen):
        return []
    return sorted({index for index in range(seen.size) if far[_columns_of(given, seen, index)].any()})


def _columns_of(given: "_Feed", seen: np.ndarray, index: int) -> np.ndarray:
    """Which numbers that enter the network follow from one number of the observation, found by shifting it."""
    moved = seen.copy()
    moved[index] += 1e-2
    return np.flatnonzero(given(moved) != given(seen))


class _Feed:
    """The numbers that enter the first matrix of a network, before they are clipped."""

    def __init__(self, session: policy_graph.Session, name: str) -> None:
        self._session, self._name = session, name
        inputs = session.get_inputs()
        self._others = {each.name: np.zeros(each.shape, np.float32) for each in inputs if each.name != OBSERVATION}

    def __call__(self, row: np.ndarray) -> np.ndarray:
        """For one observation (size,)."""
        return np.asarray(self._session.run([self._name], {OBSERVATION: row[None], **self._others})[0]).ravel()


def _before_first_matrix(graph: bytes) -> tuple[policy_graph.Session, str] | None:
    """A session that gives what enters the first matrix of a graph, and its name; None where nothing stands before it."""
    model = onnx.load_model_from_string(graph)
    constants = {each.name for each in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type in ("Gemm", "MatMul") and "whitening" not in node.input:
            name = next((each for each in node.input if each not in constants), "")
            name = _before_clips(model, name)
            if name in ("", OBSERVATION):
                return None
            model.graph.output.append(onnx.helper.make_empty_tensor_value_info(name))
            return policy_graph.session(model.SerializeToString()), name
        if node.op_type in ("LSTM", "GRU", "Conv"):
            return None
    return None


def _before_clips(model: onnx.ModelProto, name: str) -> str:
    """What was clipped to give the value of a name; the name itself if it is no clip's."""
    makers = {output: node for node in model.graph.node for output in node.output}
    while name in makers and makers[name].op_type in ("Min", "Max", "Clip"):
        name = makers[name].input[0]
    return name


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what was found."""
    parser = argparse.ArgumentParser(prog="python -m sim_backend.trying", description=__doc__)
    parser.add_argument("graph", type=Path)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--task", choices=list(TASKS), required=True)
    asked = parser.parse_args(arguments)
    manifest, graph = PolicyManifest.model_validate_json(asked.manifest.read_text()), asked.graph.read_bytes()
    found = run(graph, manifest, TASKS[asked.task])
    outside = outside_range(graph, manifest, found.observations)
    nearer = (found.began_m - found.ended_m).tolist()
    document = {"warnings": warnings_of(found, outside, manifest, asked.task), "nearer_m": nearer, "outside": outside}
    sys.stdout.write(json.dumps(document) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
