"""Anyone's data become recordings: every format, unit and rate alike."""

import numpy as np
import pytest

from sim_backend.reality_gap.recording import Recording, RecordingError
from tests.unit.sim_backend.reality_gap.measured.foreign.foreign_study import (
    STEP_S,
    STUDY,
    columns,
    csv_text,
    folder,
    read,
    write,
)


def assert_same(one: Recording, other: Recording) -> None:
    pairs = [(one.time_s, other.time_s), (one.signals["supply_v"], other.signals["supply_v"])]
    for kind in ("joints", "objects"):
        left, right = getattr(one, kind), getattr(other, kind)
        left, right = (left[0], right[0]) if kind == "objects" else (left, right)
        pairs += [(value, vars(right)[key]) for key, value in vars(left).items()]
    for left, right in pairs:
        if isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right)
        else:
            assert left == right


@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz", "data.parquet", "data.npz"])
def test_every_format_gives_the_same_recording(tmp_path, name):
    (tmp_path / "reference").mkdir()
    (reference,) = read(folder(tmp_path / "reference"))
    (recording,) = read(folder(tmp_path, name=name))
    assert recording.name == "data"
    assert recording.source.endswith(name)
    assert_same(recording, reference)


def test_values_arrive_in_si_units_and_in_the_models_order(tmp_path):
    data = columns()
    (recording,) = read(folder(tmp_path))
    joints = recording.joints
    assert joints is not None
    assert joints.names == ("shoulder", "slider")
    assert recording.step_s == pytest.approx(STEP_S)
    np.testing.assert_allclose(joints.position_rad, np.column_stack([data["q"], data["x"] / 1000.0]), rtol=1e-12)
    assert joints.measured_torque_nm is not None
    np.testing.assert_array_equal(joints.measured_torque_nm[:, 0], data["tau"])
    assert np.isnan(joints.measured_torque_nm[:, 1]).all(), "the slider has no torque"
    assert joints.commanded_torque_nm is not None
    np.testing.assert_array_equal(joints.commanded_torque_nm[:, 0], data["tau_cmd"])
    assert joints.temperature_rise_k is not None
    np.testing.assert_allclose(joints.temperature_rise_k[:, 0], data["temp"] - 20.0)
    np.testing.assert_allclose(recording.signals["supply_v"], data["vbat"] / 1000.0)
    (block,) = recording.objects
    assert (block.name, block.body) == ("block", "cube")
    np.testing.assert_allclose(block.quat_wxyz[:, 0], data["quat[3]"])
    np.testing.assert_allclose(block.quat_wxyz[:, 1], data["quat[0]"])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_header_units_and_comments(tmp_path, separator):
    path = folder(tmp_path, STUDY.replace('"x"\nposition_unit = "mm"', '"x"'))
    text = csv_text(columns(), separator)
    header, _, rest = text.partition("\n")
    header = header.replace(f"{separator}q{separator}", f"{separator} q [rad] {separator}").replace(
        f"x{separator}", f"x (mm){separator}"
    )
    (tmp_path / "data.csv").write_text(f"# a robot\n#\n{header}\n{rest}\n\n")
    (recording,) = read(path)
    np.testing.assert_allclose(recording.joints.position_rad[:, 1], columns()["x"] / 1000.0, rtol=1e-12)


def test_decimal_commas_and_a_header_as_numpy_writes_it(tmp_path):
    path = folder(tmp_path)
    (reference,) = read(path)
    text = csv_text(columns(), ";")
    header, _, rest = text.partition("\n")
    (tmp_path / "data.csv").write_bytes(b"\xef\xbb\xbf" + f"# {header}\n{rest.replace('.', ',')}".replace("\n", "\r\n").encode())
    (recording,) = read(path)
    assert_same(recording, reference)


