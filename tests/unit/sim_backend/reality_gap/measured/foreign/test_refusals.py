"""Data that cannot be used are refused with their place, and nothing in a file is a crash."""

import gzip

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sim_backend.reality_gap.recording import RecordingError
from tests.unit.sim_backend.reality_gap.measured.foreign.foreign_study import cells, columns, folder, put, read, write


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


def _shuffled(path):
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *(rows[i] for i in np.random.default_rng(0).permutation(len(rows)))]))
    study = path.parent / "study.toml"
    study.write_text(study.read_text().replace('column = "time"', "rate_hz = 500.0"))


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
    "rows in no order": (_shuffled, ["not in the order of time"]),
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


def test_a_joint_that_rests_is_in_no_order_and_is_read(tmp_path):
    path, rng = folder(tmp_path), np.random.default_rng(0)
    (tmp_path / "study.toml").write_text((tmp_path / "study.toml").read_text().replace('column = "time"', "rate_hz = 500.0"))
    write(tmp_path / "data.csv", columns() | {key: 1e-3 * rng.standard_normal(len(columns()["time"])) for key in ("q",)})
    assert read(path)


def _cut(path):
    path.write_bytes(path.read_bytes()[:-2000])


def _three_dimensions(path):
    np.savez(path, **(dict(np.load(path)) | {"pos": np.zeros((200, 3, 1))}))


def _words(path):
    write(path, columns() | {"dq": np.array(["1.0"] * 4 + ["fast"] + ["1.0"] * 195)})


def _nameless(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def _encrypted(path):
    """Says in the archive's directory that its arrays are encrypted, as one damaged byte may."""
    content = bytearray(path.read_bytes())
    at = content.find(b"PK\x01\x02")
    while at >= 0:
        content[at + 8] |= 1
        at = content.find(b"PK\x01\x02", at + 1)
    path.write_bytes(content)


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
        ("data.npz", _encrypted, ["encrypted"]),
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
