"""The pages that operators look things up in: each setting, and each alarm, has its place, and none is of what there is not."""

import re
import runpy

import yaml

from tests import ROOT

RULES = yaml.safe_load((ROOT / "deploy/prometheus/alerts.yaml").read_text())["groups"][0]["rules"]
ALARMS = (ROOT / "docs/alarms.md").read_text()


def test_the_page_of_settings_is_written_from_the_settings():
    page = runpy.run_path(str(ROOT / "docs/settings_page.py"))["page"]()
    assert (ROOT / "docs/settings.md").read_text() == page, "python docs/settings_page.py writes it anew"
    rows = re.findall(r"^\| `(TRIFARM_[A-Z0-9_]+)` \| .*? \| (.*) \|$", page, re.MULTILINE)
    assert len(rows) > 50 and all(meaning for _, meaning in rows)


def test_each_alarm_has_a_section_that_says_what_to_do_and_each_section_a_rule():
    sections = re.findall(r"^## (\w+)$", ALARMS, re.MULTILINE)
    assert sections == [rule["alert"] for rule in RULES]
    assert [rule["annotations"]["runbook"] for rule in RULES] == [f"docs/alarms.md#{name.lower()}" for name in sections]
    pages = re.findall(r"^## (\w+)\n\n\*Now\.\*", ALARMS, re.MULTILINE)
    assert pages == [rule["alert"] for rule in RULES if rule["labels"]["severity"] == "page"]


def test_types_of_errors_that_an_alarm_names_are_told_on_the_page_of_problems():
    (asked,) = (rule["expr"] for rule in RULES if rule["alert"] == "ErrorsOfTheFarm")
    types = re.search(r'type=~"([^"]+)"', asked)[1].split("|")
    problems = (ROOT / "docs/problems.md").read_text()
    assert types and all(f"`/problems/{each}`" in problems and f"`{each}`" in ALARMS for each in types)