def test_the_step_of_an_encoder_is_that_of_what_it_reported_at_uneven_times(tmp_path):
    data = columns()
    data["q"] = 0.01 * np.round(data["q"] / 0.01)
    data["time"] = data["time"] + STEP_S * np.random.default_rng(0).uniform(-0.2, 0.2, len(data["time"]))
    joints = read(folder(tmp_path, data=data))[0].joints
    assert joints.encoder_step_rad[0] == pytest.approx(0.01)
    assert np.abs(joints.position_rad[:, 0] / 0.01 % 1.0 - 0.5).min() < 0.3, "between rows the grid has lost it"


def test_a_gap_stays_a_gap_and_a_lost_row_is_bridged(tmp_path):
    data = columns()
    keep = np.ones(200, dtype=bool)
    keep[[50, *range(100, 120)]] = False
    (recording,) = read(folder(tmp_path, data={key: column[keep] for key, column in data.items()}))
    assert len(recording.time_s) == 200
    position = recording.joints.position_rad[:, 0]
    assert np.flatnonzero(np.isnan(position)).tolist() == list(range(100, 120))
    assert position[50] == pytest.approx(data["q"][50], abs=1e-4)
    assert len(recording.objects[0].time_s) == 179


def test_slower_channels_and_objects_keep_their_rate(tmp_path):
    data = columns()
    slow = np.arange(200) % 10 != 0
    for name in ("temp", "tau_cmd", "vbat", "pos[0]"):
        data[name][slow] = np.nan
    (recording,) = read(folder(tmp_path, data=data))
    joints = recording.joints
    np.testing.assert_allclose(joints.temperature_rise_k[:191, 0], columns()["temp"][:191] - 20.0, atol=1e-9)
    np.testing.assert_allclose(joints.commanded_torque_nm[:, 0], np.repeat(columns()["tau_cmd"][::10], 10), rtol=1e-9)
    np.testing.assert_allclose(recording.objects[0].time_s, np.arange(20) * 10 * STEP_S)


def test_equal_time_stamps_are_merged(tmp_path):
    data = {key: np.repeat(column, 2) for key, column in columns().items()}
    for name, column in data.items():  # as a log that writes the cube in rows of its own
        if name != "time":
            column[(1 if name.startswith(("pos", "quat")) else 0) :: 2] = np.nan
    (tmp_path / "reference").mkdir()
    (recording,), (reference,) = read(folder(tmp_path, data=data)), read(folder(tmp_path / "reference"))
    assert_same(recording, reference)


@pytest.mark.parametrize("stated", ["", "wrapped = true", "wrapped = false"])
def test_wrapped_angles_are_unwrapped_unless_forbidden(tmp_path, stated):
    data = columns()
    turned = 30.0 * data["time"]
    wrapped = (turned + np.pi) % (2.0 * np.pi) - np.pi
    data["q"] = np.rad2deg(wrapped)
    study = STUDY.replace('position = "q"', f'position = "q"\nposition_unit = "deg"\n{stated}')
    (recording,) = read(folder(tmp_path, study, data))
    expected = wrapped if stated == "wrapped = false" else turned
    np.testing.assert_allclose(recording.joints.position_rad[:, 0], expected, atol=1e-9)


def test_sign_zero_and_a_number_as_unit(tmp_path):
    data = columns()
    data["q"] = data["q"] * 1000.0 + 500.0
    study = STUDY.replace('position = "q"', 'position = "q"\nposition_unit = 0.001\nsign = -1\nzero = 500.0')
    joints = read(folder(tmp_path, study, data))[0].joints
    np.testing.assert_allclose(joints.position_rad[:, 0], -columns()["q"], atol=1e-12)
    np.testing.assert_array_equal(joints.velocity_rad_s[:, 0], -data["dq"])
    np.testing.assert_array_equal(joints.measured_torque_nm[:, 0], -data["tau"])


@pytest.mark.parametrize("sign", [1, -1])
def test_torques_that_count_against_positions_are_turned_alone(tmp_path, sign):
    study = STUDY.replace('position = "q"', f'position = "q"\nsign = {sign}\ntorque_sign = -1')
    data, joints = columns(), read(folder(tmp_path, study, columns()))[0].joints
    np.testing.assert_array_equal(joints.velocity_rad_s[:, 0], sign * data["dq"])
    np.testing.assert_array_equal(joints.measured_torque_nm[:, 0], -sign * data["tau"])


