"""docs/cli says what the commands really take, print and exit with."""

import re
import runpy
from pathlib import Path

import pytest

from api_schemas.canary import Canary
from api_schemas.comparison import Comparison
from api_schemas.job import Job, JobPage
from api_schemas.ladder import Ladder
from api_schemas.policy import PolicyCheck
from api_schemas.report import IdentificationReport, Report
from api_schemas.robot import Robot
from api_schemas.share import NewShare
from api_schemas.signature import Signature
from api_schemas.status import FarmStatus
from api_schemas.token import NewToken
from chaos import run
from chaos.promises import Evidence, check
from client_cli.commands import demo, fetch, identify, pack, top, up, verify
from client_cli.connection.settings import Connection
from client_cli.embedded.farm import EmbeddedFarm
from client_cli.main import GROUPS
from client_cli.packing.packed_files import Packed
from tests import ROOT
from tests.cli_pages import PAGES, SECTIONS, names_after
from tests.unit.client_cli.farm_server import STATUS, FarmState, job

MAKER = ROOT / "docs/cli_pages.py"
FARM = EmbeddedFarm(Connection("", None), "", Path(), 4, "nominal", Path(), ())
SIGNATURE = Signature(key="0" * 64, job_id="", policy="", report_sha256="0" * 64, parts={}, signature="0" * 128)
NO_EVIDENCE = Evidence((), {}, (), (), {}, {}, 0.0, 0.0)
JSON_KEYS = {
    "up": up.document(FARM),
    "demo": demo.document(demo.DemoResult(job(FarmState()), None, None, None)),
    "submit FILE": Job.model_fields,
    "check FILE": PolicyCheck.model_fields,
    "jobs": JobPage.model_fields,
    "ladder ID": Ladder.model_fields,
    "report ID": Report.model_fields,
    "compare ID...": Comparison.model_fields,
    "verify REPORT": verify.document(verify.Verified(SIGNATURE, (), True)),
    "fetch ID": fetch.document(fetch.Fetched(job(FarmState()), Path(), (), (), 0, 0, None)),
    "pack FILE...": pack.document(Packed(Path(), Path(), "", 0.0, "", ())),
    "identify": identify.document(identify.Identified(job(FarmState()), None)),
    "robots": {"robots": ()},
    "robots forget ROBOT": {"robot": "", "forgotten": True},
    "policy delete DIGEST": {"digest": "", "deleted": True},
    "canary": Canary.model_fields,
    "canary off": {"dropped": True},
    "status": FarmStatus.model_fields,
    "top": top.document(top.Seen(STATUS, (), ())),
    "chaos": run.document(check(NO_EVIDENCE, bool), [], run.About("", "", 0, False, False, True, None, 0.0, 0.0)),
    "share create JOB|TRIAL": NewShare.model_fields,
    "share list": {"shares": ()},
    "share revoke SHARE": {"share_id": "", "revoked": True},
    "token create": NewToken.model_fields,
    "token list": {"tokens": ()},
    "token revoke TOKEN": {"token_id": "", "revoked": True},
}
"""What the commands that are not said to print another command's document print."""


def made():
    """What the program that writes the pages knows."""
    return runpy.run_path(str(MAKER))


def test_the_pages_are_those_of_the_commands():
    assert made()["pages"]() == PAGES, "python docs/cli_pages.py writes them anew"


def test_a_page_of_a_group_that_is_gone_is_removed(tmp_path):
    (tmp_path / "gone.md").write_text("# Gone\n")
    made()["write"](tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == PAGES


def test_a_note_about_a_command_that_is_gone_is_an_error(tmp_path):
    program = made()
    notes = tmp_path / "notes.md"
    notes.write_text(f"{program['NOTES'].read_text()}\n## gone\n\nIt was there.\n")
    program["pages"].__globals__["NOTES"] = notes
    with pytest.raises(ValueError, match=r"notes\.md tells of gone"):
        program["pages"]()


def test_links_within_the_pages_lead_to_a_heading():
    program = made()
    for name, page in PAGES.items():
        for target, anchor in re.findall(r"\]\(((?:[\w-]+\.md)?)#([\w-]+)\)", page):
            headings = re.findall(r"^#+ (.+)$", PAGES[target or name], re.MULTILINE)
            assert anchor in {program["_anchor"](heading) for heading in headings}, f"{name}: {target}#{anchor}"


@pytest.mark.parametrize("title", JSON_KEYS)
def test_json_keys_are_those_of_the_document(title):
    assert names_after("JSON keys", SECTIONS[title]) == list(JSON_KEYS[title])


def test_the_keys_of_a_robot_are_listed():
    assert names_after("Each robot", SECTIONS["robots"]) == list(Robot.model_fields)


def test_keys_of_an_identifications_report_are_those_of_its_schema():
    assert names_after("Keys of an identification", SECTIONS["report ID"]) == list(IdentificationReport.model_fields)


@pytest.mark.parametrize("name", [name for group in GROUPS.values() for name in group])
def test_every_command_that_prints_has_json(name):
    for _, command in made()["commands"](name):
        assert "--json" in [option for parameter in command.params for option in parameter.opts]


def test_the_recipes_that_are_named_are_those_that_are_shipped():
    recipes = ROOT / "sim_backend" / "training" / "recipes"
    named = re.search(r"Shipped recipes are (.*?);", SECTIONS["train RECIPE"], re.DOTALL)
    assert named
    assert re.findall(r"`([^`]+)`", named[1]) == sorted(path.stem for path in recipes.glob("*.toml"))
