"""The first study of the documents: its two commands, in an empty folder, say what the page says."""

import re
import shlex
import subprocess
import sys

from tests import ROOT

PAGE = (ROOT / "docs/reality-gap.md").read_text().partition("## A first study")[2]


def test_its_commands_say_what_the_page_says(tmp_path):
    commands, said = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1].splitlines() for kind in ("console", "text"))
    for command in commands:
        program, *words = shlex.split(command.replace("docs/", f"{ROOT}/docs/"))
        start = [sys.executable, *(["-m", "client_cli"] if program == "trifarm" else [])]
        ran = subprocess.run([*start, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
    whole = [line for line in said if line.startswith(("first-study:", "The robot goes", "Cause:"))]
    assert len(whole) == 3 and all(line in ran.stdout.splitlines() for line in whole), ran.stdout
    assert (tmp_path / "gap-first/report.html").is_file() and (tmp_path / "gap-first/extended-model.xml").is_file()
