"""A study.toml is read strictly: whatever it says that cannot be is refused once, with the place and what would be valid."""

import hashlib
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.recording import RecordingError
from tests.unit.sim_backend.reality_gap.measured.foreign.foreign_study import STUDY, folder

ROOT = Path(__file__).parents[6]
DATA = ROOT.parent / "shared" / "data"
STUDIES = ROOT / "docs" / "studies"
CONTROLLER = '\n[controller]\nkind = "pd"\nstiffness = 9.0\ndamping = { shoulder = 0.1 }\n'
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no published data beside the checkout, at {DATA}")


def nominal(line: str) -> str:
    return STUDY.replace("[time]", f"[nominal]\n{line}\n[time]")


REFUSED = {
    "TOML": (STUDY.replace("[time]", "[time"), ["no valid TOML", "line 8"]),
    "no model": (STUDY.replace('model = "model.xml"', ""), ["model is missing"]),
    "another model": (STUDY.replace("model.xml", "robot.xml"), ["robot.xml", "does not exist"]),
    "an unknown table": (STUDY.replace("[signals]", "[signal]"), ["unknown key 'signal'", "did you mean 'signals'"]),
    "an unknown key": (STUDY.replace("velocity =", "velocty ="), ["[joints.shoulder]", "'velocty'", "did you mean 'velocity'"]),
    "an unknown joint": (
        STUDY.replace("[joints.shoulder]", "[joints.sholder]"),
        ["'sholder'", "did you mean 'shoulder'", "slider"],
    ),
    "a free joint": (STUDY.replace("[joints.slider]", "[joints.cube_free]"), ["'cube_free'", "[objects.NAME]"]),
    "an unknown body": (
        STUDY.replace('body = "cube"', 'body = "cub"'),
        ["[objects.block]", "'cub'", "did you mean 'cube'", "arm"],
    ),
    "an unknown unit": (STUDY.replace('"mm"', '"inch"'), ["[joints.slider]", "'inch'", "length", "mm"]),
    "a unit of another quantity": (STUDY.replace('"mm"', '"deg"'), ["[joints.slider]", "'deg'", "for length"]),
    "a unit of nothing": (STUDY.replace('"mm"', "0"), ["above 0"]),
    "a unit of time": (STUDY.replace('column = "time"', 'column = "time"\nunit = "h"'), ["[time]", "'h'", "ms"]),
    "no time": (STUDY.replace('column = "time"', ""), ["[time]", "rate_hz"]),
    "no position": (STUDY.replace('position = "q"', ""), ["[joints.shoulder]", "position is missing"]),
    "no kind of torque": (STUDY.replace('torque_kind = "measured"', ""), ["torque_kind is missing", "commanded, measured"]),
    "torque said twice": (STUDY.replace('"measured"', '"commanded"'), ["same as commanded_torque"]),
    "no ambient": (STUDY.replace("ambient = 20.0", ""), ["ambient"]),
    "a unit below nothing": (STUDY.replace('"mm"', "-0.1"), ["above 0", "torque_sign"]),
    "a sign of no torques": (
        STUDY.replace('position = "x"', 'position = "x"\npassive = true\ntorque_sign = -1'),
        ["torque_sign turns nothing"],
    ),
    "a sign of torques": (STUDY.replace('position = "q"', 'position = "q"\ntorque_sign = 0'), ["torque_sign is 0", "1 or -1"]),
    "a sign of a torque that none has": (
        STUDY.replace('position = "x"', 'position = "x"\nmeasured_torque_sign = -1'),
        ["[joints.slider]", "measured_torque_sign is given", "no measured_torque"],
    ),
    "a unit of a target that none has": (
        STUDY.replace('position = "q"', 'position = "q"\nposition_target_unit = "deg"'),
        ["[joints.shoulder]", "position_target_unit is given", "no position_target"],
    ),
    "a unit of its own of another quantity": (
        STUDY.replace('position = "q"', 'position = "q"\nmeasured_torque_unit = "deg"'),
        ["measured_torque_unit", "'deg'", "N m"],
    ),
    "a velocity target alone": (
        STUDY.replace('position = "q"', 'position = "q"\nvelocity_target = "dq"') + CONTROLLER,
        ["[joints.shoulder]", "velocity_target", "position_target", "stiffness 0"],
    ),
    "a sign": (STUDY.replace('position = "q"', 'position = "q"\nsign = 2'), ["sign is 2", "1 or -1"]),
    "no order": (STUDY.replace('quaternion_order = "xyzw"', ""), ["quaternion_order is missing", "wxyz, xyzw"]),
    "another order": (STUDY.replace('"xyzw"', '"xyz"'), ["quaternion_order is 'xyz'"]),
    "too few columns": (STUDY.replace(', "pos[2]"]', "]"), ["position names 2 columns", "3"]),
    "no frame": (STUDY.replace('body = "cube"', 'body = "cube"\nangular_velocity = "w"'), ["angular_velocity_frame is missing"]),
    "a missing file": (STUDY.replace("data.csv", "dat.csv"), ["'dat.csv'", "did you mean 'data.csv'", "--data"]),
    "another format": (STUDY.replace("data.csv", "model.xml"), ["no known format", ".parquet"]),
    "no recording": (STUDY.replace("[[recording]]", "").replace('file = "data.csv"', ""), ["[[recording]]"]),
    "an episode number": (STUDY.replace('"data.csv"', '"data.csv"\nepisode = 3'), ["episode_column"]),
    "nothing measured": (
        'model = "model.xml"\n[[recording]]\nfile = "data.csv"\n[time]\ncolumn = "time"',
        ["nothing was measured"],
    ),
    "a channel that none has": (
        STUDY.replace('"data.csv"', '"data.csv"\nmissing = ["temprature"]'),
        ["did you mean 'temperature'"],
    ),
    "an unknown effect": (
        nominal('"table_frictoin.coefficient" = 1.0'),
        ["[nominal]", "did you mean 'table_friction.coefficient'"],
    ),
    "an unknown parameter": (nominal("table_friction.mu = 1.0"), ["'table_friction.mu'", "table_friction.coefficient"]),
    "a negative value": (nominal('"table_friction.coefficient" = -1.0'), ["cannot be negative"]),
    "a value that is none": (nominal('"table_friction.coefficient" = "rough"'), ["must be a number"]),
    "joints of a camera": (nominal('"table_friction.coefficient" = { shoulder = 1.0 }'), ["give a number"]),
    "an unknown joint's value": (nominal('"coulomb_friction.torque_nm" = { elbow = 1.0 }'), ["'elbow'", "shoulder, slider"]),
    "one number for an axis each": (nominal('"gravity.offset_m_s2" = 0.1'), ["is one number", "a list of 3"]),
    "a list for joints": (nominal('"coulomb_friction.torque_nm" = [0.1, 0.2]'), ["table with one for each joint"]),
    "a tolerance of nothing that is": (STUDY + "[tolerance]\nmasses = 0.1\n", ["[tolerance]", "did you mean 'mass'"]),
    "a tolerance in per cent": (STUDY + "[tolerance]\nmass = 2.0\n", ["mass is 2", "0.02 for 2 %"]),
    "a bearing that gives a turn": (STUDY + "[tolerance]\ngive_rad = 6.3\n", ["give_rad is 6.3", "from 0 to 0.5, such as 0.001"]),
    "targets alone": (STUDY.replace('position = "q"', 'position = "q"\nposition_target = "q"'), ["[controller]"]),
    "another controller": (STUDY + CONTROLLER.replace("pd", "pid"), ["kind is 'pid'"]),
    "no damping": (STUDY + CONTROLLER.replace("damping", "#"), ["damping is missing"]),
    "a negative gain": (STUDY + CONTROLLER.replace("9.0", "-9.0"), ["cannot be negative"]),
    "a controller of nobody": (STUDY + CONTROLLER.replace("{ shoulder", "{ elbow"), ["'elbow'"]),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_what_cannot_be_is_refused(tmp_path, reason):
    study, parts = REFUSED[reason]
    path = folder(tmp_path, STUDY)
    path.write_text(study)
    with pytest.raises(RecordingError) as refused:
        load_study_file(path)
    message = str(refused.value)
    assert str(tmp_path) in message
    assert all(part in message for part in parts), message
    assert "\n" not in message


def test_a_model_that_does_not_compile_is_refused_with_mujocos_reason(tmp_path):
    path = folder(tmp_path)
    model = tmp_path / "model.xml"
    model.write_text(model.read_text().replace('<geom size="0.1"/>', '<geom size="-0.1"/>', 1))
    with pytest.raises(RecordingError, match=r"model\.xml: MuJoCo does not compile it: .*size"):
        load_study_file(path)


def test_a_study_that_is_no_text_or_not_there_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read"):
        load_study_file(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_bytes(b'title = "\xff"')
    with pytest.raises(RecordingError, match="not UTF-8"):
        load_study_file(tmp_path / "study.toml")


def test_nominal_values_controller_and_digests(tmp_path):
    lines = (
        'gravity.offset_m_s2 = [0.0, 0.0, 0.1]\n"coulomb_friction.torque_nm" = { slider = 0.3 }\ntable_friction.coefficient = 1.0'
    )
    study = load_study_file(folder(tmp_path, nominal(lines) + CONTROLLER))
    assert study.nominal == {
        "gravity.offset_m_s2": (0.0, 0.0, 0.1),
        "coulomb_friction.torque_nm": {"slider": 0.3},
        "table_friction.coefficient": 1.0,
    }
    assert study.controller is not None
    assert study.controller.stiffness_nm_rad == {"shoulder": 9.0, "slider": 9.0}
    assert study.controller.damping_nm_s_rad == {"shoulder": 0.1}
    assert study.controller.torque_limit_nm == {}
    digests = {Path(row["file"]).name: row["sha256"] for row in study.digests()}
    assert set(digests) == {"study.toml", "model.xml", "data.csv"}
    assert digests["data.csv"] == hashlib.sha256((tmp_path / "data.csv").read_bytes()).hexdigest()


def test_a_model_is_as_exact_as_it_says(tmp_path):
    assert load_study_file(folder(tmp_path, STUDY)).tolerance == Tolerance()
    said = load_study_file(folder(tmp_path, STUDY + "[tolerance]\nmass = 0.1\ninertia = 0\n")).tolerance
    assert said == Tolerance(mass=0.1, inertia=0.0)
    rigid = load_study_file(folder(tmp_path, STUDY + "[tolerance]\ngive_rad = 0\ncreep_rad_s = 0.02\n")).tolerance
    assert rigid == Tolerance(give_rad=0.0, creep_rad_s=0.02)


def test_a_rate_stands_for_a_column_of_time(tmp_path):
    (recording,) = read_recordings(load_study_file(folder(tmp_path, STUDY.replace('column = "time"', "rate_hz = 250.0"))))
    assert recording.step_s == pytest.approx(0.004)
    assert len(recording.time_s) == 200


@needs_data
def test_the_double_pendulum_has_the_torque_errors_of_its_source():
    """Inverse dynamics without friction on runs held out there: 0.308 and 0.187 N m (SOURCE.md), within the filter's margin."""
    from scipy.signal import butter, filtfilt

    study = load_study_file(STUDIES / "double-pendulum" / "study.toml", DATA)
    recordings = read_recordings(study)
    assert [recording.regime for recording in recordings] == ["torque excitation"] * 8 + ["swing-up"] * 2
    model = study.compile_model()
    state, residuals = mujoco.MjData(model), []
    for recording in recordings[-3:]:
        joints = recording.joints
        low_pass = butter(2, 12.0 * 2.0 * recording.step_s)
        assert not np.isnan(joints.position_rad).any()
        position, velocity, torque = (
            filtfilt(*low_pass, values, axis=0)
            for values in (joints.position_rad, joints.velocity_rad_s, joints.measured_torque_nm)
        )
        acceleration = np.gradient(velocity, recording.step_s, axis=0)
        for step in range(50, len(torque) - 50, 10):
            state.qpos[:], state.qvel[:], state.qacc[:] = position[step], velocity[step], acceleration[step]
            mujoco.mj_inverse(model, state)
            residuals.append(torque[step] - state.qfrc_inverse)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(residuals), axis=0)), [0.308, 0.187], rtol=0.03)


