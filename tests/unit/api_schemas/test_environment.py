"""The one list of the project's variables names all that its programs read, and says what else may have been meant."""

import re
from pathlib import Path

import pytest

from api_schemas.environment import KNOWN, OF_CHAOS, OF_ROBOTS, OF_SERVICES, unknown_settings
from robot_farm import settings as robots
from services.settings import Settings

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = "api_schemas chaos client_cli deploy experiments jail robot_farm services sim_backend tests/readers trial_logs trifarm"
NAME = re.compile(r"\bTRIFARM_[A-Z0-9]+(?:_[A-Z0-9]+)*\b")


def test_the_services_variables_are_those_of_their_settings():
    assert {f"TRIFARM_{name.upper()}" for name in Settings.model_fields} == OF_SERVICES


def test_the_robots_variables_are_those_of_their_settings():
    assert {value for name, value in vars(robots).items() if name.endswith("_VARIABLE")} == OF_ROBOTS


def test_every_variable_that_code_and_deployments_name_is_known():
    files = [path for folder in FOLDERS.split() for path in (ROOT / folder).rglob("*.*") if path.suffix in {".py", ".yaml"}]
    files += [ROOT / "docker-compose.yml", ROOT / "Dockerfile"]
    named = {name for path in files for name in NAME.findall(path.read_text())}
    assert len(named) > len(OF_SERVICES)
    assert {name for name in named if not name.startswith(OF_CHAOS)} <= KNOWN | {"TRIFARM_PORT_8787_TCP", "TRIFARM_CHAOS"}


@pytest.mark.parametrize(
    ("name", "meant"),
    [("TRIFARM_WEBHOKS", "TRIFARM_WEBHOOKS"), ("TRIFARM_KEEP_LOG_DAYS", "TRIFARM_KEEP_LOGS_DAYS"), ("TRIFARM_QZX", None)],
)
def test_what_nobody_reads_is_told_with_what_may_have_been_meant(name, meant):
    told = unknown_settings({name: "secret", "HOME": "/", "TRIFARM_WEBHOOKS": "true", "TRIFARM_CHAOS_NAME": "a"})
    hint = "" if meant is None else f"; did you mean {meant}?"
    assert told == {name: f"no program of trifarm reads {name}{hint}"}
