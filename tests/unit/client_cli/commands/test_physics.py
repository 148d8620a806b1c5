"""Commands that run another part of this installation: what they pass on."""

import json
import sys
from types import SimpleNamespace

import pytest

from client_cli.commands import physics
from client_cli.commands import physics as effects
from client_cli.embedded.record import FarmRecord, keep_physics, save_record


@pytest.fixture
def children(monkeypatch):
    """Commands that would have been run; the child ends with the code in ``ends_with``."""
    run = SimpleNamespace(commands=[], ends_with=0)

    def fake(module, *arguments):
        run.commands.append([module, *arguments])
        return [sys.executable, "-c", f"import sys; sys.exit({run.ends_with})"]

    for module in (effects, physics):
        monkeypatch.setattr(module, "module_command", fake)
    return run


@pytest.mark.parametrize("code", [0, 1])
def test_effects(trifarm, children, code):
    children.ends_with = code
    assert trifarm("effects", "--json").code == code
    assert children.commands == [["sim_backend.effects", "--json"]]


def test_physics_are_those_that_the_farm_was_started_with(trifarm, children, tmp_path):
    ranges = tmp_path / "mine.toml"
    ranges.touch()
    (tmp_path / "up.json").write_text(json.dumps({"physics": str(ranges), "farm_seed": 3}))
    assert trifarm("physics", "--robot", "robot-1", "--data", str(tmp_path)).code == 0
    flags = ["--data", str(tmp_path), "--robot", "robot-1", "--physics", str(ranges), "--farm-seed", "3"]
    assert children.commands == [["robot_farm.hidden_physics", *flags]]


def test_a_file_of_physics_may_be_moved_and_so_may_the_folder(trifarm, children, tmp_path):
    ranges, data = tmp_path / "mine.toml", tmp_path / "data"
    ranges.write_text("about = 'mine'")
    data.mkdir()
    kept = keep_physics(str(ranges), data)
    save_record(FarmRecord(kept, None), data)
    ranges.unlink()
    moved = data.rename(tmp_path / "moved")
    assert trifarm("physics", "--robot", "robot-1", "--data", str(moved)).code == 0
    (command,) = children.commands
    assert command[-1] == str(moved / "physics" / "mine.toml")
    assert (moved / "physics" / "mine.toml").read_text() == "about = 'mine'"
    assert keep_physics("real", moved) == "real"


def test_physics_of_a_farm_that_was_started_otherwise_must_be_said(trifarm, children, tmp_path):
    ended = trifarm("physics", "--robot", "robot-1", "--data", str(tmp_path))
    assert ended.code == 2
    assert "--physics" in ended.err
    assert trifarm("physics", "--robot", "robot-1", "--data", str(tmp_path), "--physics", "real", "--json").code == 0
    flags = ["--data", str(tmp_path), "--robot", "robot-1", "--physics", "real", "--json"]
    assert children.commands == [["robot_farm.hidden_physics", *flags]]


@pytest.mark.parametrize("stored", ["no json", "[]", "{}"])
def test_a_broken_record_is_named(trifarm, children, tmp_path, stored):
    (tmp_path / "up.json").write_text(stored)
    ended = trifarm("physics", "--robot", "robot-1", "--data", str(tmp_path))
    assert ended.code == 2
    assert "up.json" in ended.err


def test_an_absent_folder_is_wrong_usage(trifarm, children):
    assert trifarm("physics", "--robot", "robot-1", "--data", "absent").code == 2


def test_physics_that_are_no_toml_are_wrong_usage(trifarm, children, tmp_path):
    (tmp_path / "ranges.toml").write_text("this is = = no toml")
    ended = trifarm("up", "--physics", str(tmp_path / "ranges.toml"), "--data", str(tmp_path / "farm"))
    assert ended.code == 2
    assert "ranges.toml is no TOML file" in ended.err
    assert not (tmp_path / "farm").exists()
