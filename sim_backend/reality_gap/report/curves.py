"""Plots of one quantity over another: worst window, error against horizon, profile likelihoods, autocorrelation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from sim_backend.reality_gap.report.canvas import (
    AFTER,
    BEFORE,
    FAINT,
    FLOOR,
    LIMIT,
    MEASURED,
    Key,
    Panel,
    Plot,
    logarithmic,
    name_axes,
    new_axes,
    to_svg,
)
from sim_backend.reality_gap.report.numbers import axis_unit, column, count, interval, number, quantity, real
from sim_backend.reality_gap.report.sentences import label_name, words

MOST_PROFILES = 12
_DASHES = (0, (4, 2))
_DOTS = (0, (1, 1.5))
_BEFORE, _AFTER = Key("before", "before, nominal model"), Key("after", "after, extended model")
_DROP_90 = 1.353  # half the 90 % quantile of chi-square with one degree of freedom
_DEEPEST = 8.0  # nats below the top that a profile shows

Section = Mapping[str, Any]


def worst_window_plot(window: Section | None) -> list[Plot]:
    """The held-out stretch where the nominal model is worst: measured and both models over time."""
    if not window:
        return []
    time_s, start = _from_start(column(window["time_s"]))
    lines = {name: column(window.get(name), len(time_s)) for name in ("measured", "before", "after")}
    factor, unit = axis_unit(np.concatenate(list(lines.values())), words(window.get("unit", "")))
    time_factor, time_unit = axis_unit(time_s, "s")
    figure, axes = new_axes()
    axes.plot(time_s * time_factor, lines["measured"] * factor, color=MEASURED, linewidth=4.0, alpha=0.45)
    _before_after(axes, time_s * time_factor, lines["before"] * factor, lines["after"] * factor)
    since = f" since {start:,.2f} s".replace(",", "\u202f") if start else ""
    where = words(window.get("where", ""))
    name_axes(axes, f"time{since} / {time_unit}", unit)
    panel = Panel(to_svg(figure, f"Worst held-out window, {where}"), heading=where, note=f"{count(len(time_s))} samples")
    caption = (
        f"The held-out window with the largest error before ({unit} over time): where the solid line lies on the broad one "
        "and the dashed one does not, the extension explains what was measured."
    )
    return [Plot("Worst held-out window", caption, (panel,), (Key("measured", "measured"), _BEFORE, _AFTER))]


def horizon_plot(horizon: Section | None) -> list[Plot]:
    """How far ahead each model can be trusted."""
    if not horizon:
        return []
    horizon_s = column(horizon["horizon_s"])
    lines = {name: column(horizon.get(name), len(horizon_s)) for name in ("before", "after", "noise_floor")}
    together = np.concatenate(list(lines.values()))
    factor, unit = axis_unit(together, words(horizon.get("unit", "")))
    time_factor, time_unit = axis_unit(horizon_s, "s")
    figure, axes = new_axes()
    x = horizon_s * time_factor
    axes.plot(x, lines["noise_floor"] * factor, color=FLOOR, linestyle=_DOTS)
    _before_after(axes, x, lines["before"] * factor, lines["after"] * factor, marker="o", markersize=3.5)
    logarithmic(axes, "x", x)
    if not logarithmic(axes, "y", together * factor):
        axes.set_ylim(bottom=0.0)
    name_axes(axes, f"horizon / {time_unit}", f"error / {unit}")
    windows = count(horizon.get("windows"))
    panel = Panel(to_svg(figure, "Held-out error against horizon"), note=f"{windows} held-out windows")
    caption = (
        f"Held-out error ({unit}) after running the model freely for the time on the axis: an error that grows with the "
        "horizon comes from the model, one that stays on the dotted line is measurement noise."
    )
    floor = [Key("floor", "noise floor")] if np.isfinite(lines["noise_floor"]).any() else []
    return [Plot("Error against horizon", caption, (panel,), (_BEFORE, _AFTER, *floor))]


def profile_plot(profiles: Sequence[Section] | None) -> list[Plot]:
    """One panel per parameter: how fast the fit gets worse when the parameter is held elsewhere."""
    drawable = [profile for profile in profiles or () if _is_drawable(profile)]
    panels = [_profile(profile) for profile in drawable[:MOST_PROFILES]]
    if not panels:
        return []
    more = len(drawable) - len(panels)
    caption = (
        "Log likelihood (nats below its maximum) with the parameter held at the value on the axis and all others fitted "
        "anew; the shaded values are inside the 90 % interval, above the dashed line: a narrow peak is well determined, "
        "a flat curve is not."
    )
    findings = (
        (f"The first {len(panels)} of {len(drawable)} profiles; the others are in the numbers beside this page.",) if more else ()
    )
    legend = (Key("after", "profile"), Key("limit", "90 % line"), Key("shade", "90 % interval"))
    return [Plot("Profile likelihoods", caption, tuple(panels), legend, findings)]


def _is_drawable(profile: Section) -> bool:
    return bool((np.isfinite(column(profile["value"])) & np.isfinite(column(profile["log_likelihood"]))).any())


def _profile(profile: Section) -> Panel:
    value, likelihood = column(profile["value"]), column(profile["log_likelihood"])
    factor, unit = axis_unit(value, words(profile.get("unit", "")))
    drop = likelihood - np.nanmax(likelihood)
    figure, axes = new_axes(height=220)
    ends = interval(profile.get("interval_90"))
    if ends:
        axes.axvspan(ends[0] * factor, ends[1] * factor, color=AFTER, alpha=0.16, linewidth=0)
    axes.axhline(-_DROP_90, color=LIMIT, linestyle=_DASHES, linewidth=1.4)
    axes.plot(value * factor, drop, color=AFTER, marker="o", markersize=3.5)
    axes.set_ylim(max(float(np.nanmin(drop)) * 1.08, -_DEEPEST), 0.5)
    axes.set_ylim(min(axes.get_ylim()[0], -2.0), 0.5)
    shown = value[np.isfinite(value)] * factor
    if shown.min() < shown.max():
        axes.set_xlim(shown.min(), shown.max())
    name_axes(axes, f"value / {unit}" if unit else "value", "log likelihood / nats")
    label = label_name(profile["label"])
    flat = float(np.nanmin(drop)) > -_DROP_90
    note = f"{count(len(value))} fits" + ("; flat: these data do not bound it here" if flat else "")
    return Panel(to_svg(figure, f"Profile likelihood of {label}"), heading=label, note=note)


def autocorrelation_plot(correlation: Section | None) -> list[Plot]:
    """What of the residual is not noise but repeats itself."""
    if not correlation:
        return []
    lag_s = column(correlation["lag_s"])
    factor, unit = axis_unit(lag_s, "s")
    before, after = (column(correlation.get(stage), len(lag_s)) for stage in ("before", "after"))
    figure, axes = new_axes()
    band = real(correlation.get("band"))
    if band is not None:
        axes.axhspan(-abs(band), abs(band), color=FAINT, alpha=0.22, linewidth=0)
    axes.axhline(0.0, color=FAINT, linewidth=1.0)
    _before_after(axes, lag_s * factor, before, after)
    axes.set_ylim(min(-0.25, 1.1 * np.nanmin(np.concatenate([before, after, [0.0]]))), 1.05)
    name_axes(axes, f"lag / {unit}", "autocorrelation")
    width = f" (± {number(band, 2)})" if band is not None else ""
    caption = (
        f"Correlation of the residual with itself a lag later (a pure number over {unit}): white noise stays inside the grey "
        f"band{width}, so what leaves it is structure that the model still lacks."
    )
    keys = (_BEFORE, _AFTER, *([Key("band", "95 % band of white noise")] if band is not None else []))
    panel = Panel(to_svg(figure, "Autocorrelation of the residual"), note=f"{count(len(lag_s))} lags to {_longest(lag_s)}")
    return [Plot("Autocorrelation of the residual", caption, (panel,), keys)]


def _longest(lag_s: np.ndarray) -> str:
    finite = lag_s[np.isfinite(lag_s)]
    return quantity(finite.max() if finite.size else None, "s")


def _before_after(axes: Axes, x: np.ndarray, before: np.ndarray, after: np.ndarray, **style: Any) -> None:
    axes.plot(x, before, color=BEFORE, linestyle=_DASHES, **style)
    axes.plot(x, after, color=AFTER, **style)


def _from_start(time_s: np.ndarray) -> tuple[np.ndarray, float]:
    """Times from the first on, with the first, where the clock's own numbers are too long for an axis."""
    finite = time_s[np.isfinite(time_s)]
    if not finite.size or abs(finite[0]) < 1000.0 * max(float(np.ptp(finite)), 1e-12):
        return time_s, 0.0
    return time_s - finite[0], float(finite[0])
