"""The figure of an experiment, readable without its text: axes with units, N stated, intervals at 80 %."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.findings import Findings, InARow, Rate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES = (".svg", ".png")
COLOURS = ("#0b6b66", "#e0a030", "#5a6fb0", "#b0574d", "#7a8b3a", "#8a5f9e")
"""As those of the farm's comparisons: told apart by their lightness, too."""
PANEL_WIDTH_IN, PANEL_HEIGHT_IN, BAR_IN = 4.6, 3.6, 0.55
MILLION = 1e6


def figure_of(found: Findings) -> Figure | None:
    """The figure of what there is; None where nothing is there yet."""
    panels = []
    if found.curves:
        panels.append(_curves)
    if found.rates:
        panels.append(_rates)
    if found.in_a_row:
        panels.append(_in_a_row)
    if found.known:
        panels.append(_known)
    if not panels:
        return None
    bars = len({each.cell for each in found.rates}) * BAR_IN * max(1, len({each.physics for each in found.rates})) ** 0.5
    width = PANEL_WIDTH_IN * len(panels) + max(0.0, bars - PANEL_WIDTH_IN)
    figure = Figure(figsize=(width, PANEL_HEIGHT_IN), layout="constrained")
    FigureCanvasAgg(figure)
    ratios = [max(PANEL_WIDTH_IN, bars) if panel is _rates else PANEL_WIDTH_IN for panel in panels]
    drawn = figure.subplots(1, len(panels), squeeze=False, width_ratios=ratios)[0]
    for panel, axes in zip(panels, drawn, strict=True):
        panel(axes, found)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
    figure.suptitle(found.experiment.title, fontsize=10)
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


def _curves(axes: "Axes", found: Findings) -> None:
    evaluated = {each["trials"] for runs in found.runs.values() for _, run in runs for each in run["evaluations"]}
    for colour, curve in zip(_colours(), found.curves, strict=False):
        x, runs = curve.samples / MILLION, len(curve.success)
        axes.plot(x, 100 * curve.success.mean(axis=0), color=colour, label=f"{curve.cell} (N = {_counted(runs, 'run')})")
        low, high = curve.success.min(axis=0), curve.success.max(axis=0)
        axes.fill_between(x, 100 * low, 100 * high, color=colour, alpha=0.15, linewidth=0)
    axes.set_ylim(0, 100)
    axes.set_xlim(left=0)
    axes.set_xlabel("samples, millions", fontsize=9)
    goals = "/".join(map(str, sorted(evaluated)))
    axes.set_ylabel("success on nominal robots, %", fontsize=9)
    axes.legend(fontsize=7, frameon=False)
    axes.set_title(f"line: mean of runs; band: lowest to highest; {goals} goals a point", fontsize=7, color="#555555")


def _rates(axes: "Axes", found: Findings) -> None:
    kinds = list(dict.fromkeys(each.physics for each in found.rates))
    cells = list(dict.fromkeys(each.cell for each in found.rates))
    width = 0.84 / len(kinds)
    for index, (physics, colour) in enumerate(zip(kinds, _colours(), strict=False)):
        of_kind = [each for each in found.rates if each.physics == physics]
        for each in of_kind:
            at = cells.index(each.cell) + (index - (len(kinds) - 1) / 2) * width
            _bar(axes, each, at, width, colour, label=f"{physics} robots" if each is of_kind[0] else None)
    names = [f"{cell}\nN = {next(each.trials for each in found.rates if each.cell == cell)}" for cell in cells]
    axes.set_xticks(range(len(cells)), names, rotation=0 if len(cells) <= 4 else 40, ha="center" if len(cells) <= 4 else "right")
    axes.set_ylim(0, 100)
    axes.set_ylabel("success rate on the farm, %", fontsize=9)
    axes.set_xlabel("cell (N = trials)", fontsize=8)
    runs = any(len(each.of_runs) > 1 for each in found.rates)
    said = "whiskers: 80 % intervals (Wilson)" + ("; points: single runs" if runs else "")
    axes.set_title(said, fontsize=7, color="#555555")
    axes.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _bar(axes: "Axes", each: Rate, at: float, width: float, colour: str, label: str | None) -> None:
    low, high = each.interval
    axes.bar(at, 100 * each.rate, width * 0.94, color=colour, label=label)
    whiskers = [[100 * max(0.0, each.rate - low)], [100 * max(0.0, high - each.rate)]]
    axes.errorbar(at, 100 * each.rate, whiskers, fmt="none", ecolor="#222222", elinewidth=1.1, capsize=3)
    if len(each.of_runs) > 1:
        axes.plot([at] * len(each.of_runs), [100 * rate for rate in each.of_runs], "o", color="#222222", ms=2.5)


