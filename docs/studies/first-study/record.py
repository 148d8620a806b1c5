"""Records an arm whose elbow rubs, which its model does not know: python record.py FOLDER."""

import sys
from pathlib import Path

import mujoco
import numpy as np

ELBOW_RUBS_NM = 0.06
NM_PER_AMPERE = 0.5
STIFFNESS_NM_RAD, DAMPING_NM_S_RAD = np.array([25.0, 8.0]), np.array([2.0, 0.5])
ROW_S, SECONDS = 0.01, 6.0
ENCODER_RAD = 2e-4


def record(seed: int) -> np.ndarray:
    """One run: the arm follows sums of sines. Columns are those of the file."""
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "model.xml"))
    model.dof_frictionloss[model.joint("elbow").dofadr[0]] = ELBOW_RUBS_NM
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    periods_s, phases = np.array([[2.9, 0.9], [2.1, 0.7]]), rng.uniform(0.0, 2.0 * np.pi, (2, 2))
    rows = []
    for row in range(round(SECONDS / ROW_S)):
        target = 0.4 * np.sin(2.0 * np.pi * row * ROW_S / periods_s + phases).sum(axis=1)
        position = data.qpos + ENCODER_RAD * rng.standard_normal(2)
        data.ctrl[:] = STIFFNESS_NM_RAD * (target - position) - DAMPING_NM_S_RAD * data.qvel
        rows.append([row * ROW_S, *np.degrees(position), *data.ctrl / NM_PER_AMPERE])
        mujoco.mj_step(model, data, round(ROW_S / model.opt.timestep))
    return np.array(rows)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for number in (1, 2):
        file = folder / f"run-{number}.csv"
        np.savetxt(file, record(number), delimiter=",", header="t,q1,q2,i1,i2", comments="", fmt="%.6f")
        print(file)
