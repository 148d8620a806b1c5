"""How long a study of anybody's robot takes: ``python -m tests.benchmarks.study_time --out FILE``.

An arm of three branches with three joints each, without a drop of a TriFinger, follows slow and fast sines for a minute. Three
times it is studied: with nothing wrong, with a friction at one joint, and with a friction at one and a delay at another. What the
progress said before the healthy robots were drawn, and how long they took, stands beside the whole time of each study.
"""

import argparse
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from tests.benchmarks.machine import cores, cpu_model

BRANCHES, JOINTS = 3, 3
NAMES = [f"j{branch}{joint}" for branch in range(BRANCHES) for joint in range(JOINTS)]
LENGTH_M, RADIUS_M, MASS_KG, ARMATURE_KG_M2, FRICTION_NM = 0.25, 0.03, 0.6, 0.002, 0.02
GAIN_NM_RAD, DAMPING_NM_S_RAD, NOISE_RAD = 8.0, 0.4, 5e-5
STEPS_OF_A_ROW = 4
LATE_S, MORE_FRICTION_NM = 0.012, 0.25
LIMIT_S = 300.0
"""Of a study of 60 s and nine joints, on two cores."""


@dataclass(frozen=True)
class Hidden:
    """What one arm has that its model lacks: friction of its second joint, delay of its last one."""

    friction_nm: float = 0.0
    late_s: float = 0.0


CASES = {"healthy": Hidden(), "friction": Hidden(MORE_FRICTION_NM), "friction and delay": Hidden(MORE_FRICTION_NM, LATE_S)}


def arm() -> str:
    """MJCF of the arm as its owner has it."""

    def link(branch: int, joint: int) -> str:
        axis = ("0 0 1", "0 1 0", "0 1 0")[joint]
        place = f"0 0 {0.1 * branch}" if joint == 0 else f"{LENGTH_M} 0 0"
        size = f'mass="{MASS_KG}" diaginertia="{0.5 * MASS_KG * RADIUS_M**2} {_LONG} {_LONG}"'
        inner = link(branch, joint + 1) if joint + 1 < JOINTS else ""
        hinge = f'axis="{axis}" armature="{ARMATURE_KG_M2}" frictionloss="{FRICTION_NM}"'
        inertial = f'<inertial pos="{LENGTH_M / 2} 0 0" {size}/>'
        return f'<body pos="{place}"><joint name="j{branch}{joint}" {hinge}/>{inertial}{inner}</body>'

    bodies = "".join(link(branch, 0) for branch in range(BRANCHES))
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in NAMES)
    option = '<option timestep="0.00025" integrator="implicitfast"><flag contact="disable"/></option>'
    return f"<mujoco>{option}<worldbody>{bodies}</worldbody><actuator>{motors}</actuator></mujoco>"


_LONG = MASS_KG * (3.0 * RADIUS_M**2 + LENGTH_M**2) / 12.0


def record(hidden: Hidden, seconds: float, seed: int) -> np.ndarray:
    """Rows of time, positions and commanded torques of an arm whose controller follows sines, shape (s, 1 + 2 * 9)."""
    rng, model = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(arm())
    model.dof_frictionloss[1] += hidden.friction_nm
    model.body_mass[1:] *= 1.0 + 0.005 * rng.standard_normal(len(NAMES))
    data, row_s = mujoco.MjData(model), STEPS_OF_A_ROW * model.opt.timestep
    time_s, late = row_s * np.arange(round(seconds / row_s)), round(hidden.late_s / row_s)
    hertz, phase = rng.uniform(0.1, 1.6, (4, len(NAMES))), rng.uniform(0.0, 2.0 * np.pi, (4, len(NAMES)))
    target = 0.25 * np.sin(2.0 * np.pi * hertz * time_s[:, None, None] + phase).sum(axis=1)
    rows = np.empty((len(time_s), 1 + 2 * len(NAMES)))
    for i, now in enumerate(time_s):
        seen = data.qpos + NOISE_RAD * rng.standard_normal(len(NAMES))
        sent = GAIN_NM_RAD * (target[i] - seen) - DAMPING_NM_S_RAD * data.qvel + data.qfrc_bias
        rows[i] = now, *seen, *sent
        data.ctrl[:] = sent
        data.ctrl[-1] = rows[max(0, i - late), -1]
        mujoco.mj_step(model, data, STEPS_OF_A_ROW)
    return rows


def write_study(folder: Path, rows: np.ndarray) -> Path:
    """The study as its owner would write it: model, one table, and what its columns are."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.xml").write_text(arm())
    columns = ["time", *(f"{name}_pos" for name in NAMES), *(f"{name}_cmd" for name in NAMES)]
    np.savetxt(folder / "run.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    joints = "".join(f'\n[joints.{name}]\nposition = "{name}_pos"\ncommanded_torque = "{name}_cmd"\n' for name in NAMES)
    study = f'title = "an arm of nine joints"\nmodel = "robot.xml"\n\n[time]\ncolumn = "time"\n{joints}'
    (folder / "study.toml").write_text(f'{study}\n[[recording]]\nfile = "run.csv"\nregime = "sines"\n')
    return folder / "study.toml"


def studied(study: Path, out: Path, say: Callable[[str], None]) -> dict:
    """The verdict on a study and what it took."""
    command = [str(Path(sys.executable).parent / "trifarm"), "gap", "study", str(study), "--out", str(out), "--json"]
    began_s = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        lines = [(time.monotonic() - began_s, line.rstrip()) for line in process.stderr]
        said = process.stdout.read()
    whole_s = time.monotonic() - began_s
    if process.returncode != 0:
        raise SystemExit(f"the study of {study} ended with {process.returncode}: {lines[-1:]}")
    document = json.loads(said)
    drawn = re.compile("healthy robots")
    begins = [at for at, line in lines if drawn.search(line)]
    after = [at for at, line in lines if begins and at > begins[0] and not drawn.search(line)]
    say(f"{study.parent.name}: {document['verdict']}, {whole_s:.0f} s")
    return {
        "verdict": document["verdict"],
        "causes": [[cause["effect"], cause["where"]] for cause in document["causes"]],
        "whole_s": round(whole_s, 1),
        "said_of_healthy_robots": [line for _, line in lines if drawn.search(line)][:1],
        "until_after_healthy_robots_s": [round(begins[0], 1), round(after[0], 1)] if begins and after else None,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the recordings, study them one after the other, and write what each took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each recording")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=Path("study-time"), help="gets recordings and reports")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(arguments)
    found = {}
    for name in asked.cases:
        study = write_study(asked.folder / name.replace(" ", "-"), record(CASES[name], asked.seconds, asked.seed))
        found[name] = studied(study, study.parent / "report", lambda line: print(line, flush=True))
    figures = {"seconds": asked.seconds, "joints": len(NAMES), "seed": asked.seed, "processor": cpu_model(), "cores": cores()}
    asked.out.write_text(json.dumps(figures | {"limit_s": LIMIT_S, "studies": found}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