@needs_data
def test_the_cube_tosses_are_read_as_they_are():
    study = load_study_file(STUDIES / "cube-tosses" / "study.toml", DATA)
    recordings = read_recordings(study)
    assert study.nominal == {"table_friction.coefficient": 1.0}
    assert len(recordings) == 570
    with np.load(DATA / "contactnets_cube" / "tosses.npz") as published:
        rows = published["toss"] == 569
        (cube,) = recordings[-1].objects
        np.testing.assert_array_equal(cube.position_m, published["pos"][rows])
        np.testing.assert_array_equal(cube.angular_velocity_rad_s, published["angvel"][rows])
        np.testing.assert_allclose(cube.quat_wxyz, published["quat_wxyz"][rows], atol=1e-12)
    assert sum(len(recording.objects[0].time_s) for recording in recordings) == 59_953
    resting_m = study.compile_model().geom("cube").size[2]
    assert resting_m == 0.0524


@needs_data
@pytest.mark.parametrize("name", ["double-pendulum", "cube-tosses"])
def test_examples_find_the_data_beside_the_checkout_by_themselves(name):
    assert all(entry.file.is_file() for entry in load_study_file(STUDIES / name / "study.toml").recordings)


def test_the_reference_names_every_key_and_no_other(tmp_path):
    from sim_backend.reality_gap.measured.foreign import study_channels, study_file

    page = (STUDIES / "README.md").read_text(encoding="utf-8")
    rows = [line.split("|") for line in page.splitlines() if line.startswith("|")][2:]
    documented = {key for row in rows for key in re.findall(r"`([a-z_]+)`", row[2])}
    sources = "".join(path.read_text(encoding="utf-8") for path in Path(study_file.__file__).parent.glob("study_*.py"))
    assert {key for key in documented if f'"{key}"' not in sources} == set()
    stated = {"title", "model", "data", *study_file._RECORDING_KEYS, *study_channels.JOINT_CHANNELS}
    stated |= {*study_channels._OBJECT_CHANNELS, *study_channels._UNIT_KEYS.values()}
    stated |= {*study_channels._OWN_UNIT_KEYS.values(), *study_channels._SIGNS}
    assert stated - documented == set()


def test_the_references_example_is_valid(tmp_path):
    page = (STUDIES / "README.md").read_text(encoding="utf-8")
    smallest, longer = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "sweeps").mkdir()
    for name in ("sweeps/a.csv.gz", "sweeps/b.csv.gz", "steps.parquet"):
        (tmp_path / name).touch()
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="shoulder"/><geom size="1"/>'
        '<body><joint name="elbow"/><geom size="1"/></body></body></worldbody></mujoco>'
    )
    (tmp_path / "study.toml").write_text(longer)
    study = load_study_file(tmp_path / "study.toml")
    assert [entry.name for entry in study.recordings] == ["a", "b", "steps"]
    assert [joint.name for joint in study.joints] == ["shoulder", "elbow"]
    assert smallest.strip() in re.sub(
        r"^#.*\n", "", (STUDIES / "first-study/study.toml").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
