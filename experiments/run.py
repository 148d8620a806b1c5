"""One experiment from what is missing to its page; what is done is never done again.

Torch and matplotlib are loaded by those who compute with them or draw: to list, train and submit nothing of them is needed.
"""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from api_schemas.builtin_policies import builtin_manifest
from experiments import catalogue
from experiments.agreement import asked_of_measurements
from experiments.consecutive import task_of, try_many_goals
from experiments.design import Cell, Experiment, Farm
from experiments.farm_trials import own_farm, run_blocks, weights_of
from experiments.findings import Findings, findings
from experiments.hidden_state import ask
from experiments.kept_versions import SET_ASIDE
from experiments.page import experiment_page, overview
from experiments.plan import (
    BlockPiece,
    MeasuringPiece,
    Piece,
    TrainingPiece,
    Wanted,
    hours,
    missing,
    pieces,
    spoken,
    starts,
    surveyed,
)
from experiments.provenance import made_by
from experiments.result_files import MEASURED, TRIALS, Key
from experiments.store import Store
from experiments.trainer import OTHER_FOLDERS, manifest_of, train_all
from sim_backend.folder_lock import taken
from sim_backend.grasping.controller import GraspPolicy

if TYPE_CHECKING:
    from sim_backend.training.export import ExportedPolicy

FORMAT = "trifarm-experiment/1"


@dataclass(frozen=True)
class Settings:
    """How a sitting goes: what is wanted, how many trainings side by side, and when nothing more is begun."""

    wanted: Wanted
    jobs: int
    goes_on: Callable[[], bool]
    tell: Callable[[str], None]


def run(experiment: Experiment, store: Store, settings: Settings) -> Findings:
    """Do what is missing, in order: trainings, farm trials, measurements; then judge."""
    tell = settings.tell
    for line in announcement(experiment, store, settings):
        tell(line)
    with taken(store.work_folder, f"experiment {experiment.name}", OTHER_FOLDERS):
        shutil.rmtree(store.farm_folder, ignore_errors=True)  # of a sitting that was killed
        _do_what_is_missing(experiment, store, settings)
    return findings(experiment, store)


def _do_what_is_missing(experiment: Experiment, store: Store, settings: Settings) -> None:
    tell = settings.tell
    left = missing(experiment, store, settings.wanted, made_by)
    trainings = [piece for piece in left if isinstance(piece, TrainingPiece)]
    if train_all(trainings, store, jobs=settings.jobs, goes_on=settings.goes_on, tell=tell):
        _try_on_farms(experiment, store, settings, left)
        measurings = [piece for piece in left if isinstance(piece, MeasuringPiece) and _is_trained(piece, store)]
        if measurings and settings.goes_on():
            _set_aside(MEASURED, store, tell)
        for piece in measurings:
            if settings.goes_on():
                measure(experiment, piece, store, tell)


def announcement(experiment: Experiment, store: Store, settings: Settings) -> list[str]:
    """The budget, which is fixed, and what of it is left."""
    whole, left = pieces(experiment), missing(experiment, store, settings.wanted, made_by)
    trainings = [piece for piece in whole if isinstance(piece, TrainingPiece)]
    samples = sum(piece.cell.training.samples for piece in trainings if piece.cell.training)
    samples += sum(start.recipe["samples"] for start in starts(whole))
    trials = sum(experiment.trials.block for piece in whole if isinstance(piece, BlockPiece) and experiment.trials)
    return [
        f"({experiment.letter}) {experiment.title}{', quick form' if experiment.quick else ''}: {len(trainings)} trainings with "
        f"{samples:,} samples in all, {trials} farm trials; about {spoken(hours(whole, settings.jobs))}",
        f"{len(whole) - len(missing(experiment, store, now=made_by))} of {len(whole)} pieces of work are done; asked for now: "
        f"{len(left)}, about {spoken(hours(left, settings.jobs))}",
        *_outdated(experiment, store),
        f"results go to {store.out}, checkpoints to {store.work}",
    ]


def _outdated(experiment: Experiment, store: Store) -> Iterator[str]:
    """What was done and counts as missing, since another version made it; told before hours are spent."""
    left = missing(experiment, store)
    for kind, of_kind in ((TRIALS, BlockPiece), (MEASURED, MeasuringPiece)):
        found = store.versions.outdated(kind, made_by) if any(isinstance(piece, of_kind) for piece in left) else {}
        if found:
            why = "; ".join(sorted({phrase for phrases in found.values() for phrase in phrases}))
            yield (
                f"{len(found)} {PARTS[kind]} are of another version ({why}) and count as missing: versions do not mix; they go "
                f"to {store.folder / SET_ASIDE} when the first new one begins"
            )


PARTS = {TRIALS: "blocks of trials", MEASURED: "measurements in simulation"}


def _set_aside(kind: str, store: Store, tell: Callable[[str], None]) -> None:
    if (aside := store.versions.set_aside(kind, made_by)) is not None:
        tell(f"{PARTS[kind]} of another version lie in {aside} now, and do not count")


def listed(experiment: Experiment, store: Store, wanted: Wanted) -> list[tuple[Piece, bool]]:
    """Every piece of work that is asked for, and whether it is done by the present version."""
    return surveyed(experiment, store, wanted, made_by)


