"""The figure of a comparison: a bar for each job, grouped by task, and the differences, all with their 95 % intervals."""

from pathlib import Path
from typing import TYPE_CHECKING

from api_schemas.comparison import Comparison
from api_schemas.success_rate import SHOWN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIGURE_SUFFIXES = (".svg", ".png", ".pdf")
COLOURS = ("#0b6b66", "#e0a030", "#5a6fb0", "#b0574d", "#7a8b3a", "#8a5f9e")
"""Told apart also by those who see fewer colours, as far as their lightness goes."""
BAR_WIDTH, GROUP_GAP = 0.86, 0.8
LONGEST_NAME = 32


def draw(found: Comparison, path: Path) -> None:
    """Writes the figure; a policy has the same colour in every task.

    Args:
        found: the jobs by task.
        path: of the file; its suffix is its format.
    """
    # Drawing takes a second to load, which commands that draw nothing need not wait for.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    bars = sum(len(task.jobs) for task in found.tasks)
    below = 0.55 + 0.3 * sum(len(task.differences) for task in found.tasks)
    figure = Figure(figsize=(max(4.2, 1.6 + 0.55 * bars), 3.4 + below), layout="constrained")
    FigureCanvasAgg(figure)
    axes, under = figure.subplots(2, 1, height_ratios=(3.4, below))
    _bars(axes, found)
    _differences(under, found)
    axes.set_ylim(0, 100)
    axes.set_ylabel("success rate, %", fontsize=9)
    axes.tick_params(axis="both", labelsize=8)
    axes.tick_params(axis="x", length=0, labelsize=9)
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", fontsize=8, frameon=False, ncols=2 if len(labels) > 3 else 1)
    axes.set_xlabel(f"whiskers: {SHOWN}s (Wilson)", fontsize=7, color="#666666", loc="right")
    figure.savefig(path, dpi=200, metadata={"Date": None} if path.suffix == ".svg" else None)


def _bars(axes: "Axes", found: Comparison) -> None:
    names = list(dict.fromkeys(job.policy_name for task in found.tasks for job in task.jobs))
    left, middles, named = 0.0, [], set()
    for task in found.tasks:
        for at, job in enumerate(task.jobs, start=1):
            low, high = (100 * bound for bound in job.interval_95)
            rate, name = 100 * job.success_rate, job.policy_name
            errors = [[max(0.0, rate - low)], [max(0.0, high - rate)]]
            colour = COLOURS[names.index(name) % len(COLOURS)]
            label = None if name in named else _short(name)
            named.add(name)
            axes.bar(left + at, rate, BAR_WIDTH, color=colour, label=label)
            axes.errorbar(left + at, rate, errors, fmt="none", ecolor="#222222", elinewidth=1.1, capsize=3)
        middles.append(left + (len(task.jobs) + 1) / 2)
        left += len(task.jobs) + GROUP_GAP
    axes.set_xticks(middles, [f"{task.task}\nN = {task.goals}" for task in found.tasks])


def _differences(axes: "Axes", found: Comparison) -> None:
    """What each job did more than the first of its task, in points."""
    several = len(found.tasks) > 1
    words = []
    for task in found.tasks:
        names = {job.job_id: _short(job.policy_name) for job in task.jobs}
        for each in task.differences:
            middle, (low, high) = 100 * each.difference, (100 * bound for bound in each.interval_95)
            errors = [[max(0.0, middle - low)], [max(0.0, high - middle)]]
            axes.errorbar(middle, len(words), xerr=errors, fmt="o", color="#222222", markersize=4, elinewidth=1.1, capsize=3)
            words.append(f"{names[each.other]} − {names[each.first]}" + (f", {task.task}" if several else ""))
    axes.axvline(0, color="#888888", linewidth=0.8)
    axes.set_yticks(range(len(words)), words, fontsize=7)
    axes.set_ylim(len(words) - 0.5, -0.5)
    axes.tick_params(axis="x", labelsize=8)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"difference on the same goals, points; whiskers: {SHOWN}s", fontsize=7, color="#666666", loc="right")
    axes.spines[["top", "right", "left"]].set_visible(False)


def _short(name: str) -> str:
    """A name that the figure has room for, and that no mark-up of matplotlib's is read into."""
    cut = name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"
    return cut.replace("$", r"\$").lstrip("_") or "unnamed"
