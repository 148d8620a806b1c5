"""The figure of a comparison: a bar for each job, grouped by task, with its 80 % interval."""

from pathlib import Path

from api_schemas.comparison import Comparison

FIGURE_SUFFIXES = (".svg", ".png", ".pdf")
COLOURS = ("#0b6b66", "#e0a030", "#5a6fb0", "#b0574d", "#7a8b3a", "#8a5f9e")
BAR_WIDTH = 0.8


def draw(found: Comparison, path: Path) -> None:
    """Writes the figure; policies have the same colour in every task.

    Args:
        found: the jobs by task.
        path: of the file; its suffix is its format.
    """
    # Drawing takes a second to load, which commands that draw nothing need not wait for.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(job.policy_name for task in found.tasks for job in task.jobs))
    bars = sum(len(task.jobs) for task in found.tasks)
    figure = Figure(figsize=(2.2 + 0.8 * bars, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    at, middles = 0.0, []
    for task in found.tasks:
        for index, job in enumerate(task.jobs):
            low, high = job.interval_80
            rate = 100 * job.success_rate
            errors = [[max(0.0, rate - 100 * low)], [max(0.0, 100 * high - rate)]]
            colour = COLOURS[names.index(job.policy_name) % len(COLOURS)]
            axes.bar(at + index, rate, BAR_WIDTH, color=colour, yerr=errors, capsize=4, ecolor="#222222")
            axes.text(
                at + index, -3, _short(job.policy_name), ha="center", va="top", fontsize=7, rotation=20, rotation_mode="anchor"
            )
        middles.append(at + (len(task.jobs) - 1) / 2)
        at += len(task.jobs) + 0.7
    axes.set_xticks(middles, [f"{task.task} (N = {task.goals})" for task in found.tasks])
    axes.tick_params(axis="x", length=0, pad=18)
    axes.set_ylim(0, 100)
    axes.set_ylabel("success rate, %")
    axes.set_title("success rates with 80 % intervals (Wilson)", fontsize=9)
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=200, metadata={"Date": None} if path.suffix == ".svg" else None)


def _short(name: str) -> str:
    return name if len(name) <= 18 else name[:17] + "…"
