"""Pages of the experiments, made of nothing but the kept results: one of each, and one that shows all side by side."""

from collections.abc import Iterator, Sequence

from experiments.catalogue import CATALOGUE, HOURS_AGAIN, HOURS_ALLOWED
from experiments.contrasts import Judged
from experiments.design import Claim, Experiment
from experiments.findings import COMPLETE, Findings
from experiments.fixed import JOBS, fixed
from experiments.judging import Verdict
from experiments.plan import hours, pieces, spoken
from experiments.tables import (
    NOT_RUN,
    arrivals,
    cells,
    contrasts,
    in_a_row,
    known,
    made_by,
    many_goals,
    notes_of,
    rate,
    said_of,
    shown,
)

__all__ = ["experiment_page", "overview", "shown"]
BY_CHANCE = 0.1
"""Share of gains that read as reproduced where there is none: the upper tail of an interval at 80 %."""
HEADINGS = {
    Verdict.REPRODUCED: "Reproduced",
    Verdict.NOT_REPRODUCED: "Not reproduced",
    Verdict.UNDECIDED: "Undecided",
    Verdict.NOT_RUN: "Not run yet",
}
OURS = (Verdict.FOUND, Verdict.NOT_FOUND, Verdict.UNDECIDED, Verdict.NOT_RUN)


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
        *_asked_twice(experiment),
        "",
        "```",
        f"trifarm experiment {experiment.name}{' --quick' if experiment.quick else ''}",
        "```",
        "",
        *fixed(found),
        "",
        *_since(experiment),
        "## What the papers say",
        "",
        *(f"- {claim.text}{f': {claim.figure}' if claim.figure else ''} ({claim.source})" for claim in experiment.claims),
        "",
        f"What is different here: {experiment.limits}",
        "",
        "## What was found",
        "",
    ]
    if figure:
        lines += [f"![{experiment.title}]({experiment.name}.svg)", ""]
    lines += [*cells(found), "", *contrasts(found.judged), "", *arrivals(found), *many_goals(found), *known(found)]
    tables, versions = "\n".join(lines).rstrip(), "\n".join(made_by(found))
    return f"{tables}\n\n{versions}".rstrip() + "\n"


def overview(all_found: Sequence[Findings]) -> str:
    """The page that shows all of them."""
    judged = [(found, each) for found in all_found for each in found.judged]
    passed_over = _passed_over(all_found)
    counted, again = [], []
    for found, each in judged:
        twice = each.contrast.repeats or found.experiment.name in passed_over
        (again if twice else counted).append((found, each))
    claimed = [pair for pair in counted if not pair[1].contrast.ours]
    ours = [pair for pair in counted if pair[1].contrast.ours]
    lines = [
        "# The papers' claims, tried on our farm",
        "",
        "`trifarm experiment NAME` makes these pages from `results/experiments`; a test compares them. Each experiment is one",
        "command, which goes on where the last one stopped: only what is missing is run. Policies that trials still need lie",
        "beside their runs; those of more than 300 kB stay in the work folder of the machine that trained them, and trials run",
        "there.",
        "",
        "Intervals are at 80 %. A gain whose interval lies above 0 is *reproduced*, one whose interval lies below the effect of",
        "interest is *not reproduced*; whatever else is *undecided*, as is what a floor or a ceiling hides. Where the claim is",
        "that little is lost, the interval has to lie above or below that loss. Both sides of farm trials share a farm's four or",
        "sixteen robots: where these differ, an interval is at least as wide as Student's over the robots' differences, and each",
        "page says what sets it. What is asked again with more power counts once all of it is there, and the earlier answer no",
        "more; until then it is the other way round.",
        "",
        "| experiment | what a paper says | its figure | here |",
        "|---|---|---|---|",
        *(_row(found, claim) for found in all_found for claim in found.experiment.claims),
        "",
        _time(all_found),
        "",
        f"Of {len(claimed)} contrasts that a paper claims: {_tally(claimed, tuple(HEADINGS))}.{_known(claimed)} "
        f"{_by_chance(claimed)}",
        "",
    ]
    for kind, heading in HEADINGS.items():
        lines += [f"## {heading}", "", *_sentences(claimed, kind, beside=again), ""]
    lines += ["## Questions of ours", "", f"Of {len(ours)} contrasts that no paper claims: {_tally(ours, OURS)}.", ""]
    lines += [sentence for kind in OURS for sentence in _sentences(ours, kind) if sentence != NOTHING]
    if again:
        lines += ["", "Not counted:", "", *(_sentence(*pair, with_verdict=True) for pair in again)]
    if drawn := [found.experiment for found in all_found if found.has_figure]:
        lines += ["", "## Figures", "", *(f"![({each.letter}) {each.title}]({each.name}.svg)\n" for each in drawn)]
    return "\n".join(lines).rstrip() + "\n"


def _passed_over(all_found: Sequence[Findings]) -> set[str]:
    """Of two experiments that ask the same, the name of the one that does not count."""
    again = [found for found in all_found if found.experiment.again]
    return {each.experiment.again if each.state == COMPLETE else each.experiment.name for each in again}


def _asked_twice(experiment: Experiment) -> Iterator[str]:
    """Where an experiment was asked before with less power, or is asked again with more."""
    if experiment.again:
        yield from ("", f"Asked before with less power: {_link(CATALOGUE[experiment.again])}.")
    for later in CATALOGUE.values():
        if later.again == experiment.name:
            yield from ("", f"Asked again with more power: {_link(later)}.")


def _since(experiment: Experiment) -> Iterator[str]:
    """What was changed or said after the first form of the design, each with its date."""
    if experiment.since:
        yield from ("Since then:", "", *(f"- {each}" for each in experiment.since), "")


