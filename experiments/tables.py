"""Tables and numbers of the pages, as Markdown lines."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from api_schemas.success_rate import wilson
from experiments.contrasts import Judged
from experiments.design import UNITS, Contrast, Measure
from experiments.findings import Findings, InARow, Rate
from experiments.judging import LEVEL, Arrival, Difference, Observed, Verdict
from experiments.kept_versions import SET_ASIDE
from experiments.power import power_as_observed
from experiments.result_files import MEASURED, RUNS, TRIALS

NOT_RUN = "not run yet"
THESE_ONLY = {1: "1 run: these policies only"}
THIS_ROBOT = {0: "", 1: ", 1 robot: this one only"}


def shown(contrast: Contrast, found: Difference) -> str:
    """A difference with its interval, and from how many trials and runs it is."""
    digits = "+.2f" if contrast.measure is not Measure.GOALS else "+.1f"
    said = f"{found.estimate:{digits}} ({found.low:{digits}} to {found.high:{digits}})".replace("inf", "∞")
    runs = THESE_ONLY.get(found.runs, f"{found.runs} runs")
    match contrast.measure:
        case Measure.SAMPLES_TO if math.isinf(found.low) and math.isinf(found.high):
            return f"no estimate, {runs} each"
        case Measure.SAMPLES_TO:
            return f"{said}, {_times(found.estimate)} times fewer, {runs} each"
        case Measure.KNOWN:
            return f"{said}, N = {found.n} robots, {runs}"
        case _:
            return f"{said}, N = {found.n} pairs, {runs}{THIS_ROBOT.get(found.robots, f', on {found.robots} robots')}"


def _times(log2: float) -> str:
    times = 2.0**log2
    return f"{times:.0f}" if times >= 10 else f"{times:.2g}"


def cells(found: Findings) -> Iterator[str]:
    """What the cells are, how many of their runs are there, and their success on each farm."""
    experiment = found.experiment
    kinds = list(dict.fromkeys(farm.physics for farm in experiment.trials.farms)) if experiment.trials else []
    yield "| cell | what it is | runs |" + "".join(f" success, {kind} farm |" for kind in kinds)
    yield "|---|---|---|" + "---|" * len(kinds)
    for cell in experiment.cells:
        runs = found.runs.get(cell.name)
        done = "no training" if runs is None else f"{len(runs)} of {len(cell.seeds)}"
        yield f"| `{cell.name}` | {cell.about} | {done} |" + "".join(f" {_rate(found, cell.name, kind)} |" for kind in kinds)
    if found.rates:
        yield ""
        yield (
            "Intervals of success are at 80 %: the widest of Wilson's over trials, with several runs Student's over runs and "
            "over goals, and where robots differ Student's over the farm's robots."
        )


def _rate(found: Findings, cell: str, physics: str) -> str:
    for each in found.rates:
        if (each.cell, each.physics) == (cell, physics):
            return f"{each.successes} of {each.trials}: {rate(each)}"
    return NOT_RUN


def rate(found: Rate) -> str:
    """A success rate with its interval."""
    low, high = found.interval
    return f"{found.rate:.0%} ({low:.0%} to {high:.0%})"


def in_a_row(found: InARow) -> str:
    """Goals in a row as papers have them."""
    said = found.summary
    return f"median {said['median']:g} ({said['mean']:.1f} ± {said['deviation']:.1f})"


def contrasts(judged: Sequence[Judged]) -> Iterator[str]:
    """All contrasts, what was found, and what it says."""
    yield "| contrast | difference, 80 % interval | set by | of interest | verdict |"
    yield "|---|---|---|---|---|"
    for each in judged:
        said = NOT_RUN if each.found is None else shown(each.contrast, each.found)
        of_interest = f"less than {each.contrast.interest:g} lost" if each.contrast.loss else f"{each.contrast.interest:g}"
        whose = " (ours)" if each.contrast.ours else ""
        by = "" if each.found is None else _set_by(each.found)
        yield f"| {each.contrast.name}{whose} | {said} | {by} | {of_interest}, {UNITS[each.contrast.measure]} | {said_of(each)} |"
    yield from _which_interval({each.contrast.measure for each in judged if each.found is not None})
    if any(each.verdict is Verdict.UNDECIDED and each.observed is not None for each in judged):
        yield ""
        yield (
            "Beside what is undecided stands what as many trials would tell by the same rule, were the true difference that of "
            "interest, and the same on all robots: where robots set the interval it is less."
        )


def _set_by(found: Difference) -> str:
    below, above = found.widest
    return below if below is above else f"{below} below, {above} above"


def _which_interval(measures: Collection[Measure]) -> Iterator[str]:
    """Which interval is shown, of each kind of contrast that is there, and why."""
    said = [WHICH_INTERVAL[measure] for measure in Measure if measure in measures]
    if said:
        yield ""
        yield " ".join(said)


WHICH_INTERVAL = {
    Measure.SUCCESS: "Of success the widest interval is shown, and what sets it: Tango's over paired trials; with several runs "
    "also Student's over the runs' and over the goals' mean differences; where robots differ also Student's over the robots' "
    "differences, since both sides share the farm's few robots. Each goal is tried on one robot: what the robots differ by holds "
    "the chance of their goals and trials, and nothing is added up. Nominal robots are alike.",
    Measure.SAMPLES_TO: "Samples are counted on nominal robots, which are alike: the interval is Student's over runs.",
    Measure.GOALS: "Each trial of goals in a row has a robot of its own: Student's interval over trials is one over robots.",
    Measure.KNOWN: "R2 is of robots that were drawn one by one: its interval is over robots, of several runs the lowest and the "
    "highest bound.",
}


def said_of(judged: Judged) -> str:
    """The verdict with what is noted beside it."""
    return f"{judged.verdict}{notes_of(judged)}"


def notes_of(judged: Judged) -> str:
    """What is noted beside a verdict, in brackets; of paired trials that stay undecided also what they could have shown."""
    notes = [judged.note] if judged.note else []
    if judged.verdict is Verdict.UNDECIDED and judged.found is not None and judged.observed is not None:
        notes.append(_power(judged.contrast, judged.found, judged.observed))
    return f" ({'; '.join(notes)})" if notes else ""


def _power(contrast: Contrast, found: Difference, seen: Observed) -> str:
    loss, gain = f"that less than {contrast.interest:g} is lost where nothing is lost", f"a gain of {contrast.interest:g}"
    spread = "" if seen.spread is None else f"trainings spread by {seen.spread:.2f} and "
    changing = "" if seen.changing is None else f", {spread}{seen.changing:.0%} of the goals ending differently"
    power = f"power {power_as_observed(contrast, found, seen):.0%} to tell {loss if contrast.loss else gain}"
    return f"{power}{changing}, as observed"


def arrivals(found: Findings) -> Iterator[str]:
    """Samples to the experiment's rate, run by run."""
    if not found.experiment.curves or not any(each.contrast.measure is Measure.SAMPLES_TO for each in found.judged):
        return
    reaches = f"{100 * found.experiment.reaches:g} %"
    heads = (f"samples to {reaches}, demonstrations counted", "not there yet after")
    successes = ("success of the clone, before PPO, nominal robots", "success at the end, nominal robots")
    yield f"| cell | seed | {' | '.join((*heads, *successes))} |"
    yield "|---|---|---|---|---|---|"
    if not found.arrivals:
        yield f"| all | | {NOT_RUN} | | | |"
    for cell, runs in found.arrivals.items():
        ends = {seed: _ends_of(run["evaluations"]) for seed, run in found.runs.get(cell) or ()}
        for seed, each in runs:
            yield f"| `{cell}` | {seed} | {_arrived(each)} | {_not_yet(each)} | {' | '.join(ends[seed])} |"
    yield ""


