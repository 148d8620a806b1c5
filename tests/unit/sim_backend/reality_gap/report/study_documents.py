"""Synthetic ``study.json`` documents for the tests of the report: realistic, crowded, and with nothing but a verdict."""

import math
from typing import Any

import numpy as np

HOSTILE = "</script><script>alert('x')</script><b>&\"'$\\frac{1}{2$ \x00\x1b[31m"
JOINTS = tuple(f"finger{finger}_joint_{part}" for finger in (0, 120, 240) for part in ("upper", "middle", "lower"))
AGAINST = {
    "velocity": ("rad/s", -8.0, 8.0),
    "position": ("rad", -1.2, 2.4),
    "torque": ("N m", -0.36, 0.36),
    "time": ("s", 0.0, 60.0),
    "time since reversal": ("s", 0.002, 1.6),
    "heat": ("K", 0.0, 31.0),
}


def verdict(kind: str = "named") -> dict[str, Any]:
    """The verdict of each kind."""
    friction = cause("coulomb_friction", "torque_nm", JOINTS[4], 0.0312, "N m", (0.0274, 0.0351))
    delay = cause("action_delay", "delay_s", "all joints", 0.0031, "s", (0.0027, 0.0036))
    shared = {
        "cannot_tell": ["cube friction, because no recording moves the cube", "joint stiffness against a gravity error"],
        "record_next": ["60 s of slow ramps through zero speed at finger120_joint_middle, 0.01 to 0.05 rad/s"],
        "held_out": held_out(4.13, 1.21, 0.93, (0.66, 0.75)),
        "runner_up": {
            "effect": "stribeck_friction", "where": JOINTS[4], "behind": 7.34,
            "separated_by": "speeds below 0.05 rad/s, of which these data hold 0.4 s",
        },
        "null_p": 0.002, "follows": [], "causes": [friction],
    }  # fmt: skip
    changes: dict[str, dict[str, Any]] = {
        "named": {"summary": "Coulomb friction at finger120_joint_middle explains 91 % of what can be explained."},
        "confusable": {"summary": "Friction and delay fit equally well.", "causes": [friction, delay]},
        "unexplained": {
            "summary": "No cause of the catalogue gains enough.", "causes": [],
            "follows": ["temperature rise of finger0_joint_upper (41 %)", "time since reversal (12 %)"],
        },
        "nothing_wrong": {
            "summary": "", "causes": [], "runner_up": None, "null_p": 0.43,
            "held_out": held_out(0.94, 0.94, 0.93, (-0.01, 0.01)) | {"reduction": 0.0},
        },
        "not_identifiable": {
            "summary": "The robot rests: no joint moves by more than 2 mrad.", "causes": [], "held_out": None,
            "runner_up": None, "null_p": None,
        },
        "calibrated": {
            "summary": "Calibrated 2 numbers by simopt; none of them is made a cause by that.", "causes": [friction, delay],
            "runner_up": None, "null_p": None,
        },
    }  # fmt: skip
    return {"verdict": kind, **shared, **changes[kind]}


def cause(effect: str, parameter: str, where: str, value: Any, unit: str, interval_90: Any) -> dict[str, Any]:
    """One cause as JSON has it."""
    return dict(effect=effect, parameter=parameter, where=where, value=value, unit=unit, interval_90=interval_90)


def held_out(before: float, after: float, floor: float, reduction_interval_95: tuple[float, float]) -> dict[str, Any]:
    """Held-out error in mrad."""
    return {
        "metric": "root mean square of joint position after 0.2 s", "unit": "mrad", "before": before, "after": after,
        "noise_floor": floor, "reduction": 1.0 - after / before, "reduction_interval_95": list(reduction_interval_95),
        "samples": 12480,
    }  # fmt: skip


def small_document(kind: str = "named") -> dict[str, Any]:
    """A document with no optional section."""
    return {"format": 1, "title": "Robot 7, identification logs", "created": "2026-01-02T03:04:05Z", "verdict": verdict(kind)}


