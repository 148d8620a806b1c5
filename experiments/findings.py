"""What the kept results say: rates, curves, goals in a row and what memories know, cell by cell, and the contrasts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.consecutive import summary
from experiments.contrasts import Judged, Runs, arrivals, demonstrated_periods, judge, known_by_parameter, of_farm
from experiments.design import Cell, Experiment, Measure
from experiments.judging import Arrival, rate_interval
from experiments.plan import Piece, TrainingPiece, missing, pieces
from experiments.precedents import Assumed, assumed, precedents
from experiments.provenance import Versions
from experiments.result_files import MEASURED, TRIALS, Key
from experiments.store import Store

COMPLETE = "complete"
SAME_EVALUATION = 0.01
"""Share of a run's samples by which evaluations of several runs may lie apart that are shown as one point."""


@dataclass(frozen=True)
class Rate:
    """Success of a cell on one farm, over all its runs; ``interval`` is at 80 %: the widest of trials, runs, goals, robots."""

    cell: str
    physics: str
    successes: int
    trials: int
    of_runs: tuple[float, ...]
    interval: tuple[float, float]

    @property
    def rate(self) -> float:
        """A fraction."""
        return self.successes / self.trials


@dataclass(frozen=True)
class Curve:
    """Success in training of a cell's runs: samples (points,), and success of each run (runs, points).

    Samples count the control periods of demonstrations, as :attr:`Findings.arrivals` do.
    """

    cell: str
    samples: np.ndarray
    success: np.ndarray


@dataclass(frozen=True)
class InARow:
    """Goals in a row of a cell's trials, and how the trials ended."""

    cell: str
    physics: str
    reached: tuple[int, ...]
    ended: tuple[str, ...]

    @property
    def summary(self) -> dict:
        """Mean, deviation, median, and the trials sorted."""
        return summary(self.reached)


@dataclass(frozen=True)
class Findings:
    """All that there is of one experiment.

    ``versions`` is what made it, by the kind of result, ``trained_by`` the same of each training, ``aside`` how much of each kind
    does not count any more, and ``assumed`` what earlier results say for the power of each contrast of
    paired trials, where the experiment asks an earlier one again.
    """

    experiment: Experiment
    rates: tuple[Rate, ...]
    curves: tuple[Curve, ...]
    in_a_row: tuple[InARow, ...]
    known: Mapping[str, Sequence[Mapping[str, Any]]]
    runs: Runs
    arrivals: Mapping[str, Sequence[tuple[int, Arrival]]]
    judged: tuple[Judged, ...]
    left: tuple[Piece, ...]
    versions: Mapping[str, Versions]
    trained_by: Sequence[Sequence[Mapping[str, str]]]
    aside: Mapping[str, int]
    assumed: Mapping[str, Assumed]

    @property
    def state(self) -> str:
        """``not run yet``, ``run in part`` or ``complete``."""
        if not self.left:
            return COMPLETE
        return "not run yet" if len(self.left) == len(pieces(self.experiment)) else "run in part"

    @property
    def has_figure(self) -> bool:
        """Whether there is anything to draw."""
        return bool(self.curves or self.rates or self.in_a_row or self.known)


def findings(experiment: Experiment, store: Store) -> Findings:
    """Read everything and judge it.

    Raises:
        StoreError: something is of another design, or does not go together.
    """
    store.begun_with()
    runs = {
        cell.name: [(seed, run) for seed in cell.seeds if (run := store.run(cell, seed)) is not None]
        for cell in experiment.cells
        if cell.training is not None or cell.runs_of is not None
    }
    return Findings(
        experiment,
        tuple(_rates(experiment, store)),
        tuple(_curves(experiment, runs)) if experiment.curves else (),
        tuple(_in_a_row(experiment, store)),
        known_by_parameter(experiment, store),
        runs,
        {cell.name: found for cell in experiment.cells if (found := arrivals(cell, experiment, runs)) and experiment.curves},
        tuple(judge(contrast, experiment, store, runs) for contrast in experiment.contrasts),
        tuple(missing(experiment, store)),
        {kind: versions for kind in (TRIALS, MEASURED) if (versions := store.versions.of(kind)).parts},
        store.trained_by(),
        store.versions.aside(),
        _assumed(experiment, store),
    )


def _assumed(experiment: Experiment, store: Store) -> dict[str, Assumed]:
    paired = [each for each in experiment.contrasts if each.measure is Measure.SUCCESS]
    if not paired or not experiment.again or experiment.quick:
        return {}
    before = precedents(lambda earlier: replace(store, experiment=earlier))
    return {each.name: assumed(experiment, each, before) for each in paired}


def _rates(experiment: Experiment, store: Store):
    if experiment.trials is None:
        return
    for farm in experiment.trials.farms:
        for cell in experiment.cells:
            tried = of_farm(cell, farm.physics, experiment, store)
            if of_runs := tried.reached:
                reached = [sum(run.values()) for run in of_runs]
                trials, each = sum(map(len, of_runs)), tuple(n / len(run) for n, run in zip(reached, of_runs, strict=True))
                yield Rate(cell.name, farm.physics, sum(reached), trials, each, rate_interval(of_runs, tried.robots))


def _curves(experiment: Experiment, runs: Runs):
    for cell in experiment.cells:
        if (found := _curve(cell, runs.get(cell.name, ()))) is not None:
            yield found


def _curve(cell: Cell, runs: Sequence[tuple[int, Mapping[str, Any]]]) -> Curve | None:
    """Evaluations on nominal robots, where all runs have them; of a run that was resumed they come some samples off."""
    lines = [
        sorted((each["samples"], each["success_rate"]) for each in run["evaluations"] if each["physics"] == "nominal")
        for _, run in runs
    ]
    if not lines or not all(lines):
        return None
    together, off = [], SAME_EVALUATION * max(line[-1][0] for line in lines)
    for samples, _ in lines[0]:
        nearest = [min(line, key=lambda each: abs(each[0] - samples)) for line in lines]
        if all(abs(each[0] - samples) <= off for each in nearest):
            together.append(nearest)
    if not together:
        return None
    before = demonstrated_periods(cell.training.demonstrations) if cell.training is not None else 0
    points = np.array(together)
    return Curve(cell.name, before + points[:, :, 0].mean(axis=1), points[:, :, 1].T)


def _in_a_row(experiment: Experiment, store: Store):
    if experiment.many_goals is None:
        return
    for cell in experiment.cells:
        for physics in experiment.many_goals.physics:
            if (found := store.measured(Key(cell.name, cell.seeds[0], physics))) is not None:
                yield InARow(cell.name, physics, tuple(found["reached"]), tuple(found["ended"]))


def own_training(left: Sequence[Piece]) -> int:
    """Samples that are still to be trained."""
    return sum(each.cell.training.samples for each in left if isinstance(each, TrainingPiece) and each.cell.training)
