"""What a report shows of a study of joints, as plain lists of numbers (parts of ``study.json``)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.quantiles import Z_90, Z_95
from sim_backend.reality_gap.subjects.joints.gain import held_out_errors
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import fitted_values
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.residual_network import network_error_nm
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import Pattern, heat, since_reversal_s
from sim_backend.reality_gap.subjects.joints.verdicts.causes import place_of

_BINS = 16
_SHOWN_JOINTS = 6
_RANKED, _COMPARED = 20, 14
_WINDOW_S = 1.0
_LAGS = 40


def joint_sections(study: JointStudy, patterns: Sequence[Pattern], rng: np.random.Generator) -> dict[str, Any]:
    """All sections of the contract between studies and reports that joints have."""
    before, after = (_errors(study, state) for state in (study.start, study.fit.state))
    worst = _worst_joints(before, study)
    return {
        "residuals": {"unit": "N m", "band": "10 to 90 % of the rows", "series": _series(study, before, after, worst)},
        "worst_window": _worst_window(study, before, worst[0]),
        "ranking": _ranking(study),
        "horizon": _horizon(study, before, after),
        "confusability": _confusability(study),
        "profiles": _profiles(study),
        "autocorrelation": _autocorrelation(study, before, after, worst[0]),
        "ladder": _ladder(study),
        "residual_patterns": [
            {"equation": p.channel.value, "joint": study.problem.names[p.joint], "variable": p.variable, "gain": p.gain}
            for p in patterns[:10]
        ],
        "residual_network": {"held_out": network_error_nm(study.problem.episodes, study.fit.state, rng), "unit": "N m"},
    }


def _errors(study: JointStudy, state: JointState) -> list[np.ndarray]:
    """Torque errors of each episode, (t, k), NaN where a joint rests or the data have gaps."""
    return [np.where(e.valid_mechanics, e.torque_error(state), np.nan) for e in study.problem.episodes]


def _worst_joints(errors: Sequence[np.ndarray], study: JointStudy) -> list[int]:
    joined = np.concatenate(errors)
    size = np.sqrt(np.nansum(joined**2, axis=0) / np.maximum(np.isfinite(joined).sum(axis=0), 1))
    named = [term.index for a in study.fit.accepted for term in a.terms if PARAMETERS[term.key].width == 9]
    order = [*dict.fromkeys(named), *np.argsort(-size).tolist()]
    return [int(j) for j in dict.fromkeys(order)][:_SHOWN_JOINTS]


def _series(
    study: JointStudy, before: Sequence[np.ndarray], after: Sequence[np.ndarray], joints: Sequence[int]
) -> list[dict[str, Any]]:
    found = []
    for against, unit, of in (
        ("velocity", "rad/s", lambda e: e.path.velocity),
        ("position", "rad", lambda e: e.path.position),
        ("torque", "N m", lambda e: e.path.averaged(e.driving_nm).T),
        ("time", "s", lambda e: np.repeat(e.path.time_s[:, None], e.path.position.shape[1], axis=1)),
        ("time since reversal", "s", lambda e: since_reversal_s(e.path.velocity, e.path.step_s * e.path.every)),
        ("heat", "(N m)^2", lambda e: heat(e.path.averaged(e.driving_nm).T, e.path.step_s * e.path.every)),
    ):
        variable = np.concatenate([of(e) for e in study.problem.episodes])
        for joint in joints:
            for stage, errors in (("before", before), ("after", after)):
                binned = _binned(variable[:, joint], np.concatenate(errors)[:, joint])
                found.append({"joint": study.problem.names[joint], "stage": stage, "against": against, "x_unit": unit, **binned})
    return found


def _binned(x: np.ndarray, y: np.ndarray) -> dict[str, list]:
    known = np.isfinite(y)
    x, y = x[known], y[known]
    rows: dict[str, list] = {"x": [], "median": [], "low": [], "high": [], "count": []}
    if len(x) < 2 * _BINS:
        return rows
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1)))
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    for b in range(len(edges) - 1):
        inside = y[place == b]
        if len(inside) < 5:
            continue
        low, median, high = np.quantile(inside, [0.1, 0.5, 0.9])
        for name, value in (("x", np.median(x[place == b])), ("median", median), ("low", low), ("high", high)):
            rows[name].append(float(value))
        rows["count"].append(len(inside))
    return rows


def _worst_window(study: JointStudy, before: Sequence[np.ndarray], joint: int) -> dict[str, Any]:
    """The second in which the nominal model's torque error of the worst joint is largest."""
    episode, best, at = 0, -1.0, 0
    for index, (errors, e) in enumerate(zip(before, study.problem.episodes, strict=True)):
        width = max(4, round(_WINDOW_S / (e.path.step_s * e.path.every)))
        for first in range(0, max(1, len(errors) - width), width // 2):
            size = float(np.nanmean(np.nan_to_num(errors[first : first + width, joint]) ** 2))
            if size > best:
                episode, best, at = index, size, first
    e: EpisodeEquations = study.problem.episodes[episode]
    rows = slice(at, at + max(4, round(_WINDOW_S / (e.path.step_s * e.path.every))))
    torque = e.path.smoothed(e.acting_nm[joint])[rows]
    return {
        "where": f"torque at {study.problem.names[joint]}, {e.path.recording.name}",
        "unit": "N m",
        "time_s": e.path.time_s[rows].tolist(),
        "measured": torque.tolist(),
        "before": _plain(torque - e.torque_error(study.start)[rows, joint]),
        "after": _plain(torque - e.torque_error(study.fit.state)[rows, joint]),
    }


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def _ranking(study: JointStudy) -> dict[str, Any]:
    rows, seen = [], set()
    for candidate in study.fit.first.candidates:
        name = candidate.hypothesis.name
        if name in seen or not candidate.allowed:
            continue
        seen.add(name)
        half = (
            Z_90 * float(np.sqrt(len(candidate.by_fold)) * np.std(candidate.by_fold, ddof=1))
            if len(candidate.by_fold) > 1
            else 0.0
        )
        interval = [candidate.gain - half, candidate.gain + half]
        rows.append({"label": f"{name[0]}, {name[1]}", "gain": candidate.gain, "interval_90": interval})
        if len(rows) == _RANKED:
            break
    null = study.robot.healthy.largest_gains
    line = float(np.quantile(null, 0.99)) if len(null) else study.gate
    return {"unit": "nats", "line": line, "line_is_null_99": bool(len(null)), "noise_floor": None, "rows": rows}


def _horizon(study: JointStudy, before: Sequence[np.ndarray], after: Sequence[np.ndarray]) -> dict[str, Any]:
    """How far a joint would be off after a while for its torque error alone, from the right start; root mean square, mrad."""
    e = study.problem.episodes[0]
    inertia = np.mean(
        np.diagonal(np.concatenate([x.dynamics.by_acceleration for x in study.problem.episodes]), axis1=1, axis2=2), axis=0
    )
    row_s = e.path.step_s * e.path.every
    horizons = [n for n in (4, 8, 16, 32) if n < len(before[0])]
    found: dict[str, list] = {"before": [], "after": []}
    windows = 0
    for n in horizons:
        for stage, errors in (("before", before), ("after", after)):
            size = []
            for episode in errors:
                count = len(episode) // n
                parts = (episode[: count * n] / inertia).reshape(count, n, -1)
                moved = np.cumsum(np.cumsum(parts, axis=1), axis=1)[:, -1] * row_s**2
                size.append(moved[np.isfinite(moved)] ** 2)
            joined = np.concatenate(size)
            windows = max(windows, len(joined))
            found[stage].append(float(1e3 * np.sqrt(joined.mean())) if len(joined) else None)
    return {
        "unit": "mrad",
        "horizon_s": [n * row_s for n in horizons],
        **found,
        "noise_floor": [None] * len(horizons),
        "windows": windows,
    }


def _confusability(study: JointStudy) -> dict[str, Any]:
    look, chosen, seen = study.fit.first, [], set()
    for candidate in look.candidates:
        if candidate.hypothesis.name not in seen and len(candidate.hypothesis.terms) == 1 and candidate.allowed:
            seen.add(candidate.hypothesis.name)
            chosen.append(candidate.hypothesis)
    chosen = chosen[:_COMPARED]
    index = [h.terms[0] for h in chosen]
    images = look.rest.images[np.ix_(index, index)]
    size = np.sqrt(np.maximum(np.diag(images), 1e-30))
    return {"labels": [f"{h.effect}, {h.where}" for h in chosen], "cosines": (images / size[:, None] / size).round(4).tolist()}


def _profiles(study: JointStudy) -> list[dict[str, Any]]:
    """Log likelihood over each accepted number, as the linearised equations at the final model have it."""
    found = []
    for a in study.fit.accepted:
        for fitted in fitted_values(study.start, study.fit.state, a.terms, study.fit.errors[(a.effect, a.where)]):
            if fitted.key not in PARAMETERS or fitted.error <= 0.0:
                continue
            value, error, parameter = fitted.value, fitted.error, PARAMETERS[fitted.key]
            grid = np.linspace(-4.0, 4.0, 17)
            where = place_of(study.problem.names, fitted, a.where)
            found.append(
                {
                    "label": f"{a.effect} {parameter.name}, {where}",
                    "unit": parameter.unit,
                    "value": (value + grid * error).tolist(),
                    "log_likelihood": (-0.5 * grid**2).tolist(),
                    "interval_90": [value - Z_90 * error, value + Z_90 * error],
                }
            )
    return found[:12]


def _autocorrelation(study: JointStudy, before: Sequence[np.ndarray], after: Sequence[np.ndarray], joint: int) -> dict[str, Any]:
    e = study.problem.episodes[0]
    found = {"lag_s": [lag * e.path.step_s * e.path.every for lag in range(_LAGS)]}
    rows = 1
    for stage, errors in (("before", before), ("after", after)):
        series = np.nan_to_num(errors[0][:, joint])
        series = series - series.mean()
        rows = max(1, int(np.isfinite(errors[0][:, joint]).sum()))
        power = float(series @ series) or 1.0
        found[stage] = [float(series[lag:] @ series[: len(series) - lag]) / power for lag in range(_LAGS)]
    return found | {"band": Z_95 / float(np.sqrt(rows))}


def _ladder(study: JointStudy) -> list[dict[str, Any]]:
    rows = []
    for index, look in enumerate(study.fit.looks):
        label = "nominal" if index == 0 else f"{look.accepted[-1].effect}, {look.accepted[-1].where}"
        shown = study.fit.final if index == len(study.fit.looks) - 1 else look
        rows.append({"label": label, "held_out": held_out_errors(study.problem, shown).all_joints_nm, "unit": "N m"})
    return rows
