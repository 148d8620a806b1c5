"""Studies are listed by their dates, opened only where they are shown, and may go at any moment."""

import os
import shutil

import pytest

from services.dashboard import studies_page
from services.dashboard.studies_page import MOST_LISTED, REPORT, studies


@pytest.fixture
def folder(tmp_path):
    for number in range(MOST_LISTED + 5):
        file = tmp_path / f"study-{number:03d}" / REPORT
        file.parent.mkdir()
        file.write_text(f"<title>Study {number}</title>")
        os.utime(file, (number, number))
    return tmp_path


def test_only_what_is_listed_is_opened(folder, monkeypatch):
    opened, read = [], studies_page.report
    monkeypatch.setattr(studies_page, "report", lambda *asked: opened.append(asked[1]) or read(*asked))
    listed = studies(folder)
    assert [each.title for each in listed] == [f"Study {number}" for number in range(MOST_LISTED + 4, 4, -1)]
    assert len(opened) == MOST_LISTED


def test_a_study_that_goes_while_they_are_listed_is_left_out(folder, monkeypatch):
    read = studies_page.report

    def removing(*asked):
        body = read(*asked)
        shutil.rmtree(folder / "study-007", ignore_errors=True)
        if asked[1] == "study-009":
            shutil.rmtree(folder / "study-009")
        return body

    monkeypatch.setattr(studies_page, "report", removing)
    names = {each.name for each in studies(folder)}
    assert "study-007" not in names and "study-009" in names and len(names) == MOST_LISTED - 1


def test_links_and_folders_are_no_reports(folder, tmp_path):
    (folder / "a" / REPORT).mkdir(parents=True)
    (folder / "b").mkdir()
    (folder / "b" / REPORT).symlink_to(folder / "study-001" / REPORT)
    (folder / "c").mkdir()
    assert not {"a", "b", "c"} & {each.name for each in studies(folder)}