def _ends_of(evaluations: Sequence[Mapping]) -> tuple[str, str]:
    """Success before any practice, if that was tried, and at the end."""
    on_nominal = sorted((each for each in evaluations if each["physics"] == "nominal"), key=lambda each: each["samples"])
    first, last = (f"{each['success_rate']:.0%} of {each['trials']}" for each in (on_nominal[0], on_nominal[-1]))
    return first if on_nominal[0]["samples"] == 0 else "", last


def _arrived(each: Arrival) -> str:
    return "never" if each.by is None else f"{each.by:,}"


def _not_yet(each: Arrival) -> str:
    return "there before PPO" if each.before_practice else f"{each.after:,}"


def many_goals(found: Findings) -> Iterator[str]:
    """Goals in a row, cell by cell."""
    if found.experiment.many_goals is None:
        return
    yield "| cell | robots | mean ± deviation | median | sorted trials | ended by |"
    yield "|---|---|---|---|---|---|"
    if not found.in_a_row:
        yield f"| all | | {NOT_RUN} | | | |"
    for each in found.in_a_row:
        said, ends = each.summary, _ends(each.ended)
        trials = " ".join(map(str, said["sorted"]))
        mean = f"{said['mean']:.1f} ± {said['deviation']:.1f}"
        yield f"| `{each.cell}` | {each.physics} | {mean} | {said['median']:g} | {trials} | {ends} |"
    yield ""


