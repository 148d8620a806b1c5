"""Pages of the experiments, made of nothing but the kept results: one of each, and one that shows all side by side."""

from collections.abc import Iterator, Mapping, Sequence

from experiments.catalogue import HOURS_ALLOWED
from experiments.design import UNITS, Contrast, Experiment, Measure
from experiments.findings import Findings, Judged, own_training
from experiments.judging import CHANGING_SIDES, Difference, Verdict, detectable
from experiments.plan import hours, pieces

JOBS = 2
"""Trainings side by side, for what is said of hours."""
ORDER = (Verdict.REPRODUCED, Verdict.NOT_REPRODUCED, Verdict.UNDECIDED, Verdict.NOT_RUN)
HEADINGS = {
    Verdict.REPRODUCED: "Reproduced",
    Verdict.NOT_REPRODUCED: "Not reproduced",
    Verdict.UNDECIDED: "Undecided",
    Verdict.NOT_RUN: "Not run yet",
}


def experiment_page(found: Findings, figure: bool) -> str:
    """The page of one experiment.

    Args:
        found: what there is.
        figure: whether its figure lies beside the page.
    """
    experiment = found.experiment
    lines = [
        f"# ({experiment.letter}) {experiment.title}",
        "",
        experiment.question,
        "",
        f"**State: {found.state}.** {_missing(found)}",
        *(["", "**The quick form: it shows that everything runs, and nothing else.**"] if experiment.quick else []),
        "",
        "```",
        f"trifarm experiment {experiment.name}{' --quick' if experiment.quick else ''}",
        "```",
        "",
        *_budget(found),
        "",
        "## What the papers say",
        "",
        *(f"- {claim.text} ({claim.source})" for claim in experiment.claims),
        "",
        f"What is different here: {experiment.limits}",
        "",
        "## What was found",
        "",
    ]
    if figure:
        lines += [f"![{experiment.title}]({experiment.name}.svg)", ""]
    lines += [*_cells(found), "", *_contrasts(found.judged), "", *_many_goals(found), *_known(found)]
    return "\n".join(lines).rstrip() + "\n"


def overview(all_found: Sequence[Findings]) -> str:
    """The page that shows all of them."""
    judged = [(found, each) for found in all_found for each in found.judged]
    lines = [
        "# The papers' claims, tried on our farm",
        "",
        "Made by `trifarm experiment NAME` from the JSON files beside this page; a test compares them. Each experiment is one",
        "command, which goes on where the last one stopped: only what is missing is run. Intervals are at 80 %. A contrast whose",
        "interval holds 0 and is wider than the effect of interest is *undecided*. Policies that trials still need lie beside",
        "their runs; those of more than 300 kB stay in the work folder of the machine that trained them, and trials run there.",
        "",
        "| experiment | state | the papers | here |",
        "|---|---|---|---|",
        *(_row(found) for found in all_found),
        "",
        f"{_tally(judged)} All trainings and trials together take about {_total_hours(all_found):.1f} hours on two cores "
        f"(at most {HOURS_ALLOWED:g}).",
        "",
    ]
    for kind in ORDER:
        of_kind = [(found, each) for found, each in judged if each.verdict is kind]
        lines += [f"## {HEADINGS[kind]}", ""]
        lines += [_sentence(found, each) for found, each in of_kind] or ["Nothing."]
        lines.append("")
    if drawn := [found.experiment for found in all_found if found.has_figure]:
        lines += ["## Figures", "", *(f"![({each.letter}) {each.title}]({each.name}.svg)\n" for each in drawn)]
    return "\n".join(lines).rstrip() + "\n"


def _row(found: Findings) -> str:
    experiment = found.experiment
    papers = "; ".join(f"{claim.text} ({claim.source})" for claim in experiment.claims)
    page = f"[({experiment.letter}) {experiment.title}]({experiment.name}.md)"
    return f"| {page} | {found.state} | {papers} | {_here(found)} |"


def _here(found: Findings) -> str:
    if found.state == "not run yet":
        return "not run yet"
    counts = {kind: sum(each.verdict is kind for each in found.judged) for kind in ORDER}
    said = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    first = next((each for each in found.judged if each.found is not None), None)
    example = "" if first is None or first.found is None else f"; {first.contrast.name}: {shown(first.contrast, first.found)}"
    return f"of {len(found.judged)} contrasts {said}{example}"


def _tally(judged: Sequence[tuple[Findings, Judged]]) -> str:
    counts = [f"{sum(each.verdict is kind for _, each in judged)} {kind}" for kind in ORDER]
    return f"Of {len(judged)} contrasts: {', '.join(counts)}."


def _sentence(found: Findings, each: Judged) -> str:
    said = f"- ({found.experiment.letter}) {each.contrast.name}"
    return said if each.found is None else f"{said}: {shown(each.contrast, each.found)}"


def _total_hours(all_found: Sequence[Findings]) -> float:
    return hours([piece for found in all_found for piece in pieces(found.experiment)], JOBS)


def _missing(found: Findings) -> str:
    if found.state == "complete":
        return "Everything is there."
    whole, left = pieces(found.experiment), found.left
    still = f"about {hours(left, JOBS):.1f} hours on two cores"
    if found.state == "not run yet":
        return f"Nothing of it has been run: {len(left)} pieces of work, {still}."
    return f"{len(whole) - len(left)} of {len(whole)} pieces of work are done; what is missing takes {still}."


