"""Plots that put things in a row: ranked gains, the ladder of causes, success rates; and which causes look alike."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim_backend.reality_gap.report.canvas import (
    AFTER,
    BEFORE,
    CELL,
    FAINT,
    FLOOR,
    GRID,
    HALO,
    INK,
    LIMIT,
    MEASURED,
    ON_CELL,
    WIDTH,
    Key,
    Panel,
    Plot,
    PowerTicks,
    new_axes,
    to_svg,
)
from sim_backend.reality_gap.report.numbers import (
    axis_unit,
    column,
    count,
    interval,
    number,
    percent,
    quantity,
    real,
    with_unit,
)
from sim_backend.reality_gap.report.sentences import label_name, words

MOST_ROWS = 40
ALIKE = 0.95  # cosine above which two causes are confusable with these data (reality-gap facts)
_LETTERS = 54  # of a label that fit on one line above its bar
_LINE, _BAR = 14.0, 24.0  # heights of one line of a label and of what stands under it
_DASHES, _DOTS = (0, (4, 2)), (0, (1, 1.5))
_FAR = 50.0  # the largest gain over the null's line above which the axis becomes logarithmic
_STAGE_COLOURS = {"nominal": BEFORE, "extended": AFTER, "measured": MEASURED}

Section = Mapping[str, Any]


def ranking_plot(ranking: Section | None) -> list[Plot]:
    """Held-out gain of every hypothesis that was fitted, the best on top."""
    rows = sorted(_with_real((ranking or {}).get("rows"), "gain"), key=_gain)
    if not ranking or not rows:
        return []
    shown, unit = rows[:MOST_ROWS], words(ranking.get("unit", ""))
    null, floor = real(ranking.get("line")), real(ranking.get("noise_floor"))
    is_null = bool(ranking.get("line_is_null_99"))
    line = "99 % line of the null" if is_null else "a cause must gain as much"
    beyond = (
        "the best of all hypotheses does in 99 of 100 healthy sessions" if is_null else "chance may (no healthy sessions known)"
    )
    figure, axes = _rows_axes([label_name(row["label"]) for row in shown])
    for place, row in enumerate(shown):
        colour = AFTER if null is None or row["gain"] > null else FAINT
        ends = interval(row.get("interval_90"))
        if ends:
            axes.plot(ends, [place, place], color=colour, linewidth=2.2, solid_capstyle="butt")
        axes.plot([row["gain"]], [place], "o", color=colour, markersize=6)
    axes.axvline(0.0, color=FAINT, linewidth=1.0)
    keys = [Key("dot-after", "gain with its 90 % interval"), Key("dot-faint", "the same, not above the line")]
    for at, mark, colour, style, name in (
        (null, "limit", LIMIT, _DASHES, line),
        (floor, "floor", FLOOR, _DOTS, "noise floor: the gain of a perfect model"),
    ):
        if at is not None:
            axes.axvline(at, color=colour, linestyle=style, linewidth=1.6)
            keys.append(Key(mark, f"{name}, {with_unit(number(at), unit)}"))
    stretched = _stretch(axes, [row["gain"] for row in shown], null)
    axes.set_xlabel(f"held-out gain / {unit}", labelpad=3)
    over = sum(null is not None and row["gain"] > null for row in rows)
    first = f"the best {len(shown)} of {len(rows)}" if len(shown) < len(rows) else f"all {len(rows)}"
    caption = (
        f"What each hypothesis gains in held-out log density ({unit}) over the nominal model, {first}"
        f"{'; beyond the dashed line the axis is logarithmic' if stretched else ''}: only what lies right of the dashed line "
        f"gains more than {beyond}."
    )
    note = f"{len(rows)} hypotheses" + (f", {over} above the line" if null is not None else "")
    panel = Panel(to_svg(figure, "Held-out gains of the hypotheses, ranked"), note=note)
    return [Plot("Ranked held-out gains", caption, (panel,), tuple(keys))]


def ladder_plot(ladder: Sequence[Section] | None, verdict: Section, network: Section | None) -> list[Plot]:
    """Held-out error after each cause that was added, down to the floor and to what a flexible network reaches."""
    rungs = _with_real(ladder, "held_out")
    if not rungs:
        return []
    unit, held_out = words(rungs[0].get("unit", "")), verdict.get("held_out") or {}
    floor = real(held_out.get("noise_floor")) if words(held_out.get("unit", "")) == unit else None
    least = real((network or {}).get("held_out")) if words((network or {}).get("unit", "")) == unit else None
    factor, shown_unit = axis_unit(column([rung["held_out"] for rung in rungs]), unit)
    figure, axes = _rows_axes([("+ " if place else "") + label_name(rung["label"]) for place, rung in enumerate(rungs)])
    widest = max(rung["held_out"] * factor for rung in rungs) or 1.0
    for place, rung in enumerate(rungs):
        error = rung["held_out"] * factor
        axes.barh(place, error, height=0.3, color=BEFORE if place == 0 else AFTER)
        _text(axes, error + 0.02 * widest, place, f"{number(error)}{_change(rungs, place)}")
    keys = [Key("bar-before", "nominal model"), Key("bar-after", "with the causes so far")]
    for at, mark, colour, style, name in (
        (least, "limit", LIMIT, _DASHES, "flexible network"),
        (floor, "floor", FLOOR, _DOTS, "noise floor"),
    ):
        if at is not None:
            axes.axvline(at * factor, color=colour, linestyle=style, linewidth=1.6)
            keys.append(Key(mark, f"{name}, {quantity(at, unit)}"))
    axes.set_xlim(0.0, 1.3 * widest)
    axes.set_xlabel(f"held-out error / {shown_unit}" if shown_unit else "held-out error", labelpad=3)
    caption = (
        f"Held-out error ({shown_unit}) after each cause is added to the ones above it: a step that brings little more was "
        "hardly needed; no explanation can get far below the dotted line, the noise of the measurement."
    )
    samples = f" on {count(held_out['samples'])} samples" if real(held_out.get("samples")) is not None else ""
    panel = Panel(to_svg(figure, "Held-out error per added cause"), note=f"{len(rungs)} models{samples}")
    return [Plot("Gain per added cause", caption, (panel,), tuple(keys))]


def success_plot(success: Section | None) -> list[Plot]:
    """Success rates that the models predict beside the measured one."""
    rows = _with_real((success or {}).get("rows"), "rate")
    if not success or not rows:
        return []
    figure, axes = _rows_axes([_STAGE_NAMES.get(row["label"], words(row["label"])) for row in rows])
    for place, row in enumerate(rows):
        colour = _STAGE_COLOURS.get(row["label"], INK)
        ends = interval(row.get("interval_80"))
        if ends:
            axes.plot([100.0 * end for end in ends], [place, place], color=colour, linewidth=3.0, solid_capstyle="butt")
        axes.plot([100.0 * row["rate"]], [place], "o", color=colour, markersize=7)
        right = 100.0 * max(row["rate"], ends[1] if ends else 0.0)
        _text(axes, right + 1.5, place, f"{percent(row['rate'])} %")
    axes.set_xlim(0.0, 114.0)
    axes.set_xticks([0, 25, 50, 75, 100])
    axes.set_xlabel("success rate / %", labelpad=3)
    caption = (
        f"Share of {count(success.get('trials'))} trials that succeed (%), with 80 % intervals: the nearer the extended "
        "model's rate is to the measured one, the better it predicts what a policy does on the robot."
    )
    before, after = real(success.get("gap_before")), real(success.get("gap_after"))
    gaps = () if before is None or after is None else (
        f"Gap to the measured rate: {percent(before)} percentage points before, {percent(after)} after.",
    )  # fmt: skip
    panel = Panel(to_svg(figure, "Success rates"), note=f"{count(success.get('trials'))} trials")
    return [Plot("Success: before, after, measured", caption, (panel,), (), gaps)]


def confusability_plot(confusability: Section | None) -> list[Plot]:
    """Cosines between what the causes do to the data, as a map with numbers for names."""
    labels = [label_name(label) for label in (confusability or {}).get("labels") or ()]
    if not confusability or not labels:
        return []
    cosines = np.array([column(row) for row in confusability["cosines"]])
    size = len(labels)
    figure, axes = new_axes(height=WIDTH - 20.0, left=30.0, bottom=10.0, top=26.0)
    axes.grid(visible=False)
    axes.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5, -0.5), xticks=range(size), yticks=range(size))
    axes.set_xticklabels([str(n + 1) for n in range(size)])
    axes.set_yticklabels([str(n + 1) for n in range(size)])
    axes.xaxis.tick_top()
    axes.tick_params(length=0, labelsize=11 if size <= 16 else 8)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for row, column_ in np.ndindex(cosines.shape):
        _cell(axes, row, column_, float(cosines[row, column_]), size)
    caption = (
        f"Cosine (−1 to 1, a pure number) between the traces that two causes leave in these {size} × {size} pairs, nuisances "
        f"taken out; rows and columns carry the numbers of the list: beyond ± {ALIKE} the data cannot tell the two apart."
    )
    panel = Panel(to_svg(figure, "Confusability of the causes"), note=f"{size} causes")
    legend = (Key("cell", "the stronger the colour, the more alike"),)
    return [Plot("Which causes look alike", caption, (panel,), legend, _alike(labels, cosines), tuple(labels))]


_STAGE_NAMES = {"nominal": "simulated, nominal model", "extended": "simulated, extended model", "measured": "measured"}


def _with_real(rows: Sequence[Section] | None, name: str) -> list[Section]:
    """The rows that have this number, made a plain float."""
    return [{**row, name: real(row[name])} for row in rows or () if real(row.get(name)) is not None]


def _gain(row: Section) -> float:
    return -float(row["gain"])


def _rows_axes(labels: Sequence[str]) -> tuple[Figure, Axes]:
    """Axes with one row for each label, which stands above its row so that it may be as long as the figure is wide.

    A row's bar or interval lies at the row's number; its label fills the upper part of the row.
    """
    wrapped = [_wrapped(label) for label in labels]
    lines = max(len(label) for label in wrapped)
    row = _LINE * lines + _BAR
    figure, axes = new_axes(height=row * len(labels) + 52.0, left=10.0, bottom=46.0, top=6.0)
    above, below = (_LINE * lines + 0.5 * _BAR) / row, 0.5 * _BAR / row
    axes.set_ylim(len(labels) - 1.0 + below, -above)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    for place, label in enumerate(wrapped):
        for line, text in enumerate(label, start=lines - len(label)):
            y = place - above + (line + 0.7) * _LINE / row
            _text(axes, 0.0, y, text, transform=axes.get_yaxis_transform())
        if place:
            axes.axhline(place - above, color=GRID, linewidth=0.8)
    return figure, axes


def _wrapped(label: str) -> list[str]:
    """At most two lines, broken after a blank or a mark; a label that needs more loses its middle."""
    lines = _broken(label)
    if len(lines) > 2:
        lines = _broken(f"{label[: _LETTERS - 14]}…{label[-(_LETTERS - 14) :]}")
    return [line if len(line) <= _LETTERS else f"{line[: _LETTERS - 1]}…" for line in lines[:2]]


def _broken(label: str) -> list[str]:
    lines = [""]
    for piece in re.findall(r"[^\s_/.:-]+[\s_/.:-]*|[\s_/.:-]+", label):
        if lines[-1] and len(lines[-1] + piece.rstrip()) > _LETTERS:
            lines.append("")
        lines[-1] += piece
    return [line.rstrip() for line in lines]


def _text(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:
    axes.text(x, y, text, va="center", ha="left", fontsize=11, gid=HALO, **style)


def _change(rungs: Sequence[Section], place: int) -> str:
    if not place or not rungs[place - 1]["held_out"]:
        return ""
    share = rungs[place]["held_out"] / rungs[place - 1]["held_out"] - 1.0
    return f" ({'+' if share > 0.0 else ''}{percent(share)} %)"


def _stretch(axes: Axes, gains: Sequence[float], null: float | None) -> bool:
    """Make the axis logarithmic beyond the null's line where the best gain would squeeze everything else to one point."""
    if null is None or null <= 0.0 or max(gains) < _FAR * null:
        return False
    axes.set_xscale("symlog", linthresh=null, linscale=0.6)
    powers = np.arange(np.ceil(np.log10(null)), np.floor(np.log10(max(gains))) + 1.0)
    axes.set_xticks([0.0, *(10.0 ** powers[:: max(1, len(powers) // 4 + 1)])])
    axes.xaxis.set_major_formatter(PowerTicks())
    axes.minorticks_off()
    return True


def _cell(axes: Axes, row: int, column_: int, cosine: float, size: int) -> None:
    if not np.isfinite(cosine):
        axes.text(column_, row, "?", ha="center", va="center", color=FAINT, fontsize=9)
        return
    strength = min(abs(cosine), 1.0)
    axes.fill_between([column_ - 0.47, column_ + 0.47], row - 0.47, row + 0.47, color=CELL, alpha=strength**2, linewidth=0)
    if size <= 10:
        text = f"{cosine:.2f}".replace("-", "−").replace("0.", ".", 1) if strength < 0.995 else f"{cosine:.0f}".replace("-", "−")
        axes.text(column_, row, text, ha="center", va="center", fontsize=10, color=ON_CELL if strength > 0.75 else INK)


def _alike(labels: Sequence[str], cosines: np.ndarray) -> tuple[str, ...]:
    pairs = [(abs(cosines[i, j]), i, j) for i in range(len(labels)) for j in range(i + 1, len(labels))]
    close = sorted((pair for pair in pairs if pair[0] > ALIKE), reverse=True)
    if not close:
        return (f"No two of these causes are beyond {ALIKE}: the data can tell them apart.",)
    return tuple(f"{labels[i]} and {labels[j]}: cosine {number(cosines[i, j])}." for _, i, j in close[:MOST_ROWS])
