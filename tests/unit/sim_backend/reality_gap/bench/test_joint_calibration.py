"""The tables of healthy sessions are made by commands."""

import json
import shutil

import pytest

from sim_backend.reality_gap.bench import joint_calibration, joint_calibration_table
from sim_backend.reality_gap.knowledge.healthy import LIMITS_FILE, SESSIONS_FILE, sessions_of


@pytest.fixture
def files(tmp_path):
    """Copies of the tables that are kept."""
    return [shutil.copy(file, tmp_path / file.name) for file in (SESSIONS_FILE, LIMITS_FILE)]


def renewed(files, *lines) -> tuple[dict, dict]:
    asked = [str(each) for each in (*lines, "--sessions-file", files[0], "--limits-file", files[1])]
    assert joint_calibration_table.main(asked) == 0
    sessions, limits = (json.loads(file.read_text()) for file in files)
    return sessions, limits


def test_lines_of_measured_sessions_become_tables_that_studies_read(files, tmp_path, capsys):
    lines = tmp_path / "lines.jsonl"
    asked = ["--sessions", "1", "--seed", "9", "--lines", str(lines), "--processes", "1", "--excitation", "slow_ramps"]
    assert joint_calibration.main([*asked, "--without-tolerances"]) == 0
    (measured,) = map(json.loads, lines.read_text().splitlines())
    kept = [json.loads(file.read_text()) for file in files]
    sessions, limits = renewed(files, "--tolerances", lines, "--healthy", lines, "--elsewhere", lines, "--alone", lines)
    assert sessions["tolerances"].keys() == kept[0]["tolerances"].keys()
    assert {key: len(own) for key, own in sessions["tolerances"].items()} == {
        key: len(own) for key, own in kept[0]["tolerances"].items()
    }
    assert limits["limits"].keys() == kept[1]["limits"].keys()
    for regimes in (("standard",), ("slow_ramps",), ("chirps", "slow_ramps")):
        found = sessions_of(sessions, regimes)
        assert found.largest_gains.tolist() == [measured["gain"]]
        assert all(found.gates[effect] >= gain for effect, gain in measured["gain_by_effect"].items())
    assert str(files[0]) in capsys.readouterr().out


def test_what_has_no_new_lines_stays(files, tmp_path):
    before = json.loads(files[0].read_text())
    line = {"number": 0, "seed": 4, "gain": 30.0, "gain_by_effect": {"backlash": 30.0}, "noise_ratio": 1.0}
    line |= {"excitation": "chirps", "left": 0.0, "values": {}}
    (tmp_path / "lines.jsonl").write_text(json.dumps(line) + "\n")
    after, limits = renewed(files, "--elsewhere", tmp_path / "lines.jsonl")
    assert after["elsewhere"]["sessions"] == {"chirps": 1}
    assert {key: value for key, value in after.items() if key != "elsewhere"} == {
        key: value for key, value in before.items() if key != "elsewhere"
    }
    assert limits == json.loads(LIMITS_FILE.read_text())


def test_a_table_of_nothing_is_refused(files, capsys):
    with pytest.raises(SystemExit) as ended:
        joint_calibration_table.main(["--sessions-file", str(files[0])])
    assert ended.value.code == 2 and "give lines" in capsys.readouterr().err
