"""Anyone's data become recordings: every format alike, and what cannot be used is refused with its place."""

import gzip

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sim_backend.reality_gap.recording import Recording, RecordingError
from tests.unit.sim_backend.reality_gap.foreign_study import STEP_S, STUDY, cells, columns, csv_text, folder, put, read, write


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
    from sim_backend.reality_gap.foreign_data import read_recordings
    from sim_backend.reality_gap.study_file import load_study_file

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


def _text(path):
    put(path, 17, "dq", "fast")


def _number_breaks_off(path):
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:50], lines[50].rsplit(",", 3)[0]]))


def _backwards(path):
    put(path, 42, "time", "0.001")


def _no_time(path):
    put(path, 9, "time", "")


def _infinite(path):
    put(path, 12, "tau", "inf")


def _quaternion(path):
    put(path, 30, "quat[1]", "3.0")


def _gone(path):
    write(path, {("torque" if key == "tau" else key): column for key, column in columns().items()})


def _nothing(path):
    write(path, columns() | {"tau": np.full(200, np.nan)})


def _short(path):
    write(path, columns(60))


def _latin(path):
    path.write_bytes(path.read_bytes().replace(b"vbat", b"vb\xe4t"))


def _headless(path):
    path.write_text("\n".join(path.read_text().splitlines()[1:]))


def _only_header(path):
    path.write_text(path.read_text().splitlines()[0])


def _twice(path):
    path.write_text(path.read_text().replace(",dq,", ",q,", 1))


def _clock(path):
    put(path, 200, "time", "5000.0")
    put(path, 201, "time", "5000.002")


BROKEN = {
    "text in a column of numbers": (_text, ["column 'dq'", "row 17", "'fast' is not a number"]),
    "a row that breaks off": (_number_breaks_off, ["row 51", "cells where the header names 15 columns"]),
    "time backwards": (_backwards, ["column 'time'", "row 42", "goes backwards"]),
    "a row without time": (_no_time, ["column 'time'", "row 9", "no time"]),
    "an infinite number": (_infinite, ["column 'tau'", "row 12", "infinite"]),
    "a quaternion that is none": (_quaternion, ["quat[1]", "row 30", "length"]),
    "a missing column": (_gone, ["joints.shoulder.measured_torque", "'tau'", "did you mean", "torque, tau_cmd"]),
    "a channel without values": (_nothing, ["column 'tau'", "no value in any row", "missing"]),
    "too short": (_short, ["0.118 s", "0.2 s"]),
    "not UTF-8": (_latin, ["row 1", "0xe4", "UTF-8"]),
    "no header": (_headless, ["no header"]),
    "a header only": (_only_header, ["no samples"]),
    "a name twice": (_twice, ["column 'q'", "2 columns have this name"]),
    "empty": (lambda path: path.write_bytes(b""), ["the file is empty"]),
    "blank": (lambda path: path.write_bytes(b"\n \n"), ["the file is empty"]),
    "a clock that jumps": (_clock, ["column 'time'", "row 200", "jumps"]),
}


@pytest.mark.parametrize("reason", BROKEN)
def test_broken_csv_is_refused_with_its_place(tmp_path, reason):
    path = folder(tmp_path)
    breaks, parts = BROKEN[reason]
    breaks(tmp_path / "data.csv")
    with pytest.raises(RecordingError) as refused:
        read(path)
    message = str(refused.value)
    assert "data.csv" in message
    assert all(part in message for part in parts), message
    assert len(message) < 500
    assert "\n" not in message


def _cut(path):
    path.write_bytes(path.read_bytes()[:-2000])


def _three_dimensions(path):
    np.savez(path, **(dict(np.load(path)) | {"pos": np.zeros((200, 3, 1))}))


def _words(path):
    write(path, columns() | {"dq": np.array(["1.0"] * 4 + ["fast"] + ["1.0"] * 195)})


def _nameless(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def _other_length(path):
    np.savez(path, **(dict(np.load(path)) | {"dq": np.zeros(7)}))


@pytest.mark.parametrize(
    ("name", "breaks", "parts"),
    [
        ("data.csv.gz", _cut, ["cut off"]),
        ("data.csv.gz", lambda path: path.write_bytes(b"time,q\n0,1\n"), ["no gzip"]),
        ("data.csv.gz", lambda path: path.write_bytes(gzip.compress(b"")), ["the file is empty"]),
        ("data.parquet", _cut, ["cannot be read as Parquet"]),
        ("data.parquet", lambda path: path.write_bytes(b""), ["the file is empty"]),
        ("data.parquet", _words, ["column 'dq'", "row 5", "'fast' is not a number"]),
        ("data.npz", _cut, ["cannot be read as npz"]),
        ("data.npz", lambda path: path.write_bytes(b""), ["the file is empty"]),
        ("data.npz", _nameless, ["single array"]),
        ("data.npz", _words, ["column 'dq'", "row 5", "'fast' is not a number"]),
        ("data.npz", _three_dimensions, ["column 'pos'", "3 dimensions"]),
        ("data.npz", _other_length, ["dq", "7 rows", "200"]),
        ("data.npz", lambda path: np.savez(path, time=np.array([{}], dtype=object)), ["has time"]),
    ],
)
def test_broken_files_of_other_formats_are_refused(tmp_path, name, breaks, parts):
    path = folder(tmp_path, name=name)
    breaks(tmp_path / name)
    with pytest.raises(RecordingError) as refused:
        read(path)
    message = str(refused.value)
    assert all(part in message for part in [name, *parts]), message
    assert "\n" not in message


def test_units_that_contradict_the_header_are_refused(tmp_path):
    path = folder(tmp_path)
    table = cells(tmp_path / "data.csv")
    table[0][table[0].index("x")] = "x [cm]"
    (tmp_path / "data.csv").write_text("\n".join(",".join(row) for row in table))
    with pytest.raises(RecordingError, match=r"joints\.slider\.position.*header says 'cm' and study\.toml says 'mm'"):
        read(path)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_one_damaged_byte_is_read_or_refused_but_never_a_crash(tmp_path, data):
    path = folder(
        tmp_path, data=columns(120), name=data.draw(st.sampled_from(["data.csv", "data.csv.gz", "data.parquet", "data.npz"]))
    )
    file = next(file for file in tmp_path.iterdir() if file.name in path.read_text() and file.name.startswith("data"))
    content = bytearray(file.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    try:
        recordings = read(path)
    except RecordingError:
        return
    assert all(np.isfinite(recording.objects[0].position_m).all() for recording in recordings)
