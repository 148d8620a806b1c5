"""The pages of ``docs/cli``: one section for each command."""

import re

from tests import ROOT

FOLDER = ROOT / "docs" / "cli"
PAGES = {path.name: path.read_text() for path in sorted(FOLDER.glob("*.md"))}
SECTIONS = {
    title: text
    for page in PAGES.values()
    for title, text in re.findall(r"^## `trifarm ([^`]+)`\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
}
"""By what a user types after ``trifarm``."""


def names_after(label, section):
    """The names in backticks of the paragraph that begins with ``label``, except those in parentheses."""
    paragraph = re.search(rf"^{label}: (.*?)\n\n", section, re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`]+)`", re.sub(r"\([^)]*\)", "", paragraph[1])) if paragraph else None
