"""Flags of a robot."""

import pytest

from jail.level import JailLevel
from robot_farm.settings import FARM_SEED_VARIABLE, JAIL_LEVEL_VARIABLE, TOKEN_VARIABLE, Reset, parse

NEEDED = ["--api", "http://127.0.0.1:1/", "--bus", "tcp/127.0.0.1:2", "--data", "data"]


@pytest.fixture(autouse=True)
def _token(monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")


def test_a_nominal_robot_is_plain_and_a_real_one_is_swept():
    plain, real = parse([*NEEDED, "--physics", "nominal"]), parse(NEEDED)
    assert plain.is_plain
    assert plain.reset is Reset.PLACEMENT
    assert (real.physics_name, real.reset, real.is_plain) == ("real", Reset.SWEEP, False)


@pytest.mark.parametrize("flag", [["--reset", "sweep"], ["--fault", "robot-0:dead_camera:camera60"], ["--fault-rate", "0.1"]])
def test_a_nominal_robot_with_a_life_is_not_plain(flag):
    assert not parse([*NEEDED, "--physics", "nominal", *flag]).is_plain


def test_the_data_folder_is_known_wherever_a_process_of_the_robot_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert parse(NEEDED).data == tmp_path / "data"


def test_faults_add_up():
    spec = "robot-0:dead_camera:camera60"
    assert len(parse([*NEEDED, "--fault", spec, "--fault", f"{spec}@3"]).faults) == 2


def test_a_physics_file_is_named_without_its_folder(tmp_path):
    file = tmp_path / "sticky.toml"
    file.write_text("[coulomb_friction]\ntorque_nm = 0.05\n")
    assert parse([*NEEDED, "--physics", str(file)]).physics_name == "file:sticky"


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--physics", "unreal"], "choose from nominal"),
        (["--fault", "robot-0:dead_camera:camera9"], "choose from camera60"),
        (["--fault-rate", "2"], "between 0 and 1"),
        (["--self-test-every", "0"], "at least 1"),
        (["--reset", "broom"], "sweep"),
        (["--fault", "robot-9:dead_camera:camera60"], "--fault names robot-9; the robots are robot-0 to robot-3"),
        (["--first", "4", "--fault", "robot-0:dead_camera:camera60"], "the robots are robot-4 to robot-7"),
    ],
)
def test_what_is_wrong_is_said(flags, says, capsys):
    with pytest.raises(SystemExit):
        parse([*NEEDED, *flags])
    assert says in capsys.readouterr().err


def test_a_single_robot_is_told_everybodys_faults():
    assert len(parse([*NEEDED, "--robot", "robot-1", "--fault", "robot-9:dead_camera:camera60"]).faults) == 1


def test_the_farms_seed_comes_by_flag_or_variable(monkeypatch):
    assert parse(NEEDED).farm_seed is None
    monkeypatch.setenv(FARM_SEED_VARIABLE, "12")
    assert parse(NEEDED).farm_seed == 12
    assert parse([*NEEDED, "--farm-seed", "7"]).farm_seed == 7


def test_a_seed_that_is_none_is_refused_by_its_name(monkeypatch, capsys):
    monkeypatch.setenv(FARM_SEED_VARIABLE, "-1")
    with pytest.raises(SystemExit):
        parse(NEEDED)
    assert f"{FARM_SEED_VARIABLE} is '-1'" in capsys.readouterr().err


def test_the_least_jail_is_a_flag_or_a_variable(monkeypatch, capsys):
    assert parse(NEEDED).jail_level is JailLevel.LIMITS
    monkeypatch.setenv(JAIL_LEVEL_VARIABLE, "full")
    assert parse(NEEDED).jail_level is JailLevel.FULL
    assert parse([*NEEDED, "--jail-level", "filesystem"]).jail_level is JailLevel.FILESYSTEM
    monkeypatch.setenv(JAIL_LEVEL_VARIABLE, "thick walls")
    with pytest.raises(SystemExit):
        parse(NEEDED)
    assert "choose from none, limits, filesystem, full" in capsys.readouterr().err
