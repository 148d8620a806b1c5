"""A case as a stranger brings it: ``robot.xml``, tables and ``study.toml``; and, in another folder, what is hidden."""

import gzip
import hashlib
import io
import json
from dataclasses import asdict, dataclass

import numpy as np
import pyarrow as pa
from pyarrow import csv

from tests.second_generator import causes
from tests.second_generator.case import build
from tests.second_generator.seeds import case_rng

MANY_ROWS = 15_000
"""Tables with more rows than this are compressed."""
UNITS = {
    "catalogue": "as in docs/effects.md",
    "outside": "in the parameter's name",
}


@dataclass(frozen=True)
class JointColumns:
    """How the owner writes one joint down: degrees or not, which way it counts, at which reading it is at 0, whose torque."""

    is_degrees: bool
    sign: int
    zero: float
    torque_unit: float


def name_of(seed, kind, index):
    """A case's name, which tells nothing of what is hidden."""
    return "robot-" + hashlib.sha256(f"second generator {seed} {kind} {index}".encode()).hexdigest()[:10]


def is_made(root, seed, kind, index):
    """Whether a case was made to the end: its truth is written last."""
    return (root / "truth" / f"{name_of(seed, kind, index)}.json").is_file()


def write_case(case, root):
    """Write a case below ``root``: ``cases/NAME`` for the tool, ``truth/NAME.json`` for the scorer. Gives the name."""
    name = name_of(case.seed, case.kind, case.index)
    folder = root / "cases" / name
    (folder / "recordings").mkdir(parents=True, exist_ok=True)
    (folder / "robot.xml").write_text(case.declared.mjcf())
    rng = np.random.default_rng([*case_rng(case.seed, case.kind, case.index).integers(2**31, size=2), 5])
    joints = [_draw_columns(rng, case) for _ in case.declared.names]
    ambient = float(round(rng.uniform(18, 28), 1))
    style = {"time": str(rng.choice(["time", "t", "stamp"])), "time_unit": str(rng.choice(["s", "s", "ms", "us"]))}
    files = []
    for i, trace in enumerate(case.traces):
        table = _table(case, trace, joints, style, ambient, rng)
        packed = len(trace.time_s) > MANY_ROWS
        files.append(f"recordings/run_{i + 1}.csv" + (".gz" if packed else ""))
        _write_table(folder / files[-1], table, packed)
    (folder / "study.toml").write_text(_study(case, joints, style, ambient, files))
    (root / "truth").mkdir(exist_ok=True)
    (root / "truth" / f"{name}.json").write_text(json.dumps(truth_of(case), indent=1) + "\n")
    return name


def _draw_columns(rng, case):
    degrees, sign, zero = bool(rng.random() < 0.3), 1, 0.0
    if not case.session.only_targets:
        sign = -1 if rng.random() < 0.15 else 1
        zero = float(np.round(rng.uniform(-0.5, 0.5), 2)) if rng.random() < 0.1 else 0.0
    unit = float(case.declared.gear) if rng.random() < 0.25 else 1.0
    return JointColumns(degrees, sign, zero, unit)


def _table(case, trace, joints, style, ambient, rng):
    """Columns of one recording by name, rounded as a logger would."""
    scale = {"s": (1.0, 6), "ms": (1e3, 3), "us": (1e6, 0)}[style["time_unit"]]
    columns = {style["time"]: np.round(trace.time_s * scale[0], scale[1])}
    torque_noise = case.sensors.torque_noise_share * case.seen.torque_rms_nm
    for j, joint in enumerate(case.declared.names):
        how = joints[j]
        angle = np.degrees(1.0) if how.is_degrees else 1.0
        columns[f"{joint}_pos"] = np.round(how.sign * trace.seen_rad[:, j] * angle + how.zero, 7)
        if case.session.has_velocity:
            columns[f"{joint}_vel"] = np.round(how.sign * trace.seen_rad_s[:, j] * angle, 6)
        if case.session.only_targets:
            columns[f"{joint}_target"] = np.round(trace.target_rad[:, j] * angle, 7)
            columns[f"{joint}_feedforward"] = np.round(trace.desired_nm[:, j] / how.torque_unit, 8)
        else:
            columns[f"{joint}_torque_cmd"] = np.round(how.sign * trace.command_nm[:, j] / how.torque_unit, 8)
        if case.session.has_measured:
            noisy = trace.current_nm[:, j] + torque_noise[j] * rng.standard_normal(len(trace.time_s))
            columns[f"{joint}_torque_meas"] = np.round(how.sign * noisy / how.torque_unit, 8)
        if case.session.has_temperature:
            warm = ambient + trace.heat_k[:, j] + 0.1 * rng.standard_normal(len(trace.time_s))
            columns[f"{joint}_temp"] = np.round(warm, 1)
    return columns


