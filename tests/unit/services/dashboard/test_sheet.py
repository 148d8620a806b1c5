"""All trials of a job at a glance: why they failed, where their goals lay, and what their pictures are drawn from."""

from types import SimpleNamespace

import pytest

from api_schemas.goal import ARENA_RADIUS_M
from api_schemas.trial import FAULT_OF, FailureCause, Glimpse, Outcome, OutcomeKind
from services.dashboard import sheet
from services.dashboard.pages import part

POSE = (0.0, 0.0, 0.03, 1.0, 0.0, 0.0, 0.0)
HOSTILE = """<img src=x onerror=alert(1)>"'&{{7*7}}"""


def trial(ordinal, kind="succeeded", cause=None, at_s=None, goal=None):
    failure = None if cause is None else FailureCause(kind=cause, sentence=f"{HOSTILE} {ordinal}", at_s=at_s)
    glimpse = None if goal is None else Glimpse(t_s=(0.0,), joint_position_rad=((0.0,) * 9,), tracked_pose=(POSE,), goal=goal)
    kind = OutcomeKind(kind)
    outcome = Outcome(kind=kind, fault=FAULT_OF[kind], reason="so it ended", failure=failure, glimpse=glimpse)
    return SimpleNamespace(trial_id=f"jx-{ordinal:03d}", ordinal=ordinal, robot="robot-0"), outcome


ENDED = [
    trial(0),
    trial(1, "failed", "left", 2.7),
    trial(2, "failed", "at_wall"),
    trial(3, "failed", "left", 0.0),
    trial(4, "nonfinite_action"),
]


def test_failures_come_first_and_the_most_frequent_of_them_before_the_others():
    groups = sheet.grouped(ENDED)
    told = [(group.word, [tile.ordinal for tile in group.tiles]) for group in groups]
    assert told == [
        ("left its goal", [1, 3]),
        ("at the wall", [2]),
        ("policy error: nonfinite action", [4]),
        ("succeeded", [0]),
    ]
    addresses = {tile.ordinal: tile.address for group in groups for tile in group.tiles}
    assert addresses[1] == "/trials/jx-001?t=2.70", "at the moment that decided"
    assert addresses[3] == "/trials/jx-003?t=0.00"
    assert addresses[2] == "/trials/jx-002", "nobody knows when"


def test_what_is_too_many_is_counted(monkeypatch):
    monkeypatch.setattr(sheet, "MOST_TILES", 3)
    assert [(len(group.tiles), group.left_out) for group in sheet.grouped(ENDED)] == [(2, 0), (1, 0), (0, 1), (0, 1)]


def test_goals_lie_on_the_floor_as_seen_from_above():
    right = (ARENA_RADIUS_M, 0.0, *POSE[2:])
    far = (0.0, ARENA_RADIUS_M / 2, *POSE[2:])
    tips = (0.1,) * 9
    found = sheet.spots([trial(0, goal=right), trial(1, "failed", goal=far), trial(2, goal=tips), trial(3)])
    assert [(spot.x, spot.y, spot.tile.succeeded) for spot in found] == [(100, 50, True), (50, 25, False)]
    assert found[0].height_mm == pytest.approx(30)


def test_pictures_are_drawn_from_the_poses_of_trials_that_have_some():
    assert list(sheet.glimpses([trial(0, goal=POSE), trial(1)])) == ["jx-000"]


def test_words_of_others_are_only_text():
    for html in (
        part("job/sheet.html", groups=sheet.grouped(ENDED), ended=True),
        part("job/map.html", spots=sheet.spots([trial(1, "failed", "left", 1.0, POSE)]), known=True, ended=True),
    ):
        assert "<img" not in html and "&lt;img src=x" in html and "{{7*7}}" in html
        assert " style=" not in html