def full_document(joints: tuple[str, ...] = JOINTS, against: tuple[str, ...] = tuple(AGAINST), seed: int = 0) -> dict[str, Any]:
    """A document with every section, of a 60 s study."""
    rng = np.random.default_rng(seed)
    return small_document() | {
        "provenance": {"code": "0.1.0", "data": [{"file": f"robot7/{n:03}.mcap", "sha256": f"{n:064x}"} for n in range(4)]},
        "recordings": [
            {"name": f"episode {n}", "duration_s": 15.0, "samples": 15000, "used_for": "fit" if n < 3 else "held out"}
            for n in range(4)
        ],
        "residuals": {"unit": "N m", "series": [s for joint in joints for s in _residuals(joint, joints, against, rng)]},
        "worst_window": _window(rng),
        "ranking": {"unit": "nats", "line": 11.7, "line_is_null_99": True, "rows": _ranking(12, joints, rng)},
        "horizon": _horizon(),
        "confusability": _confusability(8, joints, rng),
        "profiles": [_profile("coulomb_friction, " + joints[0], "N m", 0.031, 0.002), _profile("delay", "s", 0.003, 0.004)],
        "autocorrelation": _autocorrelation(),
        "ladder": [
            {"label": "nominal", "held_out": 4.13, "unit": "mrad"},
            {"label": f"coulomb_friction, {joints[0]}", "held_out": 1.43, "unit": "mrad"},
            {"label": "action_delay, all joints", "held_out": 1.21, "unit": "mrad"},
        ],
        "success": {
            "trials": 200, "gap_before": 0.23, "gap_after": 0.02,
            "rows": [
                {"label": "nominal", "rate": 0.92, "interval_80": [0.89, 0.94]},
                {"label": "extended", "rate": 0.71, "interval_80": [0.67, 0.75]},
                {"label": "measured", "rate": 0.69, "interval_80": [0.65, 0.73]},
            ],
        },
        "residual_network": {"held_out": 1.02, "unit": "mrad"},
    }  # fmt: skip


def crowded_document(against: tuple[str, ...] = tuple(AGAINST)) -> dict[str, Any]:
    """Twelve joints with long names, thirty hypotheses, numbers from 1e-12 to 1e9, and holes everywhere."""
    joints = tuple(f"left_arm_of_the_second_robot/shoulder_{n}_rotation_about_the_vertical_axis" for n in range(12))
    rng = np.random.default_rng(1)
    document = full_document(joints, against, seed=1)
    document["title"] = "A study of everything that could be wrong with the left arm of the second robot, in one very long title"
    document["verdict"]["causes"] += [
        cause("contact_stiffness", "stiffness_n_m", "table", 3.21e8, "N/m", [2.9e8, 3.6e8]),
        cause("encoder_offset", "offset_rad", joints[3], 3.1e-7, "rad", [1e-7, 9e-7]),
        cause("encoder_offset", "drift_rad_s", joints[3], math.nan, "rad/s", [None, math.inf]),
        cause("rotor_inertia", "armature_kg_m2", joints[5], 2.3e-5, "kg m²", [1.9e-5, 2.7e-5]),
        cause("torque_constant", "scale", "all joints", 1.042, "", [1.031, 1.053]),
    ]
    document["residuals"]["series"][0]["median"][3] = None
    document["residuals"]["series"][1]["high"] = [math.nan] * len(document["residuals"]["series"][1]["x"])
    document["ranking"]["rows"] = _ranking(30, joints, rng)
    document["ranking"]["rows"][0]["gain"] = 8.4e3
    document["ranking"]["rows"][0]["interval_90"] = [6.9e3, 9.9e3]
    document["ranking"]["rows"][7]["interval_90"] = [None, 4.0]
    document["ranking"]["rows"].append({"label": "failed_fit, " + joints[1], "gain": math.nan, "interval_90": [None, None]})
    document["confusability"] = _confusability(20, joints, rng)
    document["confusability"]["cosines"][2][5] = None
    document["profiles"] = [
        _profile("contact_stiffness, table", "N/m", 3.21e8, 2e7),
        _profile("encoder_offset, " + joints[3], "rad", 3.1e-7, 1e-7),
        {"label": "viscous_friction, " + joints[2], "unit": "N m s/rad", "value": [0.0, 0.001, 0.002],
         "log_likelihood": [-1000.1, -1000.0, -1000.2], "interval_90": [None, None]},
        {"label": "nothing", "unit": "", "value": [None], "log_likelihood": [None], "interval_90": [None, None]},
    ]  # fmt: skip
    window = document["worst_window"]
    window["time_s"] = [1.7e9 + t for t in window["time_s"]]
    window["measured"] = [1e-9 * y if n % 40 else None for n, y in enumerate(window["measured"])]
    window["before"] = [1e-9 * y for y in window["before"]]
    window["after"] = [1e-9 * y for y in window["after"]]
    document["recordings"] = [
        {"name": f"toss {n}", "duration_s": 0.7, "samples": 104, "used_for": "fit and held out by blocks"} for n in range(570)
    ]
    return document