def _in_a_row(axes: "Axes", found: Findings) -> None:
    cells = list(dict.fromkeys(each.cell for each in found.in_a_row))
    for each in found.in_a_row:
        ordered, colour = each.summary, COLOURS[cells.index(each.cell) % len(COLOURS)]
        dashed = each.physics != "nominal"
        axes.plot(
            np.arange(1, len(ordered["sorted"]) + 1),
            ordered["sorted"],
            "--o" if dashed else "-o",
            color=colour,
            ms=2.5,
            label=_row_label(each),
        )
    most = found.experiment.many_goals.goals if found.experiment.many_goals else 0
    axes.set_ylim(0, most * 1.04)
    axes.set_xlabel("trial, sorted by goals", fontsize=9)
    axes.set_ylabel(f"goals in a row (at most {most})", fontsize=9)
    axes.legend(fontsize=6, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _row_label(each: InARow) -> str:
    said = each.summary
    return f"{each.cell}, {each.physics}: mean {said['mean']:.1f}, median {said['median']:g}, N = {len(each.reached)}"


def _known(axes: "Axes", found: Findings) -> None:
    names = list(found.known)
    last = max(each["at_s"] for entries in found.known.values() for each in entries)
    robots = next(iter(found.known.values()))[0]["robots"]
    for at, name in enumerate(names):
        entries = [each for each in found.known[name] if each["at_s"] == last]
        for offset, key, colour in ((-0.2, "of_observation", COLOURS[1]), (0.2, "of_state", COLOURS[0])):
            values = [each[key] for each in entries]
            axes.bar(at + offset, np.mean(values), 0.38, color=colour, label=_KNOWN[key] if at == 0 else None)
            axes.plot([at + offset] * len(values), values, "o", color="#222222", ms=2.5)
        for each in entries:
            half = [[max(0.0, each["difference"] - each["low"])], [max(0.0, each["high"] - each["difference"])]]
            axes.errorbar(at + 0.2, each["of_state"], half, fmt="none", ecolor="#222222", elinewidth=1.0, capsize=3)
    axes.axhline(0, color="#888888", linewidth=0.8)
    axes.set_ylim(min(axes.get_ylim()[0], -0.1), 1.0)
    runs = len({each["seed"] for entries in found.known.values() for each in entries})
    axes.set_xticks(range(len(names)), [name.replace(".", "\n") for name in names])
    axes.set_ylabel(f"held-out R² after {last:g} s (1 = known)", fontsize=9)
    axes.set_xlabel(f"property of the robot (N = {robots} robots, {_counted(runs, 'run')})", fontsize=8)
    axes.set_title("whiskers: 80 % intervals of the state's gain over the observation", fontsize=7, color="#555555")
    axes.legend(fontsize=7, frameon=False, loc="upper left")


_KNOWN = {"of_observation": "from one observation", "of_state": "from the state of the memory"}


def _counted(n: int, word: str) -> str:
    return f"{n} {word}" + ("" if n == 1 else "s")


def _colours() -> Iterable[str]:
    return (COLOURS[index % len(COLOURS)] for index in range(1000))
