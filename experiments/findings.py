"""What the kept results say: rates, curves, goals in a row and what memories know, cell by cell, and the contrasts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from api_schemas.success_rate import wilson
from experiments.consecutive import summary
from experiments.design import Cell, Contrast, Experiment, Measure
from experiments.farm_trials import by_goal
from experiments.judging import LEVEL, Difference, Verdict, paired_success, samples_to, times_fewer, verdict, welch
from experiments.plan import Piece, TrainingPiece, missing, pieces
from experiments.store import Key, Store


@dataclass(frozen=True)
class Rate:
    """Success of a cell on one farm, over all its runs."""

    cell: str
    physics: str
    successes: int
    trials: int
    of_runs: tuple[float, ...]

    @property
    def rate(self) -> float:
        """A fraction."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's at 80 %, over the trials."""
        return wilson(self.successes, self.trials, LEVEL)


@dataclass(frozen=True)
class Curve:
    """Success in training of a cell's runs: samples (points,), and success of each run (runs, points)."""

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
class Judged:
    """A contrast with what was found."""

    contrast: Contrast
    found: Difference | None
    verdict: Verdict
    note: str = ""


@dataclass(frozen=True)
class Findings:
    """All that there is of one experiment."""

    experiment: Experiment
    rates: tuple[Rate, ...]
    curves: tuple[Curve, ...]
    in_a_row: tuple[InARow, ...]
    known: Mapping[str, Sequence[Mapping[str, Any]]]
    runs: Mapping[str, Sequence[tuple[int, Mapping[str, Any]]]]
    judged: tuple[Judged, ...]
    left: tuple[Piece, ...]

    @property
    def state(self) -> str:
        """``not run yet``, ``run in part`` or ``complete``."""
        if not self.left:
            return "complete"
        return "not run yet" if len(self.left) == len(pieces(self.experiment)) else "run in part"

    @property
    def has_figure(self) -> bool:
        """Whether there is anything to draw."""
        return bool(self.curves or self.rates or self.in_a_row or self.known)


def findings(experiment: Experiment, store: Store) -> Findings:
    """Read everything and judge it."""
    runs = {
        cell.name: [(seed, run) for seed in cell.seeds if (run := store.run(cell, seed)) is not None]
        for cell in experiment.cells
        if cell.training is not None or cell.runs_of is not None
    }
    return Findings(
        experiment,
        tuple(_rates(experiment, store)),
        tuple(curve for cell, found in runs.items() if (curve := _curve(cell, found)) is not None) if experiment.curves else (),
        tuple(_in_a_row(experiment, store)),
        _known(experiment, store),
        runs,
        tuple(_judge(contrast, experiment, store, runs) for contrast in experiment.contrasts),
        tuple(missing(experiment, store)),
    )


def _of_farm(cell: Cell, physics: str, experiment: Experiment, store: Store) -> list[dict[int, bool]]:
    """Whether each goal was reached, of each run whose blocks are all there."""
    assert experiment.trials is not None
    found = (store.trials(Key(cell.name, seed, physics)) for seed in cell.seeds)
    return [by_goal(kept) for kept in found if kept is not None and len(kept["blocks"]) == experiment.trials.blocks]


def _rates(experiment: Experiment, store: Store):
    if experiment.trials is None:
        return
    for farm in experiment.trials.farms:
        for cell in experiment.cells:
            if of_runs := _of_farm(cell, farm.physics, experiment, store):
                reached = [sum(run.values()) for run in of_runs]
                trials, each = sum(map(len, of_runs)), tuple(n / len(run) for n, run in zip(reached, of_runs, strict=True))
                yield Rate(cell.name, farm.physics, sum(reached), trials, each)


def _curve(cell: str, runs: Sequence[tuple[int, Mapping[str, Any]]]) -> Curve | None:
    """Evaluations on nominal robots, where all runs have them."""
    lines = [
        {each["samples"]: each["success_rate"] for each in run["evaluations"] if each["physics"] == "nominal"} for _, run in runs
    ]
    if not lines:
        return None
    steps = min(map(len, lines))
    if steps == 0:
        return None
    success = np.array([[line[samples] for samples in sorted(line)[:steps]] for line in lines])
    return Curve(cell, np.array(sorted(lines[0])[:steps]), success)


