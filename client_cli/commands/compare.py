"""``trifarm compare``: two or more jobs on the same goals."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.comparison import (
    CHANCE,
    ComparedRecipe,
    Comparison,
    Difference,
    NotComparableError,
    TaskComparison,
    changed_sides,
    compare,
)
from api_schemas.report import Report
from api_schemas.success_rate import SHOWN
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import counted, note, print_document, print_line
from client_cli.views.comparison_figure import FIGURE_SUFFIXES, draw

MOST_GOALS_SHOWN = 12


def compare_jobs(
    job_ids: Annotated[
        list[str], typer.Argument(metavar="ID...", help="Jobs to compare; the first of each task is the baseline.")
    ],
    fail_if_worse: Annotated[
        bool, typer.Option("--fail-if-worse", help="Exit with 7 if a job is worse than the baseline with p ≤ 0.05.")
    ] = False,
    figure: Annotated[
        list[Path] | None,
        typer.Option("--figure", metavar="FILE", help="Draw the success rates to a .svg, .png or .pdf file; repeatable."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare jobs goal by goal: paired difference with interval, exact p, and goals gained or lost."""
    for path in figure or []:
        if path.suffix not in FIGURE_SUFFIXES:
            raise UsageProblem(f"{path.name} ends in {path.suffix or 'nothing'}; a figure is one of {', '.join(FIGURE_SUFFIXES)}")
    with ApiClient(load_connection(os.environ)) as client:
        reports = [_report(client, job_id) for job_id in job_ids]
    try:
        found = compare(reports)
    except NotComparableError as error:
        raise UsageProblem(str(error)) from error
    for path in figure or []:
        draw(found, path)
        note(f"figure in {path}")
    if as_json:
        print_document(found)
    else:
        print_line("\n".join(_lines(found)))
    if fail_if_worse and any(difference.is_worse for task in found.tasks for difference in task.differences):
        raise typer.Exit(ExitCode.WORSE)


def _report(client: ApiClient, job_id: str) -> Report:
    report = client.known_report(job_id)
    if not isinstance(report, Report):
        raise UsageProblem(f"job {job_id} is an identification, which has no goals to compare")
    return report


def _lines(found: Comparison) -> Iterator[str]:
    for index, task in enumerate(found.tasks):
        if index:
            yield ""
        yield f"{task.task}, {counted(task.goals, 'goal')} in common"
        yield f"  {'job':<16} {'succeeded':>12} {'rate':>6}  {SHOWN:<14} policy"
        for job in task.jobs:
            low, high = job.interval_95
            rate = f"{job.successes} of {job.trials}"
            letters = "" if job.letters is None else f"  [{job.letters}]"
            yield f"  {job.job_id:<16} {rate:>12} {job.success_rate:>6.3f}  {low:.3f}–{high:.3f}    {job.policy_name}{letters}"
        if len(task.jobs) > 2:
            yield "  jobs that share a letter cannot be told apart; any false difference among all of them has a chance of 5 %"
        for recipe in task.recipes:
            yield from _recipe(recipe, task.recipes[0].recipe)
        for position, difference in enumerate(task.differences, start=1):
            yield from _difference(task, difference, position)


def _recipe(found: ComparedRecipe, first: str) -> Iterator[str]:
    low, high = found.interval_95
    over = f"{found.training_seeds} training seeds"
    yield f"  recipe {found.recipe}: rate {found.success_rate:.3f}, {SHOWN} over {over} and goals {low:.3f}–{high:.3f}"
    if found.difference is not None and found.difference_95 is not None:
        low, high = found.difference_95
        yield f"    against {first}: {100 * found.difference:+.1f} points, {SHOWN} {100 * low:+.1f} to {100 * high:+.1f}"


def _difference(task: TaskComparison, found: Difference, position: int) -> Iterator[str]:
    low, high = found.interval_95
    yield ""
    interval = f"{SHOWN} {100 * low:+.1f} to {100 * high:+.1f}"
    yield f"  {found.other} against {found.first}: {100 * found.difference:+.1f} points, {interval}"
    kind = "p at every look" if found.at_every_look else "McNemar's exact p"
    yield f"    {kind} {_p(found.p)}: {_verdict(found)}"
    yield f"    both {found.both}, neither {found.neither}, gained {found.gained}, lost {found.lost}"
    changed = list(changed_sides(task, position))
    for goal in changed[:MOST_GOALS_SHOWN]:
        word = "gained" if goal.succeeded[position] else "lost"
        before, after = ((goal.trials[at], goal.robots[at]) for at in (0, position))
        yield f"    {word:<6}  trial {before[0]} on {before[1]} -> trial {after[0]} on {after[1]}"
    if len(changed) > MOST_GOALS_SHOWN:
        yield f"    and {len(changed) - MOST_GOALS_SHOWN} more; --json lists all"


def _p(p: float) -> str:
    return f"{p:.4f}" if p >= 1e-4 else "< 0.0001"


def _verdict(found: Difference) -> str:
    if found.p > CHANCE:
        return "the difference could be chance"
    return "worse" if found.is_worse else "better"
