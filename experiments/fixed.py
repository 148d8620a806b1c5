"""What was fixed before the runs of an experiment, as Markdown lines: trainings, trials, and what the judge can show by them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from api_schemas.physics import NOMINAL
from experiments.catalogue import CATALOGUE, HOURS_AGAIN
from experiments.design import Contrast, Experiment, FarmTrials, Measure
from experiments.findings import Findings, own_training
from experiments.plan import hours, pieces
from experiments.power import (
    CHANGING_SIDES,
    FIRST,
    REPETITIONS,
    SPREAD_OF_ARRIVALS,
    SPREADS,
    Design,
    power,
    power_of_arrivals,
)
from experiments.precedents import Assumed

JOBS = 2
"""Trainings side by side, for what is said of hours."""
WANTED = 0.8
"""The power that experiments which are asked again were to have for the effect of interest."""
MOST_RUNS = 8
"""Of a cell, up to which is looked for as many as would have it."""
NOTHING_MEASURED = Assumed(None, None, None, None)


def fixed(found: Findings) -> Iterator[str]:
    """The lines, with a table of the power."""
    experiment, own = found.experiment, [cell for cell in found.experiment.cells if cell.training is not None]
    yield "Fixed before these runs:"
    yield ""
    if own:
        samples = sorted({cell.training.samples for cell in own if cell.training is not None})
        each = ", ".join(f"{n:,}" for n in samples)
        runs = sum(len(cell.seeds) for cell in own)
        yield f"- {runs} trainings of {each} samples, {_seeds(experiment)}; {own_training(pieces(experiment)):,} samples in all"
    if (trials := experiment.trials) is not None:
        yield (
            f"- {trials.trials} trials of each run of each cell on {_farms(trials)}; the same goals and robots for all, job "
            f"seeds {trials.seed} to {trials.seed + trials.blocks - 1}, in turns of {trials.block}"
        )
    if (many := experiment.many_goals) is not None:
        yield f"- {many.trials} trials of each cell in simulation, at most {many.goals} goals, {many.limit_s:g} s for one"
    if (hidden := experiment.hidden) is not None:
        yield f"- {hidden.robots} robots of `real` for what the memory knows, fitted on a half of them and judged on the other"
    if not experiment.quick:
        yield from _of_arrivals(experiment)
        yield from _of_pairs(found)


def _farms(trials: FarmTrials) -> str:
    """Each with its robots."""
    told = [f"a farm of {farm.robots} robots, physics `{farm.physics}`, farm seed {farm.seed}" for farm in trials.farms]
    return " and on ".join(told)


def _of_arrivals(experiment: Experiment) -> Iterator[str]:
    arriving = [each for each in experiment.contrasts if each.measure is Measure.SAMPLES_TO and experiment.again]
    for runs, interest in dict.fromkeys((len(experiment.cell(each.other).seeds), each.interest) for each in arriving):
        yield (
            f"- power, {REPETITIONS} repetitions of the judge on made-up arrivals for each number: of {runs} runs of each cell, "
            f"all of which arrive and whose samples spread by a factor of {2**SPREAD_OF_ARRIVALS:.2g}, "
            + " and ".join(
                f"{2**truth:g} times fewer read as reproduced in {power_of_arrivals(runs, interest, truth):.0%}"
                for truth in (interest, 2 * interest)
            )
            + f"; of interest is {2**interest:g} times fewer"
        )


@dataclass(frozen=True)
class _Spread:
    """Of the trainings' true differences, as a column of the table; as measured if ``what`` says of what."""

    spread: float
    what: str = ""

    @property
    def named(self) -> str:
        return f"{self.spread:.2g}{f' ({self.what})' if self.what else ''}"


def _of_pairs(found: Findings) -> Iterator[str]:
    """The table of the power of paired trials, a line for every kind of contrast and truth."""
    experiment = found.experiment
    if experiment.trials is None:
        return
    paired = [each for each in experiment.contrasts if each.measure is Measure.SUCCESS]
    measured = found.assumed.get(paired[0].name, NOTHING_MEASURED)
    designs = list(
        dict.fromkeys(design_of(experiment, each, found.assumed.get(each.name)) for each in paired if not each.repeats)
    )
    spreads = _spreads(measured)
    yield ""
    yield _what_power_is(experiment, measured)
    yield ""
    yield f"| trials | first cell | end differently | in truth | {' | '.join(each.named for each in spreads)} |"
    yield "|---" * (4 + len(spreads)) + "|"
    for design in designs:
        for truth in (0.0,) if design.loss else (design.interest, 2 * design.interest):
            yield _row(design, truth, spreads)
    if experiment.again:
        yield ""
        for design in designs:
            yield from _of_what_was_wanted(experiment, design, spreads)