def _ends(ended: Sequence[str]) -> str:
    return ", ".join(f"{kind} {ended.count(kind)}" for kind in dict.fromkeys(sorted(ended)))


def known(found: Findings) -> Iterator[str]:
    """What memories know, property by property."""
    if found.experiment.hidden is None:
        return
    names = ("property of the robot", "seed", "after", "R2, one observation", "R2, state of the memory", "R2, both")
    more = ("gain, 80 % interval", "above the mean or not, told by one observation", "told by the state")
    yield f"| {' | '.join((*names, *more))} |"
    yield "|---" * (len(names) + len(more)) + "|"
    if not found.known:
        yield f"| all | | | {NOT_RUN} | | | | | |"
    for parameter, entries in found.known.items():
        for each in entries:
            yield _known_row(parameter, each)


def _known_row(parameter: str, each: Mapping) -> str:
    gain = f"{each['difference']:+.2f} ({each['low']:+.2f} to {each['high']:+.2f}), N = {each['robots']} robots"
    both = f"{each['of_both']:.2f}" if "of_both" in each else ""
    told = " | ".join(_told(each, key) for key in ("told_by_observation", "told_by_state"))
    of = f"{each['of_observation']:.2f} | {each['of_state']:.2f} | {both}"
    return f"| `{parameter}` | {each['seed']} | {each['at_s']:g} s | {of} | {gain} | {told} |"


def _told(each: Mapping, key: str) -> str:
    if key not in each:
        return ""
    low, high = wilson(round(each[key] * each["robots"]), each["robots"], LEVEL)
    return f"{each[key]:.0%} ({low:.0%} to {high:.0%})"


PARTS = {RUNS: "trainings", TRIALS: "blocks of trials", MEASURED: "measurements in simulation"}


def made_by(found: Findings) -> Iterator[str]:
    """Which version of code and physics made what is kept, as far as that is known, and what does not count any more."""
    known = [" and then ".join(map(_version, made)) for made in found.trained_by if made and all(made)]
    yield from (f"- {known.count(told)} {PARTS[RUNS]} by {told}" for told in dict.fromkeys(known))
    if unknown := len(found.trained_by) - len(known):
        yield f"- {unknown} {PARTS[RUNS]}, of an unknown version: they were kept before versions were"
    for kind, versions in found.versions.items():
        told = _version(versions.known)
        begun = f"- {versions.parts} {PARTS[kind]}"
        if not versions.unknown:
            yield f"{begun} by {told}"
        elif not versions.known:
            yield f"{begun}, of an unknown version: they were kept before versions were"
        else:
            yield (
                f"{begun}: {versions.parts - versions.unknown} by {told}; {versions.unknown} of an unknown version, kept before "
                "versions were; whether both are of one version cannot be told"
            )
    if any(found.aside.values()):
        aside = ", ".join(f"{number} {PARTS[kind]}" for kind, number in found.aside.items() if number)
        yield f"- not counted any more, and kept in `results/experiments/{found.experiment.name}/{SET_ASIDE}`: {aside}"


def _version(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in versions.items())