def _budget(found: Findings) -> Iterator[str]:
    experiment, own = found.experiment, [cell for cell in found.experiment.cells if cell.training is not None]
    yield "Fixed before anything ran:"
    yield ""
    if own:
        samples = sorted({cell.training.samples for cell in own if cell.training is not None})
        each = ", ".join(f"{n:,}" for n in samples)
        runs = sum(len(cell.seeds) for cell in own)
        yield f"- {runs} trainings of {each} samples, {_seeds(experiment)}; {own_training(pieces(experiment)):,} samples in all"
    if (trials := experiment.trials) is not None:
        farms = " and ".join(f"`{farm.physics}`" for farm in trials.farms)
        yield (
            f"- {trials.trials} trials of each run of each cell on a farm of {trials.farms[0].robots} robots, physics "
            f"{farms}, farm seed "
            f"{trials.farms[0].seed}; the same goals and robots for all, job seeds {trials.seed} to "
            f"{trials.seed + trials.blocks - 1}, "
            f"in turns of {trials.block}"
        )
    if (many := experiment.many_goals) is not None:
        yield f"- {many.trials} trials of each cell in simulation, at most {many.goals} goals, {many.limit_s:g} s for one"
    if (hidden := experiment.hidden) is not None:
        yield f"- {hidden.robots} robots of `real` for what the memory knows, fitted on a half of them and judged on the other"
    if paired := [each for each in experiment.contrasts if each.measure is Measure.SUCCESS]:
        pairs = _pairs(experiment, paired[0])
        yield (
            f"- power: with {pairs} pairs, of which {CHANGING_SIDES:.0%} end differently, a difference of "
            f"{detectable(pairs):.2f} is told "
            f"from 0 in four of five repetitions; of interest is {paired[0].interest:g}"
        )


def _pairs(experiment: Experiment, contrast: Contrast) -> int:
    assert experiment.trials is not None
    seeds = min(len(experiment.cell(name).seeds) for name in (contrast.first, contrast.other))
    return seeds * experiment.trials.trials


def _seeds(experiment: Experiment) -> str:
    seeds = sorted({seed for cell in experiment.cells if cell.training is not None for seed in cell.seeds})
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"


def _cells(found: Findings) -> Iterator[str]:
    experiment = found.experiment
    kinds = list(dict.fromkeys(farm.physics for farm in experiment.trials.farms)) if experiment.trials else []
    yield "| cell | what it is | runs |" + "".join(f" success, {kind} farm |" for kind in kinds)
    yield "|---|---|---|" + "---|" * len(kinds)
    for cell in experiment.cells:
        runs = found.runs.get(cell.name)
        done = "no training" if runs is None else f"{len(runs)} of {len(cell.seeds)}"
        yield f"| `{cell.name}` | {cell.about} | {done} |" + "".join(f" {_rate(found, cell.name, kind)} |" for kind in kinds)


def _rate(found: Findings, cell: str, physics: str) -> str:
    for each in found.rates:
        if (each.cell, each.physics) == (cell, physics):
            low, high = each.interval
            return f"{each.successes} of {each.trials}: {each.rate:.0%} ({low:.0%} to {high:.0%})"
    return "not run yet"


def _contrasts(judged: Sequence[Judged]) -> Iterator[str]:
    yield "| contrast | difference, 80 % interval | of interest | verdict |"
    yield "|---|---|---|---|"
    for each in judged:
        said = "not run yet" if each.found is None else shown(each.contrast, each.found)
        note = f" ({each.note})" if each.note else ""
        interest = f"a loss of {each.contrast.interest:g}" if each.contrast.loss else f"{each.contrast.interest:g}"
        yield f"| {each.contrast.name} | {said}{note} | {interest} {UNITS[each.contrast.measure]} | {each.verdict} |"


def shown(contrast: Contrast, found: Difference) -> str:
    """A difference with its interval, and from how much it is."""
    runs = f", {found.runs} runs" if found.runs > 1 else ""
    digits = "+.2f" if contrast.measure is not Measure.GOALS else "+.1f"
    said = f"{found.estimate:{digits}} ({found.low:{digits}} to {found.high:{digits}}), N = {found.n}{runs}"
    return said.replace("inf", "∞")


def _many_goals(found: Findings) -> Iterator[str]:
    if found.experiment.many_goals is None:
        return
    yield "| cell | robots | mean ± deviation | median | sorted trials | ended by |"
    yield "|---|---|---|---|---|---|"
    if not found.in_a_row:
        yield "| all | | not run yet | | | |"
    for each in found.in_a_row:
        said, ends = each.summary, _ends(each.ended)
        trials = " ".join(map(str, said["sorted"]))
        mean = f"{said['mean']:.1f} ± {said['deviation']:.1f}"
        yield f"| `{each.cell}` | {each.physics} | {mean} | {said['median']:g} | {trials} | {ends} |"
    yield ""


def _ends(ended: Sequence[str]) -> str:
    return ", ".join(f"{kind} {ended.count(kind)}" for kind in dict.fromkeys(sorted(ended)))


def _known(found: Findings) -> Iterator[str]:
    if found.experiment.hidden is None:
        return
    yield "| property of the robot | seed | after | R2, one observation | R2, state of the memory | gain, 80 % interval |"
    yield "|---|---|---|---|---|---|"
    if not found.known:
        yield "| all | | | not run yet | | |"
    for parameter, entries in found.known.items():
        for each in entries:
            yield _known_row(parameter, each)


def _known_row(parameter: str, each: Mapping) -> str:
    gain = f"{each['difference']:+.2f} ({each['low']:+.2f} to {each['high']:+.2f}), N = {each['robots']} robots"
    of = f"{each['of_observation']:.2f} | {each['of_state']:.2f}"
    return f"| `{parameter}` | {each['seed']} | {each['at_s']:g} s | {of} | {gain} |"
