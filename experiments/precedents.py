"""What earlier experiments measured of that which the power of a later one assumes, computed from their kept results."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from api_schemas.physics import NOMINAL
from experiments.catalogue import CATALOGUE
from experiments.contrasts import of_farm
from experiments.design import Contrast, Experiment, Measure
from experiments.judging import Observed, hidden_success, observed, paired_success, true_spread
from experiments.store import Store


@dataclass(frozen=True)
class Precedent:
    """A contrast of an earlier experiment: what trials show on robots of a physics, and whether a floor or a ceiling hides it."""

    experiment: Experiment
    contrast: Contrast
    physics: str
    shown: Observed
    hidden: bool = False


@dataclass(frozen=True)
class Assumed:
    """What is assumed of a contrast's trials; None where no earlier result says it.

    ``first`` and ``changing`` are means over the same contrasts asked before on the same kind of robots: ``first`` is that of the
    same policies where another experiment has tried them, ``changing`` goes over all precedents where those contrasts do not say
    it. ``spread`` is the root of the mean square over all precedents of several runs, and ``largest`` the largest of them. What a
    floor or a ceiling hides counts for ``first`` alone.
    """

    first: float | None
    changing: float | None
    spread: float | None
    largest: float | None


def precedents(store_of: Callable[[Experiment], Store]) -> list[Precedent]:
    """Of all contrasts of success that were asked for the first time, as far as they are there.

    Trainings whose trials on a farm tell nothing, as too few succeed there, are also compared as they were tried at their end.
    """
    found = []
    for experiment in CATALOGUE.values():
        if experiment.trials is not None and not experiment.again:
            found += _of(experiment, store_of(experiment))
    return found


def _of(experiment: Experiment, store: Store) -> Iterator[Precedent]:
    for contrast in experiment.contrasts:
        if contrast.measure is not Measure.SUCCESS:
            continue
        cells = [experiment.cell(name) for name in (contrast.first, contrast.other)]
        first, other = (of_farm(cell, contrast.farm, experiment, store).reached for cell in cells)
        if (found := paired_success(first, other)) is None or min(len(first), len(other)) < len(cells[1].seeds):
            continue
        hidden = bool(hidden_success(contrast, found, first, other))
        yield Precedent(experiment, contrast, contrast.farm, observed(first, other), hidden)
        if hidden and (shown := _at_the_end(experiment, contrast, store)) is not None:
            yield Precedent(experiment, contrast, NOMINAL, shown)


def _at_the_end(experiment: Experiment, contrast: Contrast, store: Store) -> Observed | None:
    """As both cells' runs were tried on nominal robots when they were trained: of that rates alone are kept."""
    kept = []
    for cell in (experiment.cell(contrast.first), experiment.cell(contrast.other)):
        runs = [store.run(cell, seed) for seed in cell.seeds]
        finals = [each for run in runs if run is not None for each in run["final"] if each["physics"] == NOMINAL]
        if cell.training is None or not finals or len(finals) < len(cell.seeds):
            return None
        kept.append([(each["success_rate"], each["trials"]) for each in finals])
    first, other = kept
    differences = [after - before for (before, _), (after, _) in zip(first, other, strict=True)]
    chance = [sum(rate * (1 - rate) / trials for rate, trials in sides) for sides in zip(first, other, strict=True)]
    return Observed(true_spread(differences, chance), None, _mean([rate for rate, _ in first]))


def assumed(experiment: Experiment, contrast: Contrast, before: Sequence[Precedent]) -> Assumed:
    """What earlier results say of a contrast of an experiment that is asked again, together with those that are like it."""
    like = [each for each in experiment.contrasts if kind(experiment, each) == kind(experiment, contrast)]
    pairs = {(each.first, each.other) for each in like}
    alike = [
        each
        for each in before
        if each.experiment.name == experiment.again and each.physics == contrast.farm
        if (each.contrast.first, each.contrast.other) in pairs
    ]
    changing = _told(alike, "changing") or _told(before, "changing")
    spreads = _told(before, "spread")
    cell = experiment.cell(contrast.first)
    same = [
        each
        for each in before
        if (each.experiment.name, each.contrast.first, each.physics) == (cell.runs_of, cell.runs_of_cell, contrast.farm)
    ]
    return Assumed(
        _mean([each.shown.first for each in same or alike]) if same or alike else None,
        _mean(changing) if changing else None,
        math.sqrt(_mean([each**2 for each in spreads])) if spreads else None,
        max(spreads, default=None),
    )


def kind(experiment: Experiment, contrast: Contrast) -> tuple:
    """Contrasts of one kind share runs, farm, rule and task, and one line of what is told of power."""
    cell = experiment.cell(contrast.other)
    return contrast.measure, len(cell.seeds), contrast.farm, contrast.interest, contrast.loss, cell.task


def _told(some: Sequence[Precedent], what: str) -> list[float]:
    """One thing that those that nothing hides say, of those that say it."""
    said = [getattr(each.shown, what) for each in some if not each.hidden]
    return [each for each in said if each is not None]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