def _try_on_farms(experiment: Experiment, store: Store, settings: Settings, left: list[Piece]) -> None:
    blocks = [piece for piece in left if isinstance(piece, BlockPiece) and _is_trained(piece, store)]
    if skipped := {f"{p.cell.name}, seed {p.seed}" for p in left if isinstance(p, BlockPiece) and not _is_trained(p, store)}:
        settings.tell(f"not tried, since not trained yet: {'; '.join(sorted(skipped))}")
    if experiment.trials is not None and blocks and settings.goes_on():
        _set_aside(TRIALS, store, settings.tell)
        how = {"open_farm": lambda farm: _forgotten(farm, store.farm_folder), "goes_on": settings.goes_on, "tell": settings.tell}
        run_blocks(blocks, experiment.trials, store, made_by=made_by, **how)


@contextmanager
def _forgotten(farm: Farm, folder: Path):
    """A farm whose logs are forgotten with it: they are large, and what counts is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with own_farm(farm, Path(tempfile.mkdtemp(dir=folder))) as opened:
            yield opened
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _is_trained(piece: BlockPiece | MeasuringPiece, store: Store) -> bool:
    """Whether there is a policy; that of another experiment's run may be missing."""
    return piece.cell.policy is not None or store.run(piece.cell, piece.seed) is not None


def measure(experiment: Experiment, piece: MeasuringPiece, store: Store, tell: Callable[[str], None]) -> None:
    """Measure in simulation and keep it."""
    from sim_backend.training.export import ExportedPolicy
    from sim_backend.training.trying import robots_of

    tell(piece.name)
    policy, key = _policy(piece.cell, piece.seed, store), Key(piece.cell.name, piece.seed, piece.physics)
    about = asked_of_measurements(experiment, piece.cell, piece.physics)
    about |= {"policy_digest": store.policy_digest(piece.cell, piece.seed), "made_by": made_by(piece.physics)}
    store.versions.of(MEASURED, about["made_by"])
    if (many := experiment.many_goals) is not None:
        robots = robots_of(piece.physics, many.trials, many.first_seed)
        task = task_of(piece.cell.task or "push")
        store.keep_measured(key, about | try_many_goals(policy, policy.manifest, task, many, robots, tell=tell))
    if (hidden := experiment.hidden) is not None:
        assert isinstance(policy, ExportedPolicy)
        trials_task = experiment.trials.task if experiment.trials else "push"
        store.keep_measured(key, about | ask(policy, task_of(trials_task), hidden))


def _policy(cell: Cell, seed: int, store: Store) -> "ExportedPolicy | GraspPolicy":
    from sim_backend.training.export import read_policy

    if (builtin := builtin_manifest(cell.policy or "")) is not None:
        return GraspPolicy(builtin)
    weights = weights_of(cell, seed, store)
    assert weights is not None
    return read_policy(weights, manifest_of(weights))


def write(found: Findings, store: Store) -> list[Path]:
    """Figure, JSON and page of an experiment; what was written."""
    from experiments.figures import draw

    store.page_folder.mkdir(parents=True, exist_ok=True)
    figures = draw(found, store.page_folder)
    text = json.dumps(document(found), indent=1) + "\n"
    return [*figures, store.write_document(text), store.write_page(experiment_page(found, bool(figures)))]


def write_overview(out: Path, work: Path, pages: Path | None) -> Path:
    """The page of all experiments."""
    found = [findings(experiment, Store(out, work, experiment)) for experiment in catalogue.CATALOGUE.values()]
    path = (pages or out) / "README.md"
    path.write_text(overview(found))
    return path


def document(found: Findings) -> dict[str, Any]:
    """All findings of an experiment as JSON."""
    return {
        "format": FORMAT,
        "experiment": found.experiment.name,
        "quick": found.experiment.quick,
        "state": found.state,
        "missing": [piece.name for piece in found.left],
        "made_by": {kind: asdict(versions) for kind, versions in found.versions.items()},
        "cells": [
            {
                "cell": each.cell,
                "physics": each.physics,
                "successes": each.successes,
                "trials": each.trials,
                "success_rate": each.rate,
                "interval_80": list(each.interval),
                "of_runs": list(each.of_runs),
            }
            for each in found.rates
        ],
        "in_a_row": [{"cell": each.cell, "physics": each.physics} | each.summary for each in found.in_a_row],
        "known": {name: list(entries) for name, entries in found.known.items()},
        "samples_to": [
            {"cell": cell, "seed": seed, "success_rate": found.experiment.reaches} | asdict(arrived)
            for cell, runs in found.arrivals.items()
            for seed, arrived in runs
        ],
        "contrasts": [
            {
                "name": each.contrast.name,
                "measure": str(each.contrast.measure),
                "first": each.contrast.first,
                "other": each.contrast.other,
                "interest": each.contrast.interest,
                "loss": each.contrast.loss,
                "ours": each.contrast.ours,
                "repeats": each.contrast.repeats,
                "known_from": each.contrast.known_from,
                "observed": None if each.observed is None else asdict(each.observed),
                "found": None if each.found is None else _finite(asdict(each.found)),
                "verdict": str(each.verdict),
                "note": each.note,
            }
            for each in found.judged
        ],
    }


def _finite(numbers: dict[str, Any]) -> dict[str, Any]:
    """An open interval has no bound, which JSON cannot say as a number."""
    return {name: None if value in (float("inf"), float("-inf")) else value for name, value in numbers.items()}
