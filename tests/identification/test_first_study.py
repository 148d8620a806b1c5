"""The first study of the documents: its two commands, in an empty folder, say what the page says, and the way ends with them."""

import json
import re
import shlex
import shutil
import subprocess
import sys

import pytest

from sim_backend.reality_gap.advice.answer import read_study
from sim_backend.reality_gap.study import run_study
from sim_backend.reality_gap.verdict import VerdictKind
from tests import ROOT

PAGE = (ROOT / "docs/reality-gap.md").read_text().partition("## A first study")[2]
COMMANDS, SAID = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1].splitlines() for kind in ("console", "text"))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The folder in which its commands ran, and what the last one said."""
    folder = tmp_path_factory.mktemp("first")
    for command in COMMANDS:
        program, *words = shlex.split(command.replace("docs/", f"{ROOT}/docs/"))
        start = [sys.executable, *(["-m", "client_cli"] if program == "trifarm" else [])]
        ended = subprocess.run([*start, *words], cwd=folder, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
    return folder, ended.stdout


def test_its_commands_say_what_the_page_says(ran):
    folder, said = ran
    whole = [line for line in SAID if line.startswith(("first-study:", "The robot goes", "Cause:"))]
    assert len(whole) == 3 and all(line in said.splitlines() for line in whole), said
    assert (folder / "gap-first/report.html").is_file()


def test_with_its_extended_model_nothing_more_is_found(ran, tmp_path):
    folder, _ = ran
    shutil.copy(ROOT / "docs/studies/first-study/study.toml", tmp_path / "study.toml")
    shutil.copy(folder / "gap-first/extended-model.xml", tmp_path / "model.xml")
    told = read_study(folder / "gap-first").model
    assert told is not None and told.is_file(), "for whoever records the next motion of this robot"
    again = run_study(tmp_path / "study.toml", tmp_path / "again", data_root=folder / "first-data").verdict
    before = json.loads((folder / "gap-first/study.json").read_text())["verdict"]["held_out"]["before"]
    assert again.verdict is VerdictKind.NOTHING_WRONG, again.summary
    assert again.held_out is not None and again.held_out.before < 0.05 * before
