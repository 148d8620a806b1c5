"""A small study that tests write, break and read: two joints, a cube, a voltage."""

import csv
import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.recording import Recording

MODEL = """
<mujoco>
  <worldbody>
    <body name="arm"><joint name="shoulder" axis="0 1 0"/><geom size="0.1"/>
      <body name="rail"><joint name="slider" type="slide"/><geom size="0.1"/></body>
    </body>
    <body name="cube"><freejoint name="cube_free"/><geom type="box" size="0.05 0.05 0.05"/></body>
  </worldbody>
</mujoco>
"""
STUDY = """
title = "two joints and a cube"
model = "model.xml"

[[recording]]
file = "data.csv"

[time]
column = "time"

[joints.shoulder]
position = "q"
velocity = "dq"
torque = "tau"
torque_kind = "measured"
commanded_torque = "tau_cmd"
temperature = "temp"
temperature_unit = "degC"
ambient = 20.0

[joints.slider]
position = "x"
position_unit = "mm"

[objects.block]
body = "cube"
position = ["pos[0]", "pos[1]", "pos[2]"]
quaternion = ["quat[0]", "quat[1]", "quat[2]", "quat[3]"]
quaternion_order = "xyzw"

[signals]
supply_v = { column = "vbat", unit = "mV" }
"""
STEP_S = 0.002


def columns(samples: int = 200, seed: int = 0) -> dict[str, np.ndarray]:
    """Columns of one episode by name."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) * STEP_S
    quaternion = rng.normal(size=(samples, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return {
        "time": time_s,
        "q": np.sin(7.0 * time_s),
        "dq": 7.0 * np.cos(7.0 * time_s),
        "tau": rng.normal(size=samples),
        "tau_cmd": rng.normal(size=samples),
        "temp": 25.0 + time_s,
        "x": 100.0 * np.cos(3.0 * time_s),
        **{f"pos[{axis}]": rng.normal(size=samples) for axis in range(3)},
        **{f"quat[{part}]": quaternion[:, part] for part in range(4)},
        "vbat": 24000.0 + rng.normal(size=samples),
    }


def csv_text(data: dict[str, np.ndarray], separator: str = ",") -> str:
    """Columns as CSV with every digit; NaN is an empty cell."""
    rows = [
        ["" if isinstance(cell, float) and np.isnan(cell) else str(cell) for cell in row]
        for row in zip(*map(np.ndarray.tolist, data.values()), strict=True)
    ]
    return "\n".join(separator.join(row) for row in [list(data), *rows]) + "\n"


def write(path: Path, data: dict[str, np.ndarray]) -> None:
    """Columns as a file of the format that its name says."""
    if path.name.endswith(".csv"):
        path.write_text(csv_text(data))
    elif path.name.endswith(".csv.gz"):
        path.write_bytes(gzip.compress(csv_text(data).encode()))
    elif path.name.endswith(".parquet"):
        pq.write_table(pa.table(data), path)
    else:
        together = {name: column for name, column in data.items() if "[" not in name}
        for name, width in (("pos", 3), ("quat", 4)):
            together[name] = np.column_stack([data[f"{name}[{index}]"] for index in range(width)])
        np.savez(path, **together)


def folder(tmp_path: Path, study: str = STUDY, data: dict[str, np.ndarray] | None = None, name: str = "data.csv") -> Path:
    """A folder with model, data and study.toml, of which the path is returned."""
    (tmp_path / "model.xml").write_text(MODEL)
    write(tmp_path / name, columns() if data is None else data)
    (tmp_path / "study.toml").write_text(study.replace("data.csv", name))
    return tmp_path / "study.toml"


def read(path: Path) -> list[Recording]:
    """All recordings of a study.toml."""
    return read_recordings(load_study_file(path))


def cells(path: Path) -> list[list[str]]:
    """A CSV file's cells, to break one of them."""
    return list(csv.reader(path.read_text().splitlines()))


def put(path: Path, row: int, column: str, text: str) -> None:
    """Write a cell of a CSV file; row 1 is the header."""
    table = cells(path)
    table[row - 1][table[0].index(column)] = text
    path.write_text("\n".join(",".join(line) for line in table) + "\n")
