"""A report as a PDF for print: figures and methods on the first page, then every trial as text."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from api_schemas.report import Report
from api_schemas.scene_form import told_forms
from api_schemas.signature import Signature
from api_schemas.success_rate import SHOWN, SHOWN_LEVEL, wilson
from api_schemas.tracker import told_trackers
from api_schemas.trial import OutcomeKind
from client_cli.terminal.output import counted
from report_views import error_axis
from report_views.text import render

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

A4_INCHES = (8.27, 11.69)
LINES_ON_A_PAGE = 84
MOST_ROBOTS = 24
INK, SOFT, BAR, GOOD, BAD = "#17201c", "#55615b", "#9ccbc6", "#1f7a4d", "#b3372f"
LEFT, RIGHT = 0.1, 0.92


def write_pdf(report: Report, signature: Signature, path: Path) -> None:
    """Writes the PDF.

    Args:
        report: what it shows.
        signature: the farm's word for the report, which is printed; only the page of ``--html`` can be verified.
        path: of the file.
    """
    # Drawing takes a second to load, which commands that draw nothing need not wait for.
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    # No date of making: the same report gives the same file.
    about = {"Title": f"Report of job {report.job_id}", "Creator": "trifarm", "CreationDate": None}
    with PdfPages(path, metadata=about) as pages:
        first = Figure(figsize=A4_INCHES)
        _first_page(first, report, signature)
        pages.savefig(first)
        for text in _pages(render(report)):
            figure = Figure(figsize=A4_INCHES)
            figure.text(LEFT - 0.03, 0.955, text, va="top", family="monospace", fontsize=7.2, color=INK, parse_math=False)
            pages.savefig(figure)


def _pages(text: str) -> Iterator[str]:
    lines = text.splitlines()
    for first in range(0, len(lines), LINES_ON_A_PAGE):
        yield "\n".join(lines[first : first + LINES_ON_A_PAGE])


def _first_page(figure: "Figure", report: Report, signature: Signature) -> None:
    def say(y: float, text: str, size: float, colour: str = INK, weight: str = "normal") -> None:
        figure.text(LEFT, y, text, fontsize=size, color=colour, weight=weight, va="top", parse_math=False)

    say(0.945, _cut(report.policy_name, 48), 17, weight="bold")
    say(0.918, f"{report.trials} trials of {report.task} · job {report.job_id} · seed {report.seed}", 9, SOFT)
    say(0.885, f"{100 * report.success_rate:.0f} %", 34, weight="bold")
    low, high = (100 * bound for bound in report.interval_95)
    kind = "Wilson" if report.intervals == "wilson" else "confidence sequence"
    say(0.832, f"{report.successes} of {report.trials} succeeded · {SHOWN} {low:.0f}–{high:.0f} % ({kind})", 9.5)
    of_policy = f"{counted(report.policy_faults, 'policy error')} (counted as failures)"
    faults = f"{of_policy} · {counted(report.platform_faults, 'platform error')} (retried, not counted)"
    say(0.814, faults, 8, SOFT)
    say(0.78, f"By robot, with {SHOWN}s", 10, weight="bold")
    height = 0.022 * (min(len(report.per_robot), MOST_ROBOTS) + 1)
    _robots(figure.add_axes((LEFT + 0.13, 0.76 - height, RIGHT - LEFT - 0.13, height)), report)
    below = 0.76 - height - 0.06
    say(below, "How far from the goal the trials ended", 10, weight="bold")
    _errors(figure.add_axes((LEFT, below - 0.15, RIGHT - LEFT, 0.12)), report)
    say(below - 0.21, "Methods and signature", 10, weight="bold")
    for index, (name, value) in enumerate(_methods(report, signature)):
        y = below - 0.237 - 0.0165 * index
        say(y, name, 7.5, SOFT)
        figure.text(LEFT + 0.13, y, value, fontsize=7.5, color=INK, va="top", parse_math=False)


def _robots(axes: "Axes", report: Report) -> None:
    rows = report.per_robot[:MOST_ROBOTS]
    rates = [100 * row.success_rate for row in rows]
    bounds = [[100 * bound for bound in wilson(row.successes, row.trials, SHOWN_LEVEL)] for row in rows]
    errors = [[max(0.0, rate - low) for rate, (low, _) in zip(rates, bounds, strict=True)]]
    errors.append([max(0.0, high - rate) for rate, (_, high) in zip(rates, bounds, strict=True)])
    axes.barh(range(len(rows)), rates, color=BAR, xerr=errors, capsize=2, ecolor=INK, error_kw={"elinewidth": 0.9})
    axes.set_yticks(range(len(rows)), [f"{row.robot}, {row.successes} of {row.trials}" for row in rows], fontsize=7)
    axes.set_xlim(0, 100)
    axes.invert_yaxis()
    axes.tick_params(axis="x", labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def _errors(axes: "Axes", report: Report) -> None:
    for index, row in enumerate(report.per_trial):
        if row.outcome.measures is None:
            continue
        error_mm = error_axis.held_mm(1e3 * row.outcome.measures.final_position_error_m)
        colour = GOOD if row.outcome.kind == OutcomeKind.SUCCEEDED else BAD
        marker = "o" if row.outcome.kind == OutcomeKind.SUCCEEDED else "X"
        axes.plot(error_mm, error_axis.across(index), marker, color=colour, markersize=4, alpha=0.75, markeredgewidth=0)
    axes.set_xscale("log")
    axes.set_xlim(0.8 * error_axis.SMALLEST_MM, 1.25 * error_axis.LARGEST_MM)
    axes.set_xticks(error_axis.TICKS_MM, [str(tick) for tick in error_axis.TICKS_MM])
    axes.minorticks_off()
    axes.set_yticks([])
    axes.tick_params(axis="x", labelsize=7)
    axes.set_xlabel("final position error, mm; circles succeeded, crosses failed", fontsize=7, color=SOFT)
    axes.spines[["top", "right", "left"]].set_visible(False)


def _methods(report: Report, signature: Signature) -> Iterator[tuple[str, str]]:
    yield "policy", report.policy
    yield "robots", f"{len(report.per_robot)}, drawn for each trial by the job's seed"
    if report.jail is not None:
        yield "jail", f"{report.jail.level} ({len(report.jail.layers)} layers)"
    yield "ended", report.ended_at
    yield "form of the scene", told_forms(report.forms)
    if report.trackers:
        yield "tracker", told_trackers(report.trackers)
    yield "versions", ", ".join(f"{name} {value}" for name, value in sorted(report.versions.items()))
    yield "report", f"{signature.report_sha256} (SHA-256)"
    yield "farm's key", signature.key
    half = math.ceil(len(signature.signature) / 2)
    yield "signature", signature.signature[:half]
    yield "", signature.signature[half:]


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"
