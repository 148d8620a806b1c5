from types import SimpleNamespace

import pytest
from rich.console import Console

from api_schemas.error import Problem
from api_schemas.job import JobState
from api_schemas.robot import Robot, RobotHealth, RobotState, SelfTest
from client_cli.commands import top
from client_cli.commands.top import Seen, view
from client_cli.terminal.errors import Refused
from tests.unit.client_cli.farm_server import AT, JOB_ID, STATUS, FarmState, job

HEALTH = RobotHealth(motor_temperature_rise_k=21.7, tracker_confidence=0.876, self_test=SelfTest(at=AT, wrong="joint 0 is stuck"))


def test_the_farm_is_shown_once_in_a_pipe(farm, trifarm):
    farm.state = JobState.RUNNING
    ended = trifarm("top")
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert lines[0] == "farm farm: 1 of 4 robots is lost"
    assert "! robot-0 is lost" in ended.out
    assert any(line.split()[:2] == ["robot-0", "lost"] and "no sign of life" in line for line in lines)
    assert any(JOB_ID in line and "no robot is in service" in line for line in lines)


def test_its_document_has_status_robots_and_jobs(farm, trifarm):
    document = trifarm("top", "--json").document
    assert document["status"]["problems"] == ["robot-0 is lost"]
    assert [robot["robot"] for robot in document["robots"]] == ["robot-0"]


def test_what_robots_tell_of_themselves_is_shown_and_names_are_only_text():
    robot = Robot(robot="robot-1", state=RobotState.IDLE, pid=1, host="h", trial=None, reason="[bold]why[/]", health=HEALTH)
    shown = Console(width=200, no_color=True)
    with shown.capture() as captured:
        shown.print(view(Seen(STATUS, (robot,), (job(FarmState(), policy_name="[red]x"),))))
    text = captured.get()
    assert "+22 K" in text and "0.88" in text and "failed" in text
    assert "[bold]why[/]" in text and "[red]x" in text


def test_a_server_that_is_away_is_said(trifarm, home, monkeypatch):
    monkeypatch.setenv("TRIFARM_URL", "http://127.0.0.1:9")
    assert trifarm("top", "--once").code == 4


def refused(status, detail):
    return Refused(Problem(type="/problems/some", title="some", status=status, detail=detail))


def test_who_watches_goes_on_while_the_farm_s_database_is_away(monkeypatch, capsys):
    told = iter([Seen(STATUS, (), ()), refused(503, "The database did not answer."), Seen(STATUS, (), ()), KeyboardInterrupt()])

    def now(_client):
        if isinstance(each := next(told), Seen):
            return each
        raise each

    monkeypatch.setattr(Seen, "now", now)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as in a terminal
    monkeypatch.setenv("COLUMNS", "100")
    top._follow(SimpleNamespace(url="http://farm"), 0.0)
    assert "The database did not answer; what follows is old" in capsys.readouterr().out
    told = iter([Seen(STATUS, (), ()), refused(401, "This token was revoked.")])
    with pytest.raises(Refused, match="revoked"):
        top._follow(SimpleNamespace(url="http://farm"), 0.0)
