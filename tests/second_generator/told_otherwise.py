"""Healthy arms whose tables are not what they say.

``python -m tests.second_generator.told_otherwise --seed 47 --index 37 --to DIR --ask FILE``

Nothing is wrong with these arms; their owners' tables are wrong, each in one way that recordings of others have been seen with.
No way may end in a confident name of a cause that is not there. A torque that is a share of what it is said to be is a motor's
constant, so that this name is right. ``trifarm gap study DIR/WAY/study.toml`` asks; ``--ask`` does so for all.
"""

import argparse
import csv
import json
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.signal import butter, lfilter

from tests.second_generator.case import draw_case
from tests.second_generator.folder import write_case
from tests.second_generator.judging import ask

SMOOTHED_ROWS, HELD_ROWS = 7, 5
LIMIT_S = 1800.0
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


@dataclass(frozen=True)
class Table:
    """One recording: names of its columns, its rows, and what the study says of its joints and of the unit of its clock."""

    header: list[str]
    rows: np.ndarray
    joints: dict[str, dict]
    clock_s: float
    model: mujoco.MjModel

    def columns(self, *keys: str) -> list[int]:
        """Those of some channels of all joints, in the order of the joints."""
        return [self.header.index(joint[key]) for key in keys for joint in self.joints.values() if key in joint]

    @property
    def torques(self) -> list[int]:
        """Commanded and measured."""
        return self.columns("commanded_torque", "measured_torque")

    @property
    def step_s(self) -> float:
        """Of its rows."""
        return float(np.median(np.diff(self.rows[:, 0]))) * self.clock_s


def of_torques(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Table], np.ndarray]:
    """A way that changes all torques, shape (s, n)."""

    def changed(table: Table) -> np.ndarray:
        rows = table.rows.copy()
        rows[:, table.torques] = change(rows[:, table.torques])
        return rows

    return changed


def late(torques: np.ndarray) -> np.ndarray:
    """Written three rows after they acted."""
    return np.concatenate([torques[:3], torques[:-3]])


def smoothed(torques: np.ndarray) -> np.ndarray:
    """A moving mean, as a logger makes it afterwards: it is not late."""
    kernel = np.ones(SMOOTHED_ROWS) / SMOOTHED_ROWS
    return np.stack([np.convolve(column, kernel, mode="same") for column in torques.T], axis=1)


def in_steps(torques: np.ndarray) -> np.ndarray:
    """Of a twentieth of the largest one."""
    steps = 0.05 * np.abs(torques).max(axis=0)
    return steps * np.round(torques / steps)


def last_one_off(torques: np.ndarray) -> np.ndarray:
    """By a twentieth of the largest one, always."""
    by = np.zeros(torques.shape[1])
    by[-1] = 0.05 * np.abs(torques[:, -1]).max()
    return torques + by


def last_scaled(torques: np.ndarray) -> np.ndarray:
    """To 0.7 of what it was: a torque constant of 1 / 0.7."""
    by = np.ones(torques.shape[1])
    by[-1] = 0.7
    return torques * by


def crossed(torques: np.ndarray) -> np.ndarray:
    """The last one with a tenth of the first in it, as by wires that lie side by side."""
    by = np.zeros(torques.shape[1])
    by[-1] = 0.1
    return torques + torques[:, :1] * by


def without_gravity(table: Table) -> np.ndarray:
    """Torques less what gravity takes."""
    rows, data, model = table.rows.copy(), mujoco.MjData(table.model), table.model
    for row in rows:
        for name, joint in table.joints.items():
            angle = np.pi / 180.0 if joint.get("position_unit", "rad") == "deg" else 1.0
            reading = row[table.header.index(joint["position"])] - joint.get("zero", 0.0)
            data.qpos[model.joint(name).qposadr[0]] = joint.get("sign", 1) * angle * reading
        mujoco.mj_forward(model, data)
        for name, joint in table.joints.items():
            unit = joint.get("torque_unit", 1.0)
            weight_nm = joint.get("sign", 1) * data.qfrc_bias[model.joint(name).dofadr[0]]
            for key in (key for key in ("commanded_torque", "measured_torque") if key in joint):
                row[table.header.index(joint[key])] -= weight_nm / (1.0 if isinstance(unit, str) else unit)
    return rows


def rows_lost(table: Table) -> np.ndarray:
    """40 ms in the middle, under a clock that goes on."""
    middle, lost = len(table.rows) // 2, max(3, round(0.04 / table.step_s))
    rows = np.delete(table.rows, slice(middle, middle + lost), axis=0)
    rows[:, 0] = table.rows[: len(rows), 0]
    return rows


def stamps_late(table: Table) -> np.ndarray:
    """Each by the size of a normal number of 0.4 rows: positions are of then, and said to be of now."""
    rows, rng = table.rows.copy(), np.random.default_rng(0)
    clock = rows[:, 0]
    then = clock + 0.4 * np.median(np.diff(clock)) * np.abs(rng.standard_normal(len(clock)))
    for i in table.columns("position"):
        rows[:, i] = np.interp(then, clock, table.rows[:, i])
    return rows


