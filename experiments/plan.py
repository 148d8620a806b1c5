"""What an experiment still needs: pieces of work, each kept when it is done, and how long they will take."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from experiments.design import Cell, Experiment, Farm, Start
from experiments.result_files import MEASURED, TRIALS, Key
from experiments.store import Store
from sim_backend.tasks import TASKS

FARM_STARTS_S = 10.0
USUAL_TASK_S = 15.0
GOAL_S = 5.0
"""Simulated, for a goal of many, on average; a guess for the plan alone."""
SIMULATED_PER_S = 60.0
"""Of all trials together, on one thread at 1 kHz; a guess for the plan alone."""
HIDDEN_S = 60.0


@dataclass(frozen=True)
class TrainingPiece:
    """One run of one cell."""

    cell: Cell
    seed: int
    seconds: float

    @property
    def name(self) -> str:
        """For people."""
        return f"train {self.cell.name}, seed {self.seed}"


@dataclass(frozen=True)
class BlockPiece:
    """One block of farm trials of one run."""

    cell: Cell
    seed: int
    farm: Farm
    block: int
    seconds: float

    @property
    def name(self) -> str:
        """For people."""
        return f"trials of {self.cell.name}, seed {self.seed}, {self.farm.physics} farm, block {self.block}"


@dataclass(frozen=True)
class MeasuringPiece:
    """One measurement in simulation."""

    cell: Cell
    seed: int
    physics: str
    seconds: float

    @property
    def name(self) -> str:
        """For people."""
        return f"measure {self.cell.name}, seed {self.seed}, {self.physics} robots"


Piece = TrainingPiece | BlockPiece | MeasuringPiece


@dataclass(frozen=True)
class Wanted:
    """What is asked for: all, or one cell, or one seed."""

    cell: str | None = None
    seed: int | None = None

    def takes(self, cell: Cell, seed: int) -> bool:
        """Whether this run is asked for."""
        return self.cell in (None, cell.name) and self.seed in (None, seed)


def pieces(experiment: Experiment) -> list[Piece]:
    """Everything, in order: trainings, then farm trials block by block so that cells take turns, then measurements."""
    runs = [(cell, seed) for cell in experiment.cells for seed in cell.seeds]
    found: list[Piece] = []
    found += [TrainingPiece(cell, seed, cell.training.seconds) for cell, seed in runs if cell.training is not None]
    if (trials := experiment.trials) is not None:
        for farm in trials.farms:
            for block in range(trials.blocks):
                for cell, seed in runs:
                    longer = TASKS[cell.task or trials.task].duration_s / USUAL_TASK_S
                    found.append(BlockPiece(cell, seed, farm, block, trials.block * trials.trial_s * longer))
    if (many := experiment.many_goals) is not None:
        seconds = many.trials * many.goals * GOAL_S / SIMULATED_PER_S
        found += [MeasuringPiece(cell, seed, physics, seconds) for cell, seed in runs for physics in many.physics]
    if (hidden := experiment.hidden) is not None:
        found += [MeasuringPiece(cell, seed, "real", HIDDEN_S) for cell, seed in runs if cell.name in hidden.cells]
    return found


def is_done(piece: Piece, store: Store) -> bool:
    """Whether its result is kept."""
    match piece:
        case TrainingPiece():
            return store.run(piece.cell, piece.seed) is not None
        case BlockPiece():
            kept = store.trials(Key(piece.cell.name, piece.seed, piece.farm.physics))
            return kept is not None and str(piece.block) in kept["blocks"]
        case MeasuringPiece():
            return store.measured(Key(piece.cell.name, piece.seed, piece.physics)) is not None


Now = Callable[[str], Mapping[str, str]]
"""What trials or measurements on robots of a physics are made by now."""


def missing(experiment: Experiment, store: Store, wanted: Wanted | None = None, now: Now | None = None) -> list[Piece]:
    """What is asked for and not there; with ``now`` also what is of another version, where more of its kind is missing."""
    return [piece for piece, done in surveyed(experiment, store, wanted, now) if not done]


def surveyed(
    experiment: Experiment, store: Store, wanted: Wanted | None = None, now: Now | None = None
) -> list[tuple[Piece, bool]]:
    """Every piece of work that is asked for, and whether it is done.

    What is whole stays whatever the version. What is not cannot be added to by another one, so that with ``now`` all that is of
    another version counts as missing.
    """
    asked, whole = wanted or Wanted(), pieces(experiment)
    done = [is_done(piece, store) for piece in whole]
    outdated: set[tuple[str, str]] = set()
    for kind, of_kind in ((TRIALS, BlockPiece), (MEASURED, MeasuringPiece)):
        if now is not None and not all(
            is_there for piece, is_there in zip(whole, done, strict=True) if isinstance(piece, of_kind)
        ):
            outdated |= store.versions.outdated(kind, now).keys()
    return [
        (piece, is_there and _part(piece) not in outdated)
        for piece, is_there in zip(whole, done, strict=True)
        if asked.takes(piece.cell, piece.seed)
    ]


def _part(piece: Piece) -> tuple[str, str]:
    """The stem of its file and its block, as the store names what is outdated."""
    match piece:
        case TrainingPiece():
            return Key(piece.cell.name, piece.seed).stem, ""
        case BlockPiece():
            return Key(piece.cell.name, piece.seed, piece.farm.physics).stem, str(piece.block)
        case MeasuringPiece():
            return Key(piece.cell.name, piece.seed, piece.physics).stem, ""


def starts(found: Sequence[Piece]) -> list[Start]:
    """What the trainings among the pieces go on from, each once."""
    trainings = [(piece.cell.training, piece.seed) for piece in found if isinstance(piece, TrainingPiece)]
    begun = [training.start.of(seed) for training, seed in trainings if training is not None and training.start is not None]
    return list({start.name: start for start in begun}.values())


def hours(found: Sequence[Piece], jobs: int) -> float:
    """How long the pieces take, trainings side by side; starts, farms and measurements have the machine to themselves."""
    training = sum(piece.seconds for piece in found if isinstance(piece, TrainingPiece)) / jobs
    training += sum(start.seconds for start in starts(found))
    farms = {piece.farm for piece in found if isinstance(piece, BlockPiece)}
    rest = sum(piece.seconds for piece in found if not isinstance(piece, TrainingPiece))
    return (training + rest + FARM_STARTS_S * len(farms)) / 3600


def spoken(duration_h: float) -> str:
    """A duration for people: in minutes where that is less than an hour."""
    return f"{duration_h:.1f} hours" if duration_h >= 1.0 else f"{60 * duration_h:.0f} minutes"
