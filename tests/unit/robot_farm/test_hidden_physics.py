"""The farm's secret and what is drawn from it."""

import json
import os
import stat
from multiprocessing import get_context

import pytest

from robot_farm import hidden_physics
from robot_farm.hidden_physics import SECRET_BYTES, SECRET_FILE, HiddenPhysics, farm_secret
from robot_farm.settings import FARM_SEED_VARIABLE


def _ask(folder, answers) -> None:
    answers.put(farm_secret(folder, None))


def test_robots_that_start_together_get_one_secret(tmp_path):
    context = get_context("spawn")
    answers = context.Queue()
    robots = [context.Process(target=_ask, args=(tmp_path / "robots", answers)) for _ in range(3)]
    for robot in robots:
        robot.start()
    secrets = {answers.get(timeout=120) for _ in robots}
    for robot in robots:
        robot.join(timeout=120)
    answers.close()
    answers.join_thread()
    assert len(secrets) == 1
    assert len(secrets.pop()) == SECRET_BYTES
    assert [file.name for file in (tmp_path / "robots").iterdir()] == [SECRET_FILE]
    assert stat.S_IMODE((tmp_path / "robots" / SECRET_FILE).stat().st_mode) == 0o600


def test_a_farm_seed_needs_no_file(tmp_path):
    assert farm_secret(tmp_path, 5) == farm_secret(tmp_path, 5) != farm_secret(tmp_path, 6)
    assert not list(tmp_path.iterdir())


def test_robots_differ_and_stay_themselves():
    one, again, other = (HiddenPhysics(b"secret", name, "real") for name in ("robot-0", "robot-0", "robot-1"))
    assert one.physics.document() == again.physics.document() != other.physics.document()
    assert one.physics.document() != HiddenPhysics(b"another", "robot-0", "real").physics.document()


def test_each_attempt_has_noise_of_its_own_that_can_be_drawn_again():
    robot = HiddenPhysics(b"secret", "robot-0", "real")
    first, again, second = robot.of_trial(7, 1), robot.of_trial(7, 1), robot.of_trial(7, 2)
    assert first.noise_seed == again.noise_seed != second.noise_seed
    assert first.noise_seed != robot.of_trial(8, 1).noise_seed
    assert 0 <= first.noise_seed < 2**53
    assert first.physics.document() == again.physics.document()


def test_the_command_prints_what_the_robot_has(tmp_path, capsys):
    secret = farm_secret(tmp_path / "robots", None)
    (tmp_path / "robots" / "robot-2").mkdir()
    assert hidden_physics.main(["--data", str(tmp_path), "--robot", "robot-2", "--physics", "real", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["effects"] == HiddenPhysics(secret, "robot-2", "real").physics.document()
    assert printed["robot"] == "robot-2"


def test_the_command_draws_no_secret_of_its_own(tmp_path, capsys):
    assert hidden_physics.main(["--data", str(tmp_path), "--robot", "robot-2"]) == 2
    assert "farm-secret" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("seed", [[], ["--farm-seed", "5"]])
def test_a_robot_that_never_was_has_no_physics(seed, tmp_path, capsys):
    farm_secret(tmp_path / "robots", None)
    for robot in ("robot-10", "robot-9"):
        (tmp_path / "robots" / robot).mkdir()
    assert hidden_physics.main(["--data", str(tmp_path), "--robot", "nope", "--json", *seed]) == 2
    printed = capsys.readouterr()
    error = json.loads(printed.out)["error"]
    assert "'nope'" in error["detail"] and error["detail"].endswith("robot-9, robot-10") and error["exit_code"] == 2
    assert printed.err == f"error: {error['detail']}\n"


@pytest.mark.parametrize("kept", [b"", b"short", b"x" * (SECRET_BYTES + 1)])
def test_a_file_that_is_no_secret_is_refused(kept, tmp_path, capsys):
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / SECRET_FILE).write_bytes(kept)
    with pytest.raises(ValueError, match=f"has {len(kept)} bytes instead of {SECRET_BYTES}"):
        farm_secret(folder, None)
    (folder / "robot-2").mkdir()
    assert hidden_physics.main(["--data", str(tmp_path), "--robot", "robot-2"]) == 2
    assert f"has {len(kept)} bytes" in capsys.readouterr().err


def test_a_secret_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    steps = []
    sync, link = os.fsync, os.link
    monkeypatch.setattr(os, "fsync", lambda number: (steps.append(("sync", os.fstat(number).st_size)), sync(number)))
    monkeypatch.setattr(os, "link", lambda *names: (steps.append(("link",)), link(*names)))
    farm_secret(tmp_path, None)
    assert steps == [("sync", SECRET_BYTES), ("link",)]


def test_the_command_takes_the_seed_from_the_environment(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv(FARM_SEED_VARIABLE, "5")
    (tmp_path / "robots" / "robot-2").mkdir(parents=True)
    assert hidden_physics.main(["--data", str(tmp_path), "--robot", "robot-2", "--json"]) == 0
    expected = HiddenPhysics(farm_secret(tmp_path, 5), "robot-2", "real").physics.document()
    assert json.loads(capsys.readouterr().out)["effects"] == expected


def test_the_digest_is_the_farms_and_changes_with_the_seed_and_with_what_is_behind_a_name(tmp_path):
    secret, other = farm_secret(tmp_path, 5), farm_secret(tmp_path, 6)
    digest = HiddenPhysics(secret, "robot-0", "real").digest()
    assert digest == HiddenPhysics(secret, "robot-7", "real").digest()
    assert len({digest, HiddenPhysics(other, "robot-0", "real").digest(), HiddenPhysics(secret, "robot-0", "mild").digest()}) == 3
    file = tmp_path / "own.toml"
    digests = set()
    for damping in (0.0001, 0.0002):
        file.write_text(f"[viscous_friction]\ndamping_nm_s_rad = {damping}\n")
        digests.add(HiddenPhysics(secret, "robot-0", str(file)).digest())
    assert len(digests) == 2
