"""The residual against whatever it may follow: one plot per quantity, one panel for each joint that matters."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from sim_backend.reality_gap.report.canvas import (
    AFTER,
    BEFORE,
    FAINT,
    Key,
    Panel,
    Plot,
    logarithmic,
    name_axes,
    new_axes,
    to_svg,
)
from sim_backend.reality_gap.report.numbers import axis_unit, column, count
from sim_backend.reality_gap.report.sentences import words

MOST_PANELS = 6
_ORDER = ("velocity", "position", "torque", "time", "time since reversal", "heat")
_STAGES = {"before": (BEFORE, (0, (4, 2))), "after": (AFTER, "solid")}
_SHARED_SPAN = 4.0  # panels share a scale unless the smallest would then fill less than a quarter of it

Series = Mapping[str, Any]


def residual_plots(residuals: Mapping[str, Any] | None) -> list[Plot]:
    """One plot for each quantity that the residual was binned against, in the order of the facts page."""
    by_quantity: dict[str, list[Series]] = {}
    for series in (residuals or {}).get("series") or ():
        if np.isfinite(column(series.get("median"))).any():
            by_quantity.setdefault(words(series["against"]), []).append(series)
    ordered = [name for name in _ORDER if name in by_quantity] + [name for name in by_quantity if name not in _ORDER]
    return [_plot(name, by_quantity[name], residuals or {}) for name in ordered]


def _plot(against: str, series: Sequence[Series], residuals: Mapping[str, Any]) -> Plot:
    joints: dict[str, dict[str, Series]] = {}
    for one in series:
        joints.setdefault(str(one["joint"]), {})[str(one["stage"])] = one
    ranked = sorted(joints, key=lambda joint: -_size(joints[joint]))
    shown = {joint: joints[joint] for joint in ranked[:MOST_PANELS]}
    factor, unit = axis_unit(np.concatenate([_limits(stages) for stages in shown.values()]), words(residuals.get("unit", "")))
    reaches = {joint: float(np.nanmax(np.abs(_limits(stages)), initial=0.0)) * factor for joint, stages in shown.items()}
    common = max(reaches.values()) <= _SHARED_SPAN * min(reaches.values())
    panels = []
    for joint, stages in shown.items():
        reach = max(reaches.values()) if common else reaches[joint]
        panels.append(_panel(against, joint, stages, (factor, unit, reach)))
    return Plot(
        title=f"Residual against {against}",
        caption=_caption(len(shown), len(joints), common, words(residuals.get("band") or "the spread within the bin"), unit),
        panels=tuple(panels),
        legend=(Key("before", "before, nominal model"), Key("after", "after, extended model")),
    )


def _caption(shown: int, joints: int, common: bool, band: str, unit: str) -> str:
    which = f"the {shown} of {joints} joints with the largest residual" if shown < joints else "every joint with such data"
    scale = "one scale for all panels" if common else "each panel has its own scale"
    return (
        f"Line: median of the residual (measured minus model, {unit}) in each bin; shade: {band}; {which}; {scale}. "
        "A right model leaves a line at zero: whatever shape is left shows what the model lacks."
    )


def _panel(against: str, joint: str, stages: Mapping[str, Series], scale: tuple[float, str, float]) -> Panel:
    factor, unit, reach = scale
    figure, axes = new_axes()
    x_unit = words(next(iter(stages.values())).get("x_unit", ""))
    x_all = np.concatenate([column(series.get("x")) for series in stages.values()])
    x_factor, x_unit = axis_unit(x_all, x_unit)
    axes.axhline(0.0, color=FAINT, linewidth=1.0)
    for stage, series in stages.items():
        _draw(axes, stage, column(series["x"]) * x_factor, series, factor)
    if reach > 0.0:
        axes.set_ylim(-1.05 * reach, 1.05 * reach)
    if against == "time since reversal":
        logarithmic(axes, "x", x_all * x_factor, span=50.0)
    name_axes(axes, f"{against} / {x_unit}" if x_unit else against, f"residual / {unit}" if unit else "residual")
    return Panel(to_svg(figure, f"Residual of {words(joint)} against {against}"), heading=words(joint), note=_note(stages))


def _draw(axes: Axes, stage: str, x: np.ndarray, series: Series, factor: float) -> None:
    colour, style = _STAGES.get(stage, (FAINT, "dotted"))
    median = column(series["median"]) * factor
    low, high = (column(series.get(side), len(median)) * factor for side in ("low", "high"))
    axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    alone = np.isfinite(median).sum() < 3
    axes.plot(x, median, color=colour, linestyle=style, marker="o" if alone else None, markersize=4)


def _note(stages: Mapping[str, Series]) -> str:
    series = stages.get("before") or next(iter(stages.values()))
    counts = column(series.get("count"))
    bins = int(np.isfinite(column(series["median"])).sum())
    samples = f"{count(np.nansum(counts))} samples in " if counts.size else ""
    return f"{samples}{bins} bins"


def _limits(stages: Mapping[str, Series]) -> np.ndarray:
    return np.concatenate([column(series.get(side)) for series in stages.values() for side in ("median", "low", "high")])


def _size(stages: Mapping[str, Series]) -> float:
    """Root mean square of the binned residual before (after, where there is no before), weighted by samples."""
    series = stages.get("before") or next(iter(stages.values()))
    median = column(series["median"])
    weights = np.nan_to_num(column(series.get("count") or [1.0] * len(median)))
    weights = np.where(np.isfinite(median), weights, 0.0)
    return float(np.sqrt(np.sum(weights * np.nan_to_num(median) ** 2) / max(weights.sum(), 1e-12)))