def design_of(experiment: Experiment, contrast: Contrast, measured: Assumed | None) -> Design:
    """What a contrast's trials are for its power: with what earlier results say, where they do."""
    trials, known = experiment.trials, measured or NOTHING_MEASURED
    assert trials is not None
    robots = {farm.physics: farm.robots for farm in trials.farms if farm.physics != NOMINAL}.get(contrast.farm, 0)
    design = Design(len(experiment.cell(contrast.other).seeds), trials.trials, contrast.interest, contrast.loss, robots)
    first = FIRST if known.first is None else round(known.first, 2)
    return replace(design, first=first, changing=CHANGING_SIDES if known.changing is None else round(known.changing, 2))


def _spreads(measured: Assumed) -> list[_Spread]:
    """In their order."""
    columns = [_Spread(each) for each in SPREADS]
    if measured.spread is not None and measured.largest is not None:
        columns += [_Spread(round(measured.spread, 2), "measured"), _Spread(round(measured.largest, 2), "the largest measured")]
    return sorted(columns, key=lambda each: each.spread)


def _what_power_is(experiment: Experiment, measured: Assumed) -> str:
    said = (
        f"Power: how many of {REPETITIONS} made-up repetitions the judge reads as reproduced, by the whole rule, floors and "
        "ceilings included, where the trainings' true differences spread by so much (standard deviation). Where robots differ, "
        "the true difference is the same on all of them. How often the first cell succeeds and how many goals end differently is "
    )
    if measured.spread is None:
        return f"{said}assumed."
    earlier = CATALOGUE[experiment.again]
    return (
        f"{said}as in ({earlier.letter}), the first cell as where the same policies were tried before; where no pairs say it, as "
        "in all earlier experiments together. The spread is that of all earlier contrasts of several trainings, the chance of "
        "their trials taken off."
    )


def _row(design: Design, truth: float, spreads: Sequence[_Spread]) -> str:
    runs = f"{design.runs} runs" if design.runs > 1 else "1 run"
    robots = f"{design.robots} robots that differ" if design.robots else "robots alike"
    said = f"less than {design.interest:g} lost: nothing is" if design.loss else f"a gain of {truth:g}"
    of_interest = ", that of interest" if truth == design.interest and not design.loss else ""
    powers = [f"{power(design, truth, each.spread):.0%}" if design.runs > 1 or not each.spread else "" for each in spreads]
    begun = f"| {runs} of {design.goals} pairs, {robots} | {design.first:.0%} | {design.changing:.0%} | {said}{of_interest} |"
    return f"{begun} {' | '.join(powers)} |"


def _of_what_was_wanted(experiment: Experiment, design: Design, spreads: Sequence[_Spread]) -> Iterator[str]:
    """Where the power that was to be had is there, and what it would take where it is not."""
    asked = f"that less than {design.interest:g} is lost" if design.loss else f"a gain of {design.interest:g}"
    robots = f"{design.robots} robots that differ" if design.robots else "robots alike"
    if design.runs == 1:
        yield f"- {asked}, 1 run, {robots}: this policy alone, and nothing of how trainings differ"
        return
    enough = [each.named for each in spreads if power(design, design.of_interest, each.spread) >= WANTED]
    short = [each for each in spreads if each.named not in enough]
    said = f"- {asked}, {design.runs} runs, {robots}: {WANTED:.0%} is there at spreads of {', '.join(enough) or 'none of these'}"
    if not short:
        yield said
        return
    said += f", and not at {', '.join(each.named for each in short)}: *undecided* there says less than {WANTED:.0%} would"
    missed = next((each for each in spreads if each.what and each in short), None)
    yield said if missed is None else f"{said}. {_would_take(experiment, design, missed)}"


def _would_take(experiment: Experiment, design: Design, missed: _Spread) -> str:
    """How many runs would have the power at a spread, and for how many hours more."""
    for runs in range(design.runs + 1, MOST_RUNS + 1):
        if power(replace(design, runs=runs), design.of_interest, missed.spread) >= WANTED:
            break
    else:
        return f"At {missed.named}, more than {MOST_RUNS} runs of each cell would have it"
    said = f"At {missed.named}, {runs} runs of each cell would have it"
    if not all(cell.training is not None for cell in experiment.cells):
        return said
    cells = tuple(replace(cell, seeds=tuple(range(1, runs + 1))) for cell in experiment.cells)
    more = hours(pieces(replace(experiment, cells=cells)), JOBS) - hours(pieces(experiment), JOBS)
    left = HOURS_AGAIN - hours([piece for each in CATALOGUE.values() if each.again for piece in pieces(each)], JOBS)
    return f"{said}, {more:.1f} hours of two cores more; of the {HOURS_AGAIN:g} of all that is asked again {left:.1f} are left"


def _seeds(experiment: Experiment) -> str:
    seeds = sorted({seed for cell in experiment.cells if cell.training is not None for seed in cell.seeds})
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"
