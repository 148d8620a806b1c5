"""What robots would be told is refused before anything starts, in one sentence."""

import re

import pytest

from robot_farm.checking import main
from robot_farm.faults import FORM, KINDS
from tests.cli_pages import SECTIONS


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--fault", "foo"], FORM),
        (["--fault", "robot-0:hiccup"], "stuck_joint"),
        (["--fault", "robot-2:controller_restart@3"], "the robots are robot-0 to robot-1"),
        (["--physics", "absent.toml"], "absent.toml"),
    ],
    ids=" ".join,
)
def test_what_cannot_be_is_refused(flags, said, capsys):
    assert main(["--robots", "2", "--physics", "real", *flags]) == 2
    assert said in capsys.readouterr().out


def test_a_file_that_is_no_physics_is_refused(tmp_path, capsys):
    (tmp_path / "bad.toml").write_text("[magic]\nsize = 3\n")
    assert main(["--robots", "2", "--physics", str(tmp_path / "bad.toml")]) == 2
    assert "bad.toml" in capsys.readouterr().out


def test_what_can_be_is_not(capsys):
    faults = ("robot-1:stuck_joint:finger0_base_to_upper@2+3.5", "robot-0:dead_camera:camera60")
    assert main(["--robots", "2", "--physics", "mild", *(part for fault in faults for part in ("--fault", fault))]) == 0
    assert capsys.readouterr().out == ""


def test_the_page_names_the_form_and_every_kind():
    section = SECTIONS["up"].split("### Faults")[1]
    assert FORM in section
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == list(KINDS)