def test_a_measured_torque_of_0_in_every_row_beside_a_command_is_refused(tmp_path):
    data = columns()
    data["tau"] = np.zeros_like(data["tau"])
    with pytest.raises(
        RecordingError, match=r"joints.shoulder.*measured_torque is 0 in every row, while commanded_torque is not"
    ):
        read(folder(tmp_path, STUDY, data))
    data["tau_cmd"] = np.zeros_like(data["tau_cmd"])
    assert read(folder(tmp_path, STUDY, data))[0].joints is not None, "nothing drove it"
    guided = columns() | {"tau_cmd": data["tau_cmd"]}
    assert read(folder(tmp_path, STUDY, guided))[0].joints is not None, "a joint that is led by hand has noise"


def test_a_sensor_that_is_slower_than_its_logger_is_read_at_its_own_rate(tmp_path):
    data = columns(2000)
    rows = np.arange(2000)
    data["q"] = np.sin(7.0 * data["time"])[rows // 5 * 5]
    (recording,) = read(folder(tmp_path, STUDY, data))
    joints = recording.joints
    np.testing.assert_allclose(joints.position_step_s, [5 * STEP_S, STEP_S], rtol=1e-9)
    np.testing.assert_allclose(joints.position_rad[:1990, 0], np.sin(7.0 * data["time"])[:1990], atol=1e-3)
    assert np.isfinite(joints.measured_torque_nm[:, 0]).all()


def test_rows_that_a_logger_wrote_several_times_are_left_out(tmp_path):
    data = columns(2000)
    once = {name: column[np.arange(2000) // 5 * 5] for name, column in data.items() if name != "time"}
    (recording,) = read(folder(tmp_path, STUDY, data | once))
    assert recording.step_s == pytest.approx(5 * STEP_S)
    np.testing.assert_array_equal(recording.joints.measured_torque_nm[:, 0], data["tau"][::5])
    np.testing.assert_array_equal(recording.joints.position_rad[:, 0], data["q"][::5])


def test_a_measured_torque_that_holds_its_steps_beside_fine_positions_is_one(tmp_path):
    data = columns(2000)
    data["tau"] = data["tau"][np.arange(2000) // 10 * 10]
    (recording,) = read(folder(tmp_path, STUDY, data))
    np.testing.assert_array_equal(recording.joints.measured_torque_nm[:, 0], data["tau"])


@pytest.mark.parametrize("sign", [1, -1])
def test_measured_torques_may_have_a_unit_and_a_sign_of_their_own(tmp_path, sign):
    more = f'position = "q"\nsign = {sign}\ntorque_unit = 0.5\nmeasured_torque_unit = "mN m"\nmeasured_torque_sign = -1'
    data, joints = columns(), read(folder(tmp_path, STUDY.replace('position = "q"', more), columns()))[0].joints
    np.testing.assert_allclose(joints.commanded_torque_nm[:, 0], sign * 0.5 * data["tau_cmd"])
    np.testing.assert_allclose(joints.measured_torque_nm[:, 0], -sign * 1e-3 * data["tau"])


def test_position_targets_lie_on_the_turn_of_the_position(tmp_path):
    data = columns()
    turned = 30.0 * data["time"]
    data["q"] = (turned + np.pi) % (2.0 * np.pi) - np.pi
    data["target"] = (turned + 0.1 + np.pi) % (2.0 * np.pi) - np.pi
    study = (
        STUDY.replace('position = "q"', 'position = "q"\nposition_target = "target"')
        + '[controller]\nkind = "pd"\nstiffness = 1.0\ndamping = 0.1\n'
    )
    joints = read(folder(tmp_path, study, data))[0].joints
    np.testing.assert_allclose(joints.position_target_rad[:, 0], turned + 0.1, atol=1e-9)


SERVO = """
[joints.slider]
position = "x"
position_unit = "mm"
[joints.slider.servo]
gain = { column = "kp", unit = 0.5 }
supply = "volts"
kt = 0.2
resistance = 4.0
enabled = "on"
"""


def test_a_servo_clips_its_duty_before_the_motor_s_own_voltage_acts(tmp_path):
    data = columns()
    count = len(data["time"])
    data |= {"target": data["q"] + 0.3, "kp": np.full(count, 4.0), "volts": np.full(count, 10.0), "on": np.ones(count)}
    data["target"][: count // 2] += 2.0
    data["on"][-10:] = 0.0
    servo = SERVO.replace("slider", "shoulder").split("[joints.shoulder.servo]")[1]
    study = STUDY.replace('position = "q"', 'position = "q"\nposition_target = "target"') + f"[joints.shoulder.servo]{servo}"
    study = (
        study.replace('commanded_torque = "tau_cmd"\n', "")
        .replace('torque = "tau"\n', "")
        .replace('torque_kind = "measured"\n', "")
    )
    joints = read(folder(tmp_path, study, data))[0].joints
    duty = np.where(np.arange(count) < count // 2, 1.0, 0.6)
    expected = 0.2 * 10.0 * duty / 4.0 - 0.2**2 / 4.0 * data["dq"]
    expected[-10:] = 0.0
    np.testing.assert_allclose(joints.commanded_torque_nm[:, 0], expected, atol=1e-9)
    assert joints.feedback.is_known.tolist() == [True, False]


def without_torques(more: str) -> str:
    """The study whose shoulder has no torque, but something else."""
    lines = [line for line in STUDY.splitlines() if not line.startswith(("commanded_torque", "torque"))]
    return "\n".join(lines) + more


MOTOR = """
[joints.shoulder.motor]
{drive}
kt = 0.2
resistance = 4.0
"""


@pytest.mark.parametrize(
    ("drive", "limit_v"),
    [('voltage = "volts"', np.inf), ('voltage = "volts"\nsupply = 6.0', 6.0), ('duty = "share"\nsupply = 9.0', 9.0)],
)
def test_a_motor_gives_what_its_voltage_and_its_own_make(tmp_path, drive, limit_v):
    data = columns()
    volts = 8.0 * np.sin(np.arange(len(data["time"])) / 7.0)
    data |= {"volts": volts, "share": volts / 9.0}
    joints = read(folder(tmp_path, without_torques(MOTOR.format(drive=drive)), data))[0].joints
    expected = 0.2 / 4.0 * np.clip(volts, -limit_v, limit_v) - 0.2**2 / 4.0 * data["dq"]
    np.testing.assert_allclose(joints.commanded_torque_nm[:, 0], expected, atol=1e-6)
    assert joints.feedback.is_known.tolist() == [True, False] and joints.not_recorded == ("shoulder",)
    assert joints.feedback.is_on_board.tolist() == [True, False], "a voltage is late, and not what the motor makes itself"
    against = without_torques(MOTOR.format(drive=drive)).replace('position = "q"', 'position = "q"\ntorque_sign = -1')
    turned = read(folder(tmp_path, against, data))[0].joints
    expected = -0.2 / 4.0 * np.clip(volts, -limit_v, limit_v) - 0.2**2 / 4.0 * data["dq"]
    np.testing.assert_allclose(turned.commanded_torque_nm[:, 0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (MOTOR.format(drive=""), "a motor needs voltage or duty"),
        (MOTOR.format(drive='duty = "tau"'), "duty needs supply"),
        (MOTOR.format(drive='voltage = "tau"') + "[joints.shoulder.servo]\ngain = 1.0\n", "a servo or a motor, not both"),
        (MOTOR.format(drive='voltage = "tau"').replace("kt = 0.2", "kt = 0.0"), "must be above 0"),
    ],
)
def test_a_motor_of_which_it_is_not_clear_what_drives_it_is_refused(tmp_path, more, why):
    with pytest.raises(RecordingError, match=why):
        read(folder(tmp_path, without_torques(more)))


@pytest.mark.parametrize("kind", ["commanded", "measured"])
def test_beside_a_motor_s_voltage_a_torque_may_be_measured_but_not_commanded(tmp_path, kind):
    torque = f'position = "q"\ntorque = "tau"\ntorque_kind = "{kind}"'
    path = folder(tmp_path, without_torques(MOTOR.format(drive='voltage = "tau"')).replace('position = "q"', torque))
    if kind == "measured":
        assert read(path)[0].joints.measured_torque_nm is not None
        return
    with pytest.raises(RecordingError, match="the joint has commanded_torque, too"):
        read(path)


def test_a_passive_joint_has_no_torque_and_nothing_that_drives_it(tmp_path):
    study = STUDY.replace('position = "x"', 'position = "x"\npassive = true')
    joints = read(folder(tmp_path, study))[0].joints
    assert (joints.commanded_torque_nm[:, 1] == 0.0).all()
    (tmp_path / "driven").mkdir()
    with pytest.raises(RecordingError, match="the joint is passive, which nothing drives, and has torque"):
        read(folder(tmp_path / "driven", STUDY.replace('position = "q"', 'position = "q"\npassive = true')))


def test_a_servo_without_targets_or_motor_is_refused(tmp_path):
    (tmp_path / "motor").mkdir()
    with pytest.raises(RecordingError, match=r"\[joints.slider.servo\]: a servo needs position_target"):
        read(folder(tmp_path, STUDY + SERVO[SERVO.index("[joints.slider.servo]") :]))
    targets = STUDY.replace('position = "q"', 'position = "q"\nposition_target = "tau"')
    without = SERVO[SERVO.index("[joints.slider.servo]") :].replace("slider", "shoulder").replace("kt = 0.2\n", "")
    with pytest.raises(RecordingError, match="kt is missing"):
        read(folder(tmp_path / "motor", targets + without))


@pytest.mark.parametrize("name", ["data.csv", "data.parquet", "data.npz"])
def test_episodes_of_one_file_may_have_other_rates(tmp_path, name):
    data = {key: np.tile(column, 2) for key, column in columns().items()}
    data["time"][200:] = 7.0 + 0.005 * np.arange(200)
    data["run"] = np.repeat([7, 3], 200)
    study = STUDY.replace('file = "data.csv"', 'file = "data.csv"\nepisode = "run"\nregime = "free"')
    first, second = read(folder(tmp_path, study, data, name))
    assert (first.name, second.name, first.regime) == ("data, run 7", "data, run 3", "free")
    assert (first.step_s, second.step_s) == (pytest.approx(STEP_S), pytest.approx(0.005))
    assert second.time_s[0] == second.objects[0].time_s[0] == 0.0
    chosen = study.replace('episode = "run"', 'episode_column = "run"\nepisode = [3]')
    assert [recording.name for recording in read(folder(tmp_path, chosen, data, name))] == ["data, run 3"]


def test_patterns_missing_channels_and_a_data_root(tmp_path):
    from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
    from sim_backend.reality_gap.measured.foreign.study_file import load_study_file

    root = tmp_path / "elsewhere"
    (root / "a").mkdir(parents=True)
    write(root / "a" / "run.csv", columns())
    write(root / "a" / "other.csv", {key: column for key, column in columns().items() if key not in {"temp", "vbat"}})
    study = (
        STUDY.replace('"data.csv"', '"a/r*.csv"') + '[[recording]]\nfile = "a/other.csv"\nmissing = ["temperature", "supply_v"]\n'
    )
    recordings = read_recordings(load_study_file(folder(tmp_path, study), root))
    assert [recording.name for recording in recordings] == ["run", "other"]
    assert recordings[1].joints.temperature_rise_k is None
    assert "supply_v" not in recordings[1].signals


def test_objects_have_times_and_frames_of_their_own(tmp_path):
    joints, poses = columns(), columns(40, seed=1)
    joints["time"] = joints["time"] + 1e9
    seen_s = 0.01 * np.arange(40)
    velocity = np.random.default_rng(0).normal(size=(40, 3))
    np.savez(
        tmp_path / "poses.npz",
        time=joints["time"],
        q=joints["q"],
        seen=seen_s + 1e9,
        known=seen_s + 1e9 + 0.09,
        pos=np.column_stack([poses[f"pos[{axis}]"] for axis in range(3)]),
        quat=np.tile([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], (40, 1)),  # xyzw: a quarter turn about z
        velocity=velocity,
    )
    study = (
        'model = "model.xml"\n[[recording]]\nfile = "poses.npz"\n[time]\ncolumn = "time"\n[joints.shoulder]\nposition = "q"\n'
        '[objects.cube]\ntime = "seen"\ndelivery = "known"\nposition = "pos"\nquaternion = "quat"\nquaternion_order = "xyzw"\n'
        'angular_velocity = "velocity"\nangular_velocity_frame = "world"\n'
        'linear_velocity = "velocity"\nlinear_velocity_frame = "body"\n'
    )
    (recording,) = read(folder(tmp_path, study))
    (cube,) = recording.objects
    np.testing.assert_allclose(cube.time_s, seen_s, atol=1e-6)
    np.testing.assert_allclose(cube.delivery_s - cube.time_s, 0.09, atol=1e-6)
    x, y, z = velocity.T
    np.testing.assert_allclose(cube.angular_velocity_rad_s, np.column_stack([y, -x, z]), atol=1e-12)
    np.testing.assert_allclose(cube.linear_velocity_m_s, np.column_stack([-y, x, z]), atol=1e-12)


DATES = np.datetime64("2026-11-30T23:59:59.9", "ns") + (np.arange(200) * STEP_S * 1e9).astype("timedelta64[ns]")


@pytest.mark.parametrize(
    "written",
    [
        [f"{date.astype('datetime64[ms]')}" for date in DATES],
        [f"{date.astype('datetime64[us]')}".replace("T", " ") + "+00:00" for date in DATES],
        DATES,
    ],
    ids=["csv", "csv-with-zone", "parquet"],
)
def test_dates_are_times_of_one_clock(tmp_path, written):
    data = {**columns(), "time": np.array(written)}
    name = "data.parquet" if written is DATES else "data.csv"
    study = STUDY.replace('quaternion_order = "xyzw"', 'quaternion_order = "xyzw"\ntime = "seen"')
    late_s = 0.024
    late = np.array(written[12:] + written[-1:] * 12) if isinstance(written, list) else np.append(DATES[12:], [DATES[-1]] * 12)
    (recording,) = read(folder(tmp_path, study, {**data, "seen": late}, name))
    np.testing.assert_allclose(recording.time_s, np.arange(200) * STEP_S, atol=1e-5)
    np.testing.assert_allclose(recording.joints.position_rad[:, 0], columns()["q"], atol=1e-5)
    np.testing.assert_allclose(recording.objects[0].time_s[:100], np.arange(100) * STEP_S + late_s, atol=1e-5)


@pytest.mark.parametrize(
    ("study", "column", "cell", "why"),
    [
        (STUDY.replace('column = "time"', 'column = "time"\nunit = "ms"'), "time", None, "have no unit"),
        (STUDY, "q", None, "joints.shoulder.position needs numbers"),
        (STUDY, "time", "30.11.2026 09:15:00", "row 2: '30.11.2026 09:15:00' is not a number; times are numbers, or dates"),
        (STUDY, "time", "soon", "row 2: 'soon' is not a number$"),
    ],
)
def test_dates_that_are_no_times_are_refused(tmp_path, study, column, cell, why):
    path = folder(tmp_path, study, {**columns(), column: np.array([cell or f"{date}" for date in DATES])})
    with pytest.raises(RecordingError, match=why):
        read(path)


def test_a_row_that_is_no_date_among_dates_is_refused(tmp_path):
    written = [f"{date.astype('datetime64[ms]')}" for date in DATES]
    path = folder(tmp_path, data={**columns(), "time": np.array([*written[:7], "later", *written[8:]])})
    with pytest.raises(RecordingError, match="row 9: 'later' is no date such as '2026-11-30T23:59:59"):
        read(path)
