"""The figure of an experiment, readable without its text: axes with units, task, farm and N stated, intervals at 80 %."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.design import Look, Measure, robots_in_words
from experiments.findings import Curve, Findings, Rate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES = (".svg", ".png")
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
"""Okabe and Ito's, for eyes of all kinds; neighbours differ in lightness, too."""
INK, GREY = "#222222", "#777777"
ROBOTS = {"nominal": COLOURS[1], "real": COLOURS[0]}
PANEL_IN, BAR_IN, SMALL_IN, MARGIN_IN, HEIGHT_IN, LEAST_IN = 4.3, 0.62, 2.9, 1.0, 3.9, 6.0
IN_A_ROW_AT_MOST = 3
MILLION = 1e6
TOP = 104
"""Of an axis in per cent: dots and caps at 100 are whole."""

Panel = tuple[Callable[["Axes", Findings], None], float]


def figure_of(found: Findings) -> Figure | None:
    """The figure of what there is; None where nothing is there yet."""
    panels = [*_of_rates(found), *_of_rows(found)]
    if found.curves:
        panels.insert(0, (_curves, PANEL_IN))
    if found.known:
        panels.append((_known, PANEL_IN))
    if not panels:
        return None
    columns = min(len(panels), IN_A_ROW_AT_MOST)
    rows = -(-len(panels) // columns)
    widths = [max(width for _, width in panels[column::columns]) for column in range(columns)]
    figure = Figure(figsize=(max(LEAST_IN, sum(widths)), HEIGHT_IN if rows == 1 else 2.7 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    drawn = figure.subplots(rows, columns, squeeze=False, width_ratios=widths).ravel()
    for (panel, _), axes in zip(panels, drawn, strict=False):
        panel(axes, found)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
    for axes in drawn[len(panels) :]:
        axes.set_visible(False)
    figure.suptitle(found.experiment.title, fontsize=11)
    return figure


def draw(found: Findings, out: Path) -> list[Path]:
    """Write the figure in all its formats; gives the paths, none where nothing is there yet."""
    figure = figure_of(found)
    if figure is None:
        return []
    paths = [out / f"{found.experiment.name}{suffix}" for suffix in SUFFIXES]
    with matplotlib.rc_context({"svg.hashsalt": found.experiment.name}):  # the same findings give the same file
        for path in paths:
            figure.savefig(path, dpi=160, metadata={"Date": None} if path.suffix == ".svg" else None)
    return paths


def _label(found: Findings, cell: str) -> str:
    return found.experiment.cell(cell).shown_as


def _title(axes: "Axes", *lines: str) -> None:
    axes.set_title("\n".join(lines), fontsize=8, color=INK, loc="left")


def _legend_below(axes: "Axes", columns: int = 1) -> None:
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=columns, handlelength=2.6)


def _curves(axes: "Axes", found: Findings) -> None:
    evaluated = {each["trials"] for runs in found.runs.values() for _, run in runs for each in run["evaluations"]}
    goals = "/".join(map(str, sorted(evaluated)))
    judged = any(each.contrast.measure is Measure.SAMPLES_TO for each in found.judged)
    for index, curve in enumerate(found.curves):
        cell = found.experiment.cell(curve.cell)
        look = cell.look or Look(index)
        colour, runs = COLOURS[look.colour % len(COLOURS)], len(curve.success)
        label = f"{cell.shown_as.replace(chr(10), ' ')} ({runs} run{'' if runs == 1 else 's'})"
        x, style = curve.samples / MILLION, "--" if look.dashed else "-"
        axes.plot(x, 100 * curve.success.mean(axis=0), style, color=colour, linewidth=2, label=label, clip_on=False)
        if judged:
            _runs(axes, found, curve, colour)
        else:
            low, high = curve.success.min(axis=0), curve.success.max(axis=0)
            axes.fill_between(x, 100 * low, 100 * high, color=colour, alpha=0.13, linewidth=0)
    counted = ", demonstrations counted" if any(c.training and c.training.demonstrations for c in found.experiment.cells) else ""
    axes.set_ylim(0, TOP)
    axes.set_xlim(left=0)
    axes.set_xlabel(f"samples{counted}, millions", fontsize=9)
    axes.set_ylabel("success on nominal simulated robots, %", fontsize=9)
    task = next(run["settings"].get("task", "") for runs in found.runs.values() for _, run in runs)
    means = (
        f"thick: mean; thin: runs; ring: first at {100 * found.experiment.reaches:.0f} %"
        if judged
        else "line: mean of runs; band: lowest to highest"
    )
    _title(axes, f"while training: {task or found.experiment.name}, {goals} goals a point", means)
    _legend_below(axes)


def _runs(axes: "Axes", found: Findings, curve: Curve, colour: str) -> None:
    """Each run's line, ringed where it first reaches the rate that is asked for."""
    axes.axhline(100 * found.experiment.reaches, color=GREY, linewidth=0.9, linestyle=":")
    for line, (_, arrived) in zip(curve.success, found.arrivals[curve.cell], strict=True):
        axes.plot(curve.samples / MILLION, 100 * line, color=colour, linewidth=0.8, alpha=0.6, clip_on=False)
        if arrived.by is not None:
            reached = 100 * line[list(curve.samples).index(arrived.by)]
            ring = {"ms": 8, "markerfacecolor": "none", "markeredgewidth": 1.6}
            axes.plot(arrived.by / MILLION, reached, "o", color=colour, clip_on=False, zorder=5, **ring)


def _of_rates(found: Findings) -> list[Panel]:
    """A panel for each task that is tried."""
    if found.experiment.trials is None:
        return []
    tasks: dict[str, list[Rate]] = {}
    for each in found.rates:
        tasks.setdefault(found.experiment.cell(each.cell).task or found.experiment.trials.task, []).append(each)
    kinds = len({each.physics for each in found.rates})
    return [
        (partial(_rates, task=task, rates=rates), max(PANEL_IN, MARGIN_IN + BAR_IN * len({r.cell for r in rates}) * kinds**0.5))
        for task, rates in tasks.items()
    ]


def _rates(axes: "Axes", found: Findings, task: str, rates: Sequence[Rate]) -> None:
    trials = found.experiment.trials
    assert trials is not None
    kinds = list(dict.fromkeys(each.physics for each in rates))
    cells = list(dict.fromkeys(each.cell for each in rates))
    width = 0.8 / len(kinds)
    for index, physics in enumerate(kinds):
        of_kind = [each for each in rates if each.physics == physics]
        for each in of_kind:
            at = cells.index(each.cell) + (index - (len(kinds) - 1) / 2) * width
            _bar(axes, each, at, width, label=f"on {robots_in_words(physics)}" if each is of_kind[0] else None)
    sizes = {(each.trials, len(each.of_runs)) for each in rates}
    names = [_label(found, cell) for cell in cells]
    if len(sizes) > 1:
        names = [
            f"{name}\nN = {next(r.trials for r in rates if r.cell == cell)}" for name, cell in zip(names, cells, strict=True)
        ]
    axes.set_xticks(range(len(cells)), names)
    axes.set_xlim(-0.6, len(cells) - 0.4)
    axes.set_ylim(0, TOP)
    axes.set_ylabel("success rate on the farm, %", fontsize=9)
    robots = f"{trials.farms[0].robots} {robots_in_words(*kinds)}"
    several = any(len(each.of_runs) > 1 for each in rates)
    _title(axes, f"{task}, {robots}{_size(sizes)}", f"whiskers: 80 % intervals{'; dots: single runs' if several else ''}")
    if len(kinds) > 1:
        _legend_below(axes, columns=len(kinds))


def _size(sizes: set[tuple[int, int]]) -> str:
    """What all bars are of; nothing where they differ, and each says its own."""
    if len(sizes) > 1:
        return ""
    (trials, runs) = next(iter(sizes))
    return f"; N = {trials} a bar" + (f" ({runs} runs × {trials // runs} goals)" if runs > 1 else "")


def _bar(axes: "Axes", each: Rate, at: float, width: float, label: str | None) -> None:
    low, high = each.interval
    axes.bar(at, 100 * each.rate, width * 0.92, color=ROBOTS.get(each.physics, COLOURS[2]), label=label)
    whiskers = [[100 * max(0.0, each.rate - low)], [100 * max(0.0, high - each.rate)]]
    lines = axes.errorbar(at, 100 * each.rate, whiskers, fmt="none", ecolor=INK, elinewidth=1.2, capsize=4).lines
    for line in (*lines[1], *lines[2]):
        line.set_clip_on(False)
    runs = len(each.of_runs)
    if runs > 1:
        beside = at + width * np.linspace(-0.38, -0.12, runs)  # of the whisker
        dots = {"ms": 5, "markerfacecolor": "white", "markeredgecolor": INK, "markeredgewidth": 1.0}
        axes.plot(beside, [100 * rate for rate in each.of_runs], "o", clip_on=False, zorder=4, **dots)


def _of_rows(found: Findings) -> list[Panel]:
    """A small panel for each cell whose goals in a row are there."""
    cells = list(dict.fromkeys(each.cell for each in found.in_a_row))
    return [(partial(_in_a_row, cell=cell), max(SMALL_IN, PANEL_IN if len(cells) == 1 else 0.0)) for cell in cells]


def _in_a_row(axes: "Axes", found: Findings, cell: str) -> None:
    lines = [_label(found, cell)]
    assert found.experiment.many_goals is not None
    most = found.experiment.many_goals.goals
    for each in (row for row in found.in_a_row if row.cell == cell):
        said = each.summary
        style = "-o" if each.physics == "nominal" else "--s"
        drawn = {"color": ROBOTS.get(each.physics, COLOURS[2]), "ms": 3, "linewidth": 1.3, "clip_on": False}
        axes.plot(np.arange(1, len(each.reached) + 1), said["sorted"], style, label=robots_in_words(each.physics), **drawn)
        lines.append(f"{robots_in_words(each.physics).split()[0]}: median {said['median']:g}, mean {said['mean']:.1f}")
    trials = max(len(each.reached) for each in found.in_a_row if each.cell == cell)
    axes.set_ylim(0, most * TOP / 100)
    axes.set_xlim(0.5, trials + 0.5)
    axes.set_xlabel(f"trial, sorted by goals (N = {trials})", fontsize=8)
    axes.set_ylabel(f"goals in a row, at most {most}", fontsize=8)
    _title(axes, *lines)
    axes.legend(fontsize=7, frameon=False, loc="best")


def _known(axes: "Axes", found: Findings) -> None:
    names = list(found.known)
    last = max(each["at_s"] for entries in found.known.values() for each in entries)
    entries = {name: [each for each in found.known[name] if each["at_s"] == last] for name in names}
    for at, name in enumerate(names):
        for offset, key, colour in ((-0.28, "of_observation", COLOURS[1]), (0.0, "of_state", COLOURS[0])):
            values = [each[key] for each in entries[name]]
            axes.bar(at + offset, np.mean(values), 0.25, color=colour, label=_KNOWN[key] if at == 0 else None)
            beside = at + offset + 0.25 * np.linspace(-0.3, 0.3, len(values) + 2)[1:-1]
            axes.plot(beside, values, "o", ms=4, markerfacecolor="white", markeredgecolor=INK)
        for index, each in enumerate(entries[name]):
            x = at + 0.28 + (index - (len(entries[name]) - 1) / 2) * 0.08
            half = [[max(0.0, each["difference"] - each["low"])], [max(0.0, each["high"] - each["difference"])]]
            label = _KNOWN["difference"] if at == index == 0 else None
            axes.errorbar(x, each["difference"], half, fmt="D", ms=4, color=COLOURS[2], elinewidth=1.2, capsize=2.5, label=label)
    axes.axhline(0, color=GREY, linewidth=0.9)
    axes.set_ylim(min(axes.get_ylim()[0], -0.1), 1.04)
    runs, robots = len({each["seed"] for each in entries[names[0]]}), entries[names[0]][0]["robots"]
    axes.set_xticks(range(len(names)), [name.partition(".")[0].replace("_", "\n") for name in names])
    axes.set_ylabel("held-out R² (0 = nothing, 1 = known)", fontsize=8.5)
    told = f"known of the robot after {last:g} s; N = {robots} robots"
    _title(axes, told, f"whiskers: 80 % intervals; dots and diamonds: {runs} run{'' if runs == 1 else 's'}")
    _legend_below(axes)


_KNOWN = {
    "of_observation": "from one observation",
    "of_state": "from the state of the memory",
    "difference": "gain of both over the observation",
}
