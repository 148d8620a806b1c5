"""docs/cli.md says what the commands really take, print and exit with."""

import re
from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup
from typer.main import get_command

from api_schemas.canary import Canary
from api_schemas.comparison import Comparison
from api_schemas.job import Job, JobPage
from api_schemas.ladder import Ladder
from api_schemas.policy import PolicyCheck
from api_schemas.report import IdentificationReport, Report
from api_schemas.robot import Robot
from api_schemas.signature import Signature
from api_schemas.status import FarmStatus
from api_schemas.token import NewToken
from chaos import run
from chaos.promises import Evidence, check
from client_cli.commands import demo, fetch, identify, pack, top, up, verify
from client_cli.connection.settings import Connection
from client_cli.embedded.farm import EmbeddedFarm
from client_cli.main import app
from client_cli.packing.packed_files import Packed
from client_cli.terminal.exit_codes import MEANING
from tests.unit.client_cli.farm_server import STATUS, FarmState, job

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "cli.md").read_text()
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
    "token create": NewToken.model_fields,
    "token list": {"tokens": ()},
    "token revoke TOKEN": {"token_id": "", "revoked": True},
}
"""What the commands that are not said to print another command's document print."""


def walk(command, path):
    """Every command that can be called, by what a user types for it."""
    arguments = [parameter for parameter in command.params if parameter.param_type_name == "argument"]
    if path and (not hasattr(command, "commands") or command.invoke_without_command):
        yield " ".join([*path, *(argument.metavar for argument in arguments)]), command
    if isinstance(command, TyperGroup):
        context = typer.Context(command)
        for name in command.list_commands(context):
            yield from walk(command.get_command(context, name), [*path, name])


COMMANDS = dict(walk(get_command(app), []))
SECTIONS = {
    title: text for title, text in re.findall(r"^### `trifarm ([^`]+)`\n(.*?)(?=^### |\Z)", PAGE, re.MULTILINE | re.DOTALL)
}


def names_after(label, section):
    """The names in backticks of the paragraph that begins with ``label``, except those in parentheses."""
    paragraph = re.search(rf"^{label}: (.*?)\n\n", section, re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`]+)`", re.sub(r"\([^)]*\)", "", paragraph[1])) if paragraph else None


def test_the_page_has_every_command_and_no_other():
    assert list(SECTIONS) == sorted(COMMANDS, key=list(SECTIONS).index)


@pytest.mark.parametrize("title", COMMANDS)
def test_flags_are_those_of_the_command(title):
    documented = re.findall(r"^\| `(--[a-z-]+)` \|", SECTIONS[title], re.MULTILINE)
    real = [name for parameter in COMMANDS[title].params for name in parameter.opts if name.startswith("--")]
    assert sorted(documented) == sorted(real)


@pytest.mark.parametrize("title", COMMANDS)
def test_exit_codes_are_those_of_the_help(title):
    documented = re.search(r"^Exit codes: ([\d, ]+)$", SECTIONS[title], re.MULTILINE)
    assert documented
    assert re.findall(r"\d+", documented[1]) == re.findall(r"(\d+) [a-z]", COMMANDS[title].epilog)


@pytest.mark.parametrize("title", JSON_KEYS)
def test_json_keys_are_those_of_the_document(title):
    assert names_after("JSON keys", SECTIONS[title]) == list(JSON_KEYS[title])


def test_the_keys_of_a_robot_are_listed():
    assert names_after("Each robot", SECTIONS["robots"]) == list(Robot.model_fields)


def test_keys_of_an_identifications_report_are_those_of_its_schema():
    assert names_after("Keys of an identification", SECTIONS["report ID"]) == list(IdentificationReport.model_fields)


@pytest.mark.parametrize("title", COMMANDS)
def test_every_command_that_prints_has_json(title):
    assert "--json" in [name for parameter in COMMANDS[title].params for name in parameter.opts]


def test_the_table_of_exit_codes_is_complete():
    rows = re.findall(r"^\| (\d+) \| (.+) \|$", PAGE, re.MULTILINE)
    assert rows == [(str(int(code)), text) for code, text in MEANING.items()]


def test_the_recipes_that_are_named_are_those_that_are_shipped():
    recipes = Path(__file__).resolve().parents[3] / "sim_backend" / "training" / "recipes"
    named = re.search(r"name of a shipped recipe: (.*?)\. Needs", SECTIONS["train RECIPE"], re.DOTALL)
    assert named
    assert re.findall(r"`([^`]+)`", named[1]) == sorted(path.stem for path in recipes.glob("*.toml"))