def _write_table(path, columns, packed):
    """A CSV file whose bytes depend on its numbers alone."""
    sink = io.BytesIO()
    csv.write_csv(pa.table(columns), sink, csv.WriteOptions(quoting_style="none"))
    data = sink.getvalue().replace(b'"', b"")
    path.write_bytes(gzip.compress(data, 6, mtime=0) if packed else data)


def _study(case, joints, style, ambient, files):
    """``study.toml`` with what the owner knows."""
    lines = ['title = "arm on my bench"', 'model = "robot.xml"', ""]
    for file, kind in zip(files, case.session.kinds, strict=True):
        lines += ["[[recording]]", f'file = "{file}"', f'regime = "{kind}"', ""]
    lines += ["[time]", f'column = "{style["time"]}"', f'unit = "{style["time_unit"]}"', ""]
    for how, name in zip(joints, case.declared.names, strict=True):
        lines += [f"[joints.{name}]", f'position = "{name}_pos"', f'position_unit = "{"deg" if how.is_degrees else "rad"}"']
        if case.session.has_velocity:
            lines += [f'velocity = "{name}_vel"', f'velocity_unit = "{"deg/s" if how.is_degrees else "rad/s"}"']
        if case.session.only_targets:
            lines += [f'position_target = "{name}_target"', f'desired_torque = "{name}_feedforward"']
        else:
            lines.append(f'commanded_torque = "{name}_torque_cmd"')
        if case.session.has_measured:
            lines.append(f'measured_torque = "{name}_torque_meas"')
        lines.append(f"torque_unit = {how.torque_unit}" if how.torque_unit != 1.0 else 'torque_unit = "N m"')
        if case.session.has_temperature:
            lines += [f'temperature = "{name}_temp"', 'temperature_unit = "degC"', f"ambient = {ambient}"]
        lines += ([f"sign = {how.sign}"] if how.sign < 0 else []) + ([f"zero = {how.zero}"] if how.zero else []) + [""]
    if case.session.only_targets:
        stated = (case.session.stiffness, case.session.damping, case.declared.torque_limit_nm)
        rows = list(zip(case.declared.names, *stated, strict=True))
        lines += ["[controller]", 'kind = "pd"']
        for key, column in (("stiffness", 1), ("damping", 2), ("torque_limit", 3)):
            lines.append(f"{key} = {{ " + ", ".join(f"{row[0]} = {float(row[column])!r}" for row in rows) + " }")
    return "\n".join(lines).rstrip() + "\n"


DECLARED_TOO = {"coulomb_friction": "frictionloss_nm", "viscous_friction": "damping_nm_s_rad", "rotor_inertia": "armature_kg_m2"}
"""Effects whose values count together with what the MJCF says (docs/reality-gap.md)."""


def truth_of(case):
    """What is hidden in a case, for the scorer: names, places, parameters (SI), and how far each cause can be seen."""
    _, values = build(case.true, case.sensors, case.causes, case.seen)
    hidden = []
    for cause, each in zip(case.causes, values, strict=True):
        entries = []
        for j, parameters in each.items():
            link = case.declared.links[j] if j is not None else None
            more = getattr(link, DECLARED_TOO[cause.name]) if cause.name in DECLARED_TOO else 0.0
            entries.append(
                {
                    "where": None if j is None else case.declared.names[j],
                    "parameters": _plain(parameters),
                    "declared": more,
                }
            )
        hidden.append(
            {
                "effect": "outside" if cause.is_outside else cause.name,
                "law": cause.name,
                "same_physics": list(causes.SAME_PHYSICS.get(cause.name, ())),
                "places": entries,
                "units": UNITS["outside" if cause.is_outside else "catalogue"],
                "visibility": round(cause.visibility, 3),
            }
        )
    left_out = {"shapes", "amplitude", "stiffness", "damping"}
    session = {key: value for key, value in asdict(case.session).items() if key not in left_out}
    about = {"joints": case.declared.joints, "joint_names": list(case.declared.names), "rate_hz": 1 / case.session.period_s}
    about |= _plain(session)
    return {"seed": case.seed, "kind": case.kind, "index": case.index, "causes": hidden, "session": about}


def _plain(parameters):
    """Numbers and lists that JSON knows."""
    return {key: value.tolist() if isinstance(value, np.ndarray | np.generic) else value for key, value in parameters.items()}