def _residuals(
    joint: str, joints: tuple[str, ...], quantities: tuple[str, ...], rng: np.random.Generator
) -> list[dict[str, Any]]:
    size = 0.031 if joint in joints[4:5] else 0.002 + 0.008 * rng.random()
    return [_series(joint, stage, against, size, rng) for against in quantities for stage in ("before", "after")]


def _series(joint: str, stage: str, against: str, size: float, rng: np.random.Generator) -> dict[str, Any]:
    unit, start, end = AGAINST[against]
    x = np.linspace(start, end, 24)
    shape = {"velocity": np.tanh(2.0 * x), "time since reversal": np.exp(-3.0 * x)}.get(against, np.sin(x))
    median = (size if stage == "before" else 0.05 * size) * shape + 3e-4 * rng.standard_normal(24)
    spread = 0.0015 + 0.2 * size * rng.random(24)
    return {
        "joint": joint, "stage": stage, "against": against, "x_unit": unit, "x": x.tolist(), "median": median.tolist(),
        "low": (median - spread).tolist(), "high": (median + spread).tolist(), "count": rng.integers(40, 900, 24).tolist(),
    }  # fmt: skip


def _window(rng: np.random.Generator) -> dict[str, Any]:
    time_s = np.arange(0.0, 0.5, 0.002)
    measured = 40.0 * np.sin(9.0 * time_s) + 0.6 * rng.standard_normal(len(time_s))
    return {
        "where": f"{JOINTS[4]}, episode 3, 12.4 s to 12.9 s", "unit": "mrad", "time_s": time_s.tolist(),
        "measured": measured.tolist(), "before": (46.0 * np.sin(9.4 * time_s)).tolist(),
        "after": (40.3 * np.sin(9.02 * time_s)).tolist(),
    }  # fmt: skip


def _ranking(rows: int, joints: tuple[str, ...], rng: np.random.Generator) -> list[dict[str, Any]]:
    effects = ("coulomb_friction", "stribeck_friction", "viscous_friction", "directional_friction", "backlash", "link_mass")
    gains = 90.0 * np.exp(-0.45 * np.arange(rows)) - 2.0
    return [
        {"label": f"{effects[n % 6]}, {joints[(4 + n) % len(joints)]}", "gain": float(gain),
         "interval_90": [float(gain - 4.0 - 6.0 * rng.random()), float(gain + 4.0 + 6.0 * rng.random())]}
        for n, gain in enumerate(gains)
    ]  # fmt: skip


def _horizon() -> dict[str, Any]:
    horizon_s = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0])
    return {
        "unit": "mrad", "horizon_s": horizon_s.tolist(), "before": (0.9 + 40.0 * horizon_s**1.4).tolist(),
        "after": (0.9 + 3.0 * horizon_s).tolist(), "noise_floor": [0.9] * 8, "windows": 240,
    }  # fmt: skip


def _confusability(size: int, joints: tuple[str, ...], rng: np.random.Generator) -> dict[str, Any]:
    traces = rng.standard_normal((size, 6))
    traces[1] = traces[0] + 0.1 * rng.standard_normal(6)
    traces /= np.linalg.norm(traces, axis=1, keepdims=True)
    return {
        "labels": [f"stribeck_friction, {joints[n % len(joints)]}" for n in range(size)],
        "cosines": (traces @ traces.T).tolist(),
    }


def _profile(label: str, unit: str, value: float, width: float) -> dict[str, Any]:
    values = np.linspace(value - 4.0 * width, value + 4.0 * width, 17)
    return {
        "label": label, "unit": unit, "value": values.tolist(),
        "log_likelihood": (-21034.0 - 0.5 * ((values - value) / width) ** 2).tolist(),
        "interval_90": [value - 1.645 * width, value + 1.645 * width],
    }  # fmt: skip


def _autocorrelation() -> dict[str, Any]:
    lag_s = np.arange(0.0, 0.4, 0.004)
    before, after = np.exp(-lag_s / 0.08) * np.cos(20.0 * lag_s), np.exp(-lag_s / 0.004)
    return {"lag_s": lag_s.tolist(), "before": before.tolist(), "after": after.tolist(), "band": 0.06}