def _link(experiment: Experiment) -> str:
    return f"[({experiment.letter}) {experiment.title}]({experiment.name}.md)"


def _row(found: Findings, claim: Claim) -> str:
    experiment = found.experiment
    page = f"{_link(experiment)}: {found.state}" if claim is experiment.claims[0] else f"({experiment.letter})"
    return f"| {page} | {claim.text} ({claim.source}) | {claim.figure or 'none given'} | {_here(found, claim)} |"


def _here(found: Findings, claim: Claim) -> str:
    said = [_answer(found, name) for name in claim.answers]
    return "; ".join(each for each in said if each) or NOT_RUN


def _answer(found: Findings, name: str) -> str:
    """Our number beside the paper's, of a contrast or of a cell; empty where there is none yet."""
    for each in found.judged:
        if each.contrast.name == name:
            return "" if each.found is None else f"{name}: {shown(each.contrast, each.found)}: {_bold(each)}"
    of_farms = [f"{each.physics} farm {rate(each)}" for each in found.rates if each.cell == name]
    in_rows = [f"{each.physics} {in_a_row(each)}" for each in found.in_a_row if each.cell == name]
    return f"`{name}`: {', '.join((*of_farms, *in_rows))}" if of_farms or in_rows else ""


def _bold(each: Judged) -> str:
    return f"**{each.verdict}**{notes_of(each)}"


def _tally(judged: Sequence[tuple[Findings, Judged]], kinds: Sequence[Verdict]) -> str:
    return ", ".join(f"{sum(each.verdict is kind for _, each in judged)} {kind}" for kind in kinds)


def _known(judged: Sequence[tuple[Findings, Judged]]) -> str:
    """Of those that were no test, since their answer was known."""
    known = [each for _, each in judged if each.contrast.known_from]
    tally = ", ".join(f"{sum(each.verdict is kind for each in known)} {kind}" for kind in HEADINGS)
    said = (
        f" The answers of {len(known)} of them were known from an earlier experiment when they were written down ({tally}): they"
    )
    return f"{said} are no test of their claims." if known else ""


def _by_chance(judged: Sequence[tuple[Findings, Judged]]) -> str:
    gains = sum(not each.contrast.loss for _, each in judged)
    return (
        f"{gains} of them are gains: were there no difference in any, about {BY_CHANCE * gains:.1f} at most would still read as "
        f"reproduced by chance alone, each with {BY_CHANCE:.0%}. A contrast of 1 run speaks of these policies only, and of no "
        "others that the same training would make."
    )


NOTHING = "Nothing."
NOTHING_COUNTED = 'Nothing that is counted; what is asked again and not run stands under "Not counted".'


def _sentences(
    judged: Sequence[tuple[Findings, Judged]], kind: Verdict, beside: Sequence[tuple[Findings, Judged]] = ()
) -> list[str]:
    """Those of a verdict; ``beside`` are contrasts that do not count, of which some may not have been run."""
    ours = any(each.contrast.ours for _, each in judged)
    said = [_sentence(found, each, with_verdict=ours) for found, each in judged if each.verdict is kind]
    not_run = kind is Verdict.NOT_RUN and any(each.verdict is kind for _, each in beside)
    return said or [NOTHING_COUNTED if not_run else NOTHING]


def _sentence(found: Findings, each: Judged, *, with_verdict: bool = False) -> str:
    said = f"- ({found.experiment.letter}) {each.contrast.name}"
    if each.found is not None:
        said = f"{said}: {shown(each.contrast, each.found)}"
    if with_verdict:
        return f"{said}: {said_of(each)}"
    return f"{said}{notes_of(each)}"


def _time(all_found: Sequence[Findings]) -> str:
    first, again = (
        hours([piece for found in all_found if bool(found.experiment.again) is later for piece in pieces(found.experiment)], JOBS)
        for later in (False, True)
    )
    said = f"All trainings and trials together are planned to take about {first:.1f} hours on two cores (at most "
    said += f"{HOURS_ALLOWED:g}), those that are asked again about {again:.1f} (at most {HOURS_AGAIN:g})."
    own = [
        run
        for found in all_found
        for cell in found.experiment.cells
        for _, run in (found.runs.get(cell.name, ()) if cell.training is not None else ())
    ]
    if not own:
        return said
    took = sum(run["wall_s"] for run in own) / 3600
    trainings = [cell.training for found in all_found for cell in found.experiment.cells if cell.training is not None]
    begun = ", ".join(dict.fromkeys(each.start.name for each in trainings if each.start is not None))
    return (
        f"{said} The {len(own)} trainings that are kept took {took:.1f} hours, one after the other: as the clock on the wall had "
        f"it on one thread each, mostly two at a time, evaluations included; without `{begun}`, which several go on from, the "
        "recording of demonstrations, the trials on farms and what is measured in simulation."
    )


def _missing(found: Findings) -> str:
    if found.state == COMPLETE:
        return "Everything is there."
    whole, left = pieces(found.experiment), found.left
    still = f"about {spoken(hours(left, JOBS))} on two cores"
    if found.state == "not run yet":
        return f"Nothing of it has been run: {len(left)} pieces of work, {still}."
    said = f"{len(whole) - len(left)} of {len(whole)} pieces of work are done; what is missing takes {still}."
    if not (made := sum(versions.parts - versions.unknown for versions in found.versions.values())):
        return said
    return (
        f"{said} {made} blocks of trials or measurements count as done while the code is that which made them (below); by "
        "another all of them are made anew."
    )