def positions_filtered(table: Table) -> np.ndarray:
    """Through a filter of second order at 20 Hz, with the velocities of that."""
    rows, places = table.rows.copy(), table.columns("position")
    begin = rows[0, places]
    filtered = lfilter(*butter(2, min(0.8, 2.0 * table.step_s * 20.0)), rows[:, places] - begin, axis=0) + begin
    rows[:, places] = filtered
    for joint, column in zip(table.joints.values(), filtered.T, strict=True):
        if "velocity" in joint:
            rows[:, table.header.index(joint["velocity"])] = np.gradient(column, table.step_s)
    return rows


def clock_slow(table: Table) -> np.ndarray:
    """It says 1.05 s for a second."""
    return table.rows * np.where(np.arange(len(table.header)) == 0, 1.05, 1.0)


def seldom(table: Table) -> np.ndarray:
    """Rows at 50 Hz of what was recorded more often."""
    return table.rows[:: max(1, round(0.02 / table.step_s))]


def swapped(table: Table) -> np.ndarray:
    """The torques of the first two joints."""
    rows, places = table.rows.copy(), table.columns("commanded_torque")
    rows[:, places[:2]] = rows[:, places[:2]][:, ::-1]
    return rows


def held(*keys: str) -> Callable[[Table], np.ndarray]:
    """A way that writes channels as a logger does that is five times as fast as their sensors; all without keys."""

    def changed(table: Table) -> np.ndarray:
        rows, columns = table.rows.copy(), table.columns(*keys) if keys else range(1, len(table.header))
        for i in columns:
            rows[:, i] = rows[np.arange(len(rows)) // HELD_ROWS * HELD_ROWS, i]
        return rows

    return changed


def torques_missing(table: Table) -> np.ndarray:
    """For a fifth of the time in the middle, while the motors went on."""
    rows, fifth = table.rows.copy(), len(table.rows) // 5
    rows[2 * fifth : 3 * fifth, table.torques] = np.nan
    return rows


def unequal(torques: np.ndarray) -> np.ndarray:
    """All too small, by shares as unlike as those of two motors of a kind."""
    return torques * np.linspace(0.8, 0.785, torques.shape[1])


WAYS: dict[str, Callable[[Table], np.ndarray]] = {
    "at 50 Hz": seldom,
    "clock slow": clock_slow,
    "late torques": of_torques(late),
    "one torque off": of_torques(last_one_off),
    "one torque scaled": of_torques(last_scaled),
    "positions filtered": positions_filtered,
    "positions held": held("position", "velocity"),
    "rows held": held(),
    "rows lost": rows_lost,
    "stamps late": stamps_late,
    "torques crossed": of_torques(crossed),
    "torques 0.5": of_torques(lambda torques: 0.5 * torques),
    "torques 0.8": of_torques(lambda torques: 0.8 * torques),
    "torques 1.73": of_torques(lambda torques: np.sqrt(3.0) * torques),
    "torques 0.8 and 0.785": of_torques(unequal),
    "torques in steps": of_torques(in_steps),
    "torques missing": torques_missing,
    "torques smoothed": of_torques(smoothed),
    "torques swapped": swapped,
    "without gravity": without_gravity,
}


def tell_otherwise(case: Path, way: str, to: Path) -> None:
    """Write a case's folder anew, with its tables changed one way."""
    shutil.copytree(case, to, dirs_exist_ok=True)
    study = tomllib.loads((case / "study.toml").read_text())
    model = mujoco.MjModel.from_xml_path(str(case / study["model"]))
    for path in sorted((to / "recordings").glob("*.csv")):
        header, *lines = csv.reader(path.read_text().splitlines())
        rows = np.array([[float(cell) for cell in line] for line in lines])
        table = Table(header, rows, study["joints"], SECONDS[study["time"].get("unit", "s")], model)
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows([["" if np.isnan(value) else repr(float(value)) for value in row] for row in WAYS[way](table)])


def main(arguments: list[str] | None = None) -> int:
    """The command line; gives the exit code: 0 done, 2 not of this arm."""
    parser = argparse.ArgumentParser(prog="python -m tests.second_generator.told_otherwise", description=__doc__)
    parser.add_argument("--seed", type=int, required=True, help="a development seed")
    parser.add_argument("--index", type=int, required=True, help="of a healthy case whose torques were recorded, in plain CSV")
    parser.add_argument("--to", type=Path, required=True, help="folder that gets a folder for each way")
    parser.add_argument("--way", choices=sorted(WAYS), action="append", help="all without it")
    parser.add_argument(
        "--ask", type=Path, help="ask trifarm gap study about each, and append a line of JSON for it to this file"
    )
    asked = parser.parse_args(arguments)
    case = asked.to / "cases" / write_case(draw_case(asked.seed, "healthy", asked.index), asked.to)
    text = (case / "study.toml").read_text()
    if "commanded_torque" not in text or not list((case / "recordings").glob("*.csv")):
        parser.exit(2, "this arm's torques were not recorded, or its tables are packed: take another index\n")
    for way in asked.way or sorted(WAYS):
        folder = asked.to / way.replace(" ", "-")
        tell_otherwise(case, way, folder)
        print(folder, flush=True)
        if asked.ask is not None:
            row = {"way": way, **ask(folder, asked.to / "answers" / folder.name, ["trifarm"], LIMIT_S), "case": case.name}
            kept = ("way", "case", "exit_code", "verdict", "summary", "causes", "seconds")
            with asked.ask.open("a") as file:
                file.write(json.dumps({key: row.get(key) for key in kept}) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
