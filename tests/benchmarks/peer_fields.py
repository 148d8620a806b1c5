"""Every field of the published layouts beside the published environment: ``python -m tests.benchmarks.peer_fields [--out FILE]``.

The published environment (PyBullet, in the environment of its own that ``peer`` makes) is moved by random torques. Our side is
given the joint states and torques that it reports, the true pose of its cube in every millisecond and its goal, and builds the
observations of the same instants: kinematics, corners, quaternions, order and, by our tracker, which image is shown how late. The
force sensors are compared in a press: both robots fall on the table under the same torques. Says why and ends with 0 where the
published environment cannot be had.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from api_schemas.observation import sizes_of
from api_schemas.policy import LAYOUTS
from sim_backend.driver.driver import Command, Measurement, Segment, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.observation import ObservationBuilder, Sight
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c
from tests.benchmarks.peer import PYTHON, ROOT, missing

SEEDS, STEPS = (5, 6, 7), 60
PRESSES_NM = ((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, -0.1, 0.15))
PRESS_STEPS = 100
GIVEN = ("joint_position_rad", "joint_velocity_rad_s", "joint_torque_nm", "fingertip_force", "robot_id")
"""Fields that our side is given as they are, or that are compared in the press; the rest is made of them."""


def theirs(task: str, seed: int, steps: int, torque_nm: tuple[float, ...] = ()) -> dict[str, np.ndarray]:
    """What the published environment shows; see ``peer_fields_episode``."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "fields.npz"
        program = Path(__file__).with_name("peer_fields_episode.py")
        command = [str(PYTHON), "-W", "ignore", str(program), task, str(seed), str(steps), str(out), *map(str, torque_nm)]
        subprocess.run(command, check=True, capture_output=True, env={"PATH": os.environ["PATH"], "HOME": folder})
        with np.load(out) as file:
            return dict(file)


def parts(task: str, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The columns of flat observations by place and field, such as "0 cube_position_world_m"."""
    observation = LAYOUTS[f"rrc2022-{task}-flat"].observation
    columns = np.split(rows, np.cumsum(sizes_of(observation))[:-1], axis=1)
    return {f"{place} {name}": values for place, (name, values) in enumerate(zip(observation, columns, strict=True))}


def ours(task: str, found: dict[str, np.ndarray]) -> np.ndarray:
    """Our observations (steps, n) of the same states."""
    seen = {name.partition(" ")[2]: values for name, values in parts(task, found["flat"]).items()}
    builder, tracker = ObservationBuilder(LAYOUTS[f"rrc2022-{task}-flat"].observation), Tracker()
    position, quat = found["poses"][:, :3], found["poses"][:, [6, 3, 4, 5]]
    goal = Goal(found["goals"][:1, :3], found["goals"][:1, [6, 3, 4, 5]], np.zeros((1, 9)))
    tracker.reset(_measured(seen, 0, position[0], quat[0]))
    rows, at = [], 0
    for index, time in enumerate(found["times"].tolist()):
        tracker.capture(_segment(at, position[at:time], quat[at:time]))
        tracker.deliver(time)
        at = time
        measurement = _measured(seen, index, position[min(time, len(position) - 1)], quat[min(time, len(quat) - 1)])
        sight = Sight(np.array([time]), measurement, tracker.reading(time), goal, found["sent"][index][None].astype(float))
        rows.append(builder.build(sight)[0])
    return np.stack(rows)


def _measured(seen: dict[str, np.ndarray], index: int, position_m: np.ndarray, quat_wxyz: np.ndarray) -> Measurement:
    joints, speeds, torques, forces = (seen[name][index][None].astype(float) for name in GIVEN[:4])
    return Measurement(joints, speeds, torques, joints, speeds, position_m[None], quat_wxyz[None], forces)


def _segment(first: int, position_m: np.ndarray, quat_wxyz: np.ndarray) -> Segment:
    nothing = np.zeros((1, len(position_m), 9))
    return Segment(first, *[nothing] * 8, position_m[None], quat_wxyz[None])  # pyrefly: ignore[bad-argument-count]


def pressed(torque_nm: tuple[float, ...]) -> np.ndarray:
    """Our sensors after the same press, shape (3,)."""
    driver = SimulatedDriver()
    start = Start(c.START_JOINT_POSITION_RAD[None], np.array([[0.0, 0.0, 0.0325]]), np.array([[1.0, 0.0, 0.0, 0.0]]))
    driver.reset(start)
    driver.advance([(Command(np.tile(torque_nm, 3)[None].astype(float)), PRESS_STEPS * 20)])
    force = driver.measure(feel=True).fingertip_force
    assert force is not None
    return force[0]


def compared(task: str, seeds: Sequence[int]) -> dict[str, dict[str, float]]:
    """The largest differences of each field over all seeds, and the largest value, without the first 0.2 s."""
    rows: dict[str, dict[str, float]] = {}
    for seed in seeds:
        found = theirs(task, seed, STEPS)
        late = found["times"] >= 200  # before, the published tracker has no image from before its start
        wanted, got = (parts(task, each[late]) for each in (found["flat"], ours(task, found)))
        for name, values in wanted.items():
            row = rows.setdefault(name, {"largest_difference": 0.0, "largest_value": 0.0, "moves_by": 0.0})
            row["largest_difference"] = max(row["largest_difference"], float(np.abs(values - got[name]).max()))
            row["largest_value"] = max(row["largest_value"], float(np.abs(values).max()))
            row["moves_by"] = max(row["moves_by"], float(np.ptp(values, axis=0).max()))
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Compare, print, keep."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.peer_fields", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, help="also write what was found as JSON")
    parser.add_argument("--tasks", nargs="+", choices=("push", "lift"), default=("push", "lift"))
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--presses", type=int, default=len(PRESSES_NM), help="how many presses are compared")
    asked = parser.parse_args(arguments)
    if (reason := missing(ROOT)) is not None:
        print(f"skipped: {reason}")
        return 0
    document: dict = {"seeds": list(asked.seeds), "periods": STEPS, "given": GIVEN, "fields": {}, "presses": []}
    for task in asked.tasks:
        document["fields"][task] = compared(task, asked.seeds)
        for name, row in document["fields"][task].items():
            print(f"{task} {name:36} differs by {row['largest_difference']:.2g}, moves by {row['moves_by']:.2g}", flush=True)
    for torque_nm in PRESSES_NM[: asked.presses]:
        found = theirs("push", SEEDS[0], PRESS_STEPS, torque_nm)
        their = parts("push", found["flat"])["8 fingertip_force"][-5:].mean(axis=0)
        row = {"torque_nm": torque_nm, "theirs": their.round(3).tolist(), "ours": pressed(torque_nm).round(3).tolist()}
        document["presses"].append(row)
        print(f"press {torque_nm} N m: {row['theirs']} there, {row['ours']} here", flush=True)
    if asked.out:
        asked.out.write_text(json.dumps(document, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
