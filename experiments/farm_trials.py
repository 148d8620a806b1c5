"""Farm trials through the API, on a farm that is started for them: blocks of all cells take turns on the same robots."""

import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Protocol

from api_schemas.builtin_policies import builtin_digest
from api_schemas.job import JobRequest, TaskName
from api_schemas.physics import ObjectName
from api_schemas.report import Report
from api_schemas.trial import OutcomeKind
from client_cli.connection.api_client import ApiClient
from client_cli.embedded.farm import FarmOptions, embedded_farm
from client_cli.embedded.robot_options import RobotOptions, usable_physics
from experiments.design import BUILTIN, Cell, Farm, FarmTrials
from experiments.plan import BlockPiece
from experiments.result_files import TRIALS, Key
from experiments.store import Store
from experiments.trainer import manifest_beside
from sim_backend.training import reference_policies
from trifarm.farm import Farm as FarmConnection
from trifarm.farm import FarmJob


class WeightsMissingError(Exception):
    """A policy that is to be tried is on another machine; the message says which."""


class OpenFarm(Protocol):
    """A farm that takes jobs."""

    def submit(self, cell: Cell, weights: Path | None, task: str, trials: int, seed: int) -> FarmJob:
        """Queue a job of a cell's policy."""
        ...


def weights_of(cell: Cell, seed: int, store: Store) -> Path | None:
    """The file of a cell's policy; None for one that needs none.

    Raises:
        WeightsMissingError: it was too large to be committed, and was not trained here.
    """
    if cell.is_builtin:
        return None
    if cell.policy is not None:
        return reference_policies.folder() / f"{cell.policy}.safetensors"
    if (found := store.weights(cell, seed)) is None:
        raise WeightsMissingError(
            f"the weights of {cell.name}, seed {seed}, are not here: its run is finished, but they were too large to be kept "
            f"with the results; go on where {store.training_folder(cell, seed)} is, or remove its result to train it again"
        )
    return found


def run_blocks(
    pieces: Sequence[BlockPiece],
    trials: FarmTrials,
    store: Store,
    *,
    open_farm: Callable[[Farm], AbstractContextManager[OpenFarm]],
    made_by: Callable[[str], Mapping[str, str]],
    goes_on: Callable[[], bool],
    tell: Callable[[str], None],
) -> bool:
    """Run what is missing, farm by farm, and keep each job's rows as soon as it has its report; whether all ran.

    ``made_by`` says what trials on robots of a physics are made by now.
    """
    for farm, of_farm in groupby(pieces, key=lambda piece: piece.farm):
        if not goes_on():
            return False
        wanted = list(of_farm)
        for piece in wanted:
            store.trials(Key(piece.cell.name, piece.seed, farm.physics))  # complains before a farm is started
        store.versions.of(TRIALS, now := made_by(farm.physics))
        with open_farm(farm) as opened:
            for block, of_block in groupby(wanted, key=lambda piece: piece.block):
                if not goes_on():
                    return False
                _run_block(list(of_block), trials, store, opened, now)
                tell(f"{farm.physics} farm: block {block + 1} of {trials.blocks} is done")
    return True


def _run_block(
    pieces: Sequence[BlockPiece], trials: FarmTrials, store: Store, farm: OpenFarm, made_by: Mapping[str, str]
) -> None:
    files = [weights_of(piece.cell, piece.seed, store) for piece in pieces]
    jobs = []
    for piece, weights in zip(pieces, files, strict=True):
        task = piece.cell.task or trials.task
        jobs.append(farm.submit(piece.cell, weights, task, trials.block, trials.seed + piece.block))
    for piece, job in zip(pieces, jobs, strict=True):
        report = job.wait()
        about = {
            "task": report.task,
            "object": report.object,
            "object_scale": report.object_scale,
            "first_job_seed": trials.seed,
            "policy_digest": report.policy,
            "farm": {"physics": piece.farm.physics, "seed": piece.farm.seed, "robots": piece.farm.robots},
        }
        store.keep_block(Key(piece.cell.name, piece.seed, piece.farm.physics), piece.block, rows_of(report), about, made_by)


def rows_of(report: Report) -> list[dict[str, Any]]:
    """What is kept of a job: of each goal the robot and whether it was reached."""
    return [
        {"goal": row.seed, "robot": row.robot, "reached": row.outcome.kind is OutcomeKind.SUCCEEDED} for row in report.per_trial
    ]


def by_goal(kept: Mapping[str, Any]) -> dict[int, bool]:
    """Whether each goal was reached, by its seed, over all blocks that are there."""
    return {row["goal"]: row["reached"] for rows in kept["blocks"].values() for row in rows}


def robot_by_goal(kept: Mapping[str, Any]) -> dict[int, str]:
    """Which robot tried each goal, by its seed, over all blocks that are there."""
    return {row["goal"]: row["robot"] for rows in kept["blocks"].values() for row in rows}


@contextmanager
def own_farm(farm: Farm, folder: Path) -> Iterator["OwnFarm"]:
    """A farm of our own in a folder, which should be this user's alone; ended and forgotten afterwards."""
    robots = RobotOptions(farm.robots, usable_physics(farm.physics), farm.seed)
    with (
        embedded_farm(FarmOptions(data=folder, home=folder / "home", port=0, robots=robots)) as running,
        FarmConnection(running.connection.url, running.connection.token) as connection,
        ApiClient(running.connection) as client,
    ):
        yield OwnFarm(connection, client)


@dataclass(frozen=True)
class OwnFarm:
    """The two ways to it: as a program's, and for what only operators may ask for."""

    connection: FarmConnection
    client: ApiClient

    def submit(self, cell: Cell, weights: Path | None, task: str, trials: int, seed: int) -> FarmJob:
        """Queue a job of a cell's policy."""
        of_object = {"object": ObjectName(cell.object), "object_scale": cell.object_scale}
        if weights is not None:
            manifest = manifest_beside(weights)
            return self.connection.submit(weights, task=task, trials=trials, seed=seed, manifest=manifest, **of_object)
        digest = builtin_digest(str(cell.policy).removeprefix(BUILTIN))
        wish = JobRequest(policy=digest, task=TaskName(task), trials=trials, seed=seed, **of_object)
        return FarmJob(self.client, self.client.create_job(wish, uuid.uuid4().hex))
