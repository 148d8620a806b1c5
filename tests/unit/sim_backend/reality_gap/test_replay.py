"""Recordings replayed with models as they lie on disk: the right one goes where the robot went, in and out of the loop."""

import json

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.__main__ import main
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.model.files import LAWS, NATIVE
from sim_backend.reality_gap.replay import ReplayErrors
from sim_backend.reality_gap.study import stated_causes

ARM = """
<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody>
 <body><joint name="hinge" axis="0 1 0" armature="0.001" {}/>
  <inertial pos="0 0 -0.15" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/></body>
</worldbody></mujoco>
"""
STEP_S, GAIN, DAMPING = 0.005, 3.0, 0.1
STUDY = f"""
model = "arm.xml"
[[recording]]
file = "*.csv"
[time]
column = "time"
unit = "s"
[joints.hinge]
position = "q"
position_target = "target"
[controller]
kind = "pd"
stiffness = {GAIN}
damping = {DAMPING}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two runs of an arm with friction, its model without, and the model with it."""
    folder = tmp_path_factory.mktemp("replay")
    (folder / "arm.xml").write_text(ARM.format(""))
    (folder / "right.xml").write_text(ARM.format('frictionloss="0.1"'))
    (folder / "study.toml").write_text(STUDY)
    model = mujoco.MjModel.from_xml_path(str(folder / "right.xml"))
    for run in (1, 2):
        data, rows = mujoco.MjData(model), []
        for i in range(800):
            target = 0.7 * np.sin(0.01 * run * i) * np.sin(0.004 * i)
            rows.append((i * STEP_S, data.qpos[0], target))
            for _ in range(5):
                data.qfrc_applied[0] = GAIN * (target - data.qpos[0]) - DAMPING * data.qvel[0]
                mujoco.mj_step(model, data)
        np.savetxt(folder / f"run{run}.csv", rows, delimiter=",", header="time,q,target", comments="")
    return folder


@pytest.fixture
def replay(capsys):
    """The command in this process, which has its libraries: its exit code, and what it said."""

    def call(*arguments):
        capsys.readouterr()
        code = main(["replay", *map(str, arguments), "--json"])
        return code, "".join(capsys.readouterr())

    return call


@pytest.mark.parametrize("window", [[], ["--window", "1.0"]])
def test_the_right_model_goes_where_the_robot_went(folder, replay, window):
    code, said = replay(folder / "right.xml", folder / "study.toml", "--model", folder / "arm.xml", *window)
    assert code == 0, said
    found = json.loads(said[said.index("{") : said.rindex("}") + 1])
    error = {each["model"]: each["error_rad"] for each in found["models"]}
    assert error["extended"] < 0.05 * error["nominal"] and error["arm"] == error["nominal"]
    assert [each["recording"] for each in found["recordings"]] == ["run1", "run2"]
    assert found["recordings"][0]["windows"] == (3 if window else 1)


def test_the_model_of_a_study_comes_with_its_laws_whether_it_or_its_folder_is_named(folder, replay):
    study = folder / "studied"
    study.mkdir()
    (study / NATIVE).write_text(ARM.format(""))
    (study / LAWS).write_text(json.dumps({"joints": {"hinge": {"load_friction.coefficient": 0.2}}}))
    named = [document(replay(each, folder / "study.toml")) for each in (study, study / NATIVE)]
    assert named[0] == named[1]
    (study / LAWS).unlink()
    assert document(replay(study / NATIVE, folder / "study.toml")) != named[0]


def document(came):
    """What the command answered, without how long it thought that it would take."""
    code, said = came
    assert code == 0, said
    return json.loads(said[said.index("{") : said.rindex("}") + 1])


@pytest.mark.parametrize(
    ("model", "more", "why"),
    [
        ("nothing.xml", (), "there is no"),
        (".", (), "give the folder of a study that found causes"),
        ("study.toml", (), "is no model that MuJoCo can load"),
        ("other.xml", (), "has no joint 'hinge'"),
        ("right.xml", ("--window", "9"), "has no window of 9 s"),
        ("right.xml", ("--window", "-1"), "is a time in seconds"),
    ],
)
def test_what_cannot_be_replayed_is_refused_with_a_sentence(folder, replay, model, more, why):
    (folder / "other.xml").write_text(ARM.format("").replace("hinge", "knee"))
    code, said = replay(folder / model, folder / "study.toml", *more)
    assert code == 2 and why in said


def test_a_model_that_diverges_is_said_to_and_leaves_valid_json():
    found = ReplayErrors(("nominal", "extended"), ("run",), (1,), ("hinge",), np.array([[[0.01, np.inf]]]), 0.0)
    said = json.loads(json.dumps(found.document(), allow_nan=False))
    assert [each["error_rad"] for each in said["models"]] == [0.01, None]
    assert "diverged" in found.lines()[-2]


def test_what_a_study_file_states_is_added_to_what_the_model_says(folder):
    study = (folder / "study.toml").read_text().replace("arm.xml", "right.xml")
    stated = '[nominal]\n"coulomb_friction.torque_nm" = 0.02\n"action_delay.delay_s" = 0.004\n'
    (folder / "stated.toml").write_text(study + stated)
    file = load_study_file(folder / "stated.toml")
    causes = [cause for key, value in file.nominal.items() for cause in stated_causes(key, value, file)]
    assert {(cause.effect, cause.where): cause.value for cause in causes} == {
        ("coulomb_friction", "hinge"): pytest.approx(0.12),
        ("action_delay", "hinge"): 0.004,
    }