def _in_a_row(experiment: Experiment, store: Store):
    if experiment.many_goals is None:
        return
    for cell in experiment.cells:
        for physics in experiment.many_goals.physics:
            if (found := store.measured(Key(cell.name, cell.seeds[0], physics))) is not None:
                yield InARow(cell.name, physics, tuple(found["reached"]), tuple(found["ended"]))


def _known(experiment: Experiment, store: Store) -> dict[str, list[dict[str, Any]]]:
    """By parameter, one entry for each run and instant."""
    if experiment.hidden is None:
        return {}
    found: dict[str, list[dict[str, Any]]] = {}
    for cell in experiment.cells:
        for seed in cell.seeds if cell.name in experiment.hidden.cells else ():
            if (measured := store.measured(Key(cell.name, seed, "real"))) is None:
                continue
            for parameter, asked in measured["parameters"].items():
                found.setdefault(parameter, []).extend({"seed": seed} | each for each in asked)
    return found


def _judge(contrast: Contrast, experiment: Experiment, store: Store, runs: Mapping) -> Judged:
    found, note = _difference(contrast, experiment, store, runs)
    return Judged(contrast, found, verdict(contrast, found), note)


def _difference(contrast: Contrast, experiment: Experiment, store: Store, runs: Mapping) -> tuple[Difference | None, str]:
    first, other = experiment.cell(contrast.first), experiment.cell(contrast.other)
    match contrast.measure:
        case Measure.SUCCESS:
            sides = [_of_farm(cell, contrast.farm, experiment, store) for cell in (first, other)]
            complete = all(len(side) == len(cell.seeds) for side, cell in zip(sides, (first, other), strict=True))
            return (paired_success(*sides) if complete else None), ""
        case Measure.SAMPLES_TO:
            return _samples_difference(experiment, first, other, runs)
        case Measure.GOALS:
            keys = (Key(first.name, first.seeds[0], contrast.of_first), Key(other.name, other.seeds[0], contrast.farm))
            kept = [store.measured(key) for key in keys]
            if any(each is None for each in kept):
                return None, ""
            return welch(*(each["reached"] for each in kept if each is not None)), ""
        case Measure.KNOWN:
            return _known_difference(contrast, experiment, store, other)


def _samples_difference(experiment: Experiment, first: Cell, other: Cell, runs: Mapping) -> tuple[Difference | None, str]:
    sides, late = [], []
    for cell in (first, other):
        assert cell.training is not None
        if len(runs[cell.name]) < len(cell.seeds):
            return None, ""
        arrived = [samples_to(run["evaluations"], experiment.reaches, cell.training.samples) for _, run in runs[cell.name]]
        sides.append(arrived)
        if never := sum(not there for _, there in arrived):
            late.append(f"{never} of {len(arrived)} runs of {cell.name} never arrived")
    return times_fewer(*sides), "; ".join(late)


def _known_difference(contrast: Contrast, experiment: Experiment, store: Store, cell: Cell) -> tuple[Difference | None, str]:
    """At the last instant; over several runs the lowest and highest bound, since all drive the same robots."""
    entries = [each for each in _known(experiment, store).get(contrast.parameter, ()) if each["seed"] in cell.seeds]
    if len({each["seed"] for each in entries}) < len(cell.seeds):
        return None, ""
    last = max(each["at_s"] for each in entries)
    of_runs = [each for each in entries if each["at_s"] == last]
    mean = float(np.mean([each["difference"] for each in of_runs]))
    low, high = min(each["low"] for each in of_runs), max(each["high"] for each in of_runs)
    return Difference(mean, low, high, of_runs[0]["robots"], len(of_runs)), f"after {last:g} s"


def own_training(left: Sequence[Piece]) -> int:
    """Samples that are still to be trained."""
    return sum(each.cell.training.samples for each in left if isinstance(each, TrainingPiece) and each.cell.training)
