"""Small axes that become inline SVG whose colours follow the page, so that one drawing serves light, dark and paper."""

import io
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, LogLocator, MaxNLocator, NullFormatter

from sim_backend.reality_gap.report.numbers import number, power_of_ten

INK, FAINT, GRID = "#000001", "#000002", "#000003"
BEFORE, AFTER, MEASURED = "#000004", "#000005", "#000006"
LIMIT, FLOOR, CELL, ON_CELL = "#000007", "#000008", "#000009", "#00000a"
_VARIABLES = {
    INK: "ink", FAINT: "faint", GRID: "grid", BEFORE: "before", AFTER: "after", MEASURED: "measured",
    LIMIT: "limit", FLOOR: "floor", CELL: "cell", ON_CELL: "on-cell",
}  # fmt: skip
WIDTH, HEIGHT = 400, 250  # of a panel in units of its view box; text is 12 of them, legible at 350 pixels
_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "reality gap", "text.parse_math": False, "axes.unicode_minus": True,
    "font.family": ["DejaVu Sans"], "font.size": 12.0, "axes.edgecolor": FAINT, "axes.linewidth": 0.8, "text.color": INK,
    "axes.labelcolor": INK, "xtick.color": FAINT, "ytick.color": FAINT, "xtick.labelcolor": INK, "ytick.labelcolor": INK,
    "xtick.labelsize": 11.0, "ytick.labelsize": 11.0, "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.8,
    "axes.axisbelow": True, "axes.spines.top": False, "axes.spines.right": False, "figure.dpi": 72.0, "savefig.dpi": 72.0,
    "axes.titlesize": 12.0, "path.simplify": True, "lines.linewidth": 1.8, "axes.facecolor": "none", "figure.facecolor": "none",
}  # fmt: skip
HALO = "halo"  # gid of text that lines may cross: the page draws it with a rim in the colour of the ground
_CLEANING = (
    (re.compile(r"<metadata>.*?</metadata>\s*", re.DOTALL), ""),
    (re.compile(r'<style type="text/css">.*?</style>', re.DOTALL), ""),
    (re.compile(r"<!--.*?-->\s*", re.DOTALL), ""),
    (re.compile(rf'<g id="{HALO}"'), f'<g class="{HALO}"'),
    (re.compile(r'<g id="[a-zA-Z0-9_.]+"'), "<g"),
    (re.compile(r"<use xlink:href="), "<use href="),
    (re.compile(r"font: (\d+px) 'DejaVu Sans'[^;\"]*;?"), r"font-size: \1;"),
    (re.compile(r" *\n *"), "\n"),
)


@dataclass(frozen=True)
class Panel:
    """One drawing with what stands above it as text of the page."""

    svg: str
    heading: str = ""
    note: str = ""


@dataclass(frozen=True)
class Key:
    """One entry of a legend: ``mark`` is a class of the page's style, such as ``before`` (a dashed line)."""

    mark: str
    text: str


@dataclass(frozen=True)
class Plot:
    """Panels under one title, with the sentence that says how to read them and lines of text that belong to them."""

    title: str
    caption: str
    panels: tuple[Panel, ...]
    legend: tuple[Key, ...] = ()
    findings: tuple[str, ...] = ()
    numbered: tuple[str, ...] = ()


@contextmanager
def drawing() -> Iterator[None]:
    """Settings of all drawings, restored afterwards; letters that the measuring font lacks are drawn by the browser."""
    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from font")
        yield


class PlainTicks(Formatter):
    """Labels with as many decimals as the distance of the ticks asks for."""

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """The labels of all ticks of an axis."""
        ticks = np.unique(values)
        step = float(np.diff(ticks).min()) if len(ticks) > 1 else float(np.abs(ticks).max(initial=0.0))
        decimals = max(0, -math.floor(math.log10(step) + 1e-6)) if step > 0.0 else 0
        return [f"{round(float(x), decimals) + 0.0:.{decimals}f}".replace("-", "−") for x in values]

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick alone."""
        del pos
        return self.format_ticks([x])[0]


class PowerTicks(Formatter):
    """Labels of a logarithmic axis: plain numbers from 0.001 to 1000, powers of ten beyond."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of one tick."""
        del pos
        if x == 0.0 or 0.9e-3 < abs(x) < 1.1e3:
            return number(x, 2)
        sign = "−" if x < 0.0 else ""
        mantissa = abs(x) / 10.0 ** math.floor(math.log10(abs(x)) + 1e-9)
        lead = "" if abs(mantissa - 1.0) < 1e-6 else f"{mantissa:.0f}·"
        return f"{sign}{lead}{power_of_ten(math.floor(math.log10(abs(x)) + 1e-9))}"


def new_axes(height: float = HEIGHT, left: float = 50.0, bottom: float = 44.0, top: float = 26.0) -> tuple[Figure, Axes]:
    """Axes with fixed margins, in units of the view box, so that panels beside each other align."""
    figure = Figure(figsize=(WIDTH / 72.0, height / 72.0))
    box = (left / WIDTH, bottom / height, 1.0 - (left + 14.0) / WIDTH, 1.0 - (bottom + top) / height)
    axes = figure.add_axes(box)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(PlainTicks())
    axes.yaxis.set_major_formatter(PlainTicks())
    axes.tick_params(length=3)
    return figure, axes


def name_axes(axes: Axes, x: str, y: str) -> None:
    """What the axes show, with units: x under the axis, y level above its upper end."""
    axes.set_xlabel(x, labelpad=3)
    figure = axes.get_figure(root=True)
    assert figure is not None
    height = figure.get_figheight() * 72.0
    figure.text(6.0 / WIDTH, 1.0 - 6.0 / height, y, va="top", ha="left")


def logarithmic(axes: Axes, which: str, values: np.ndarray, span: float = 30.0) -> bool:
    """Make an axis logarithmic if its values are positive and reach over more than ``span``; says whether it was done."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() <= 0.0 or finite.max() < span * finite.min():
        return False
    getattr(axes, f"set_{which}scale")("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    decades = math.log10(finite.max() / finite.min())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.2 else (1.0,), numticks=6))
    axis.set_major_formatter(PowerTicks())
    axis.set_minor_formatter(NullFormatter())
    return True


def to_svg(figure: Figure, about: str) -> str:
    """The figure as an ``<svg>`` for a page: no ids that repeat, no sizes, colours as variables of the page.

    Args:
        figure: drawn inside ``drawing()``.
        about: what it shows, for those who do not see it.
    """
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": about}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = buffer.getvalue()
    view = re.search(r'viewBox="([^"]+)"', svg)
    assert view is not None
    svg = svg[svg.index(">", svg.index("<svg")) + 1 :].strip()
    for pattern, replacement in _CLEANING:
        svg = pattern.sub(replacement, svg)
    for colour, variable in _VARIABLES.items():
        svg = svg.replace(f": {colour}", f": var(--{variable})")
    return f'<svg viewBox="{view[1]}" role="img" aria-label="{escape(about)}">{svg}'
