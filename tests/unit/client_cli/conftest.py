"""A server on the loopback, and the command line in this process."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from api_schemas.policy import PolicyManifest
from client_cli.main import run
from tests.unit.client_cli.farm_server import TOKEN, FarmState, serving
from tests.unit.client_cli.packing.packed import MANIFEST


@dataclass(frozen=True)
class Ended:
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        return json.loads(self.out)


Trifarm = Callable[..., Ended]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRIFARM_HOME", str(tmp_path / "home"))
    for name in ("TRIFARM_URL", "TRIFARM_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path / "home"


@pytest.fixture(scope="session")
def server() -> Iterator[tuple[FarmState, str]]:
    """One server for all tests, since starting one takes longer than most of them."""
    state = FarmState()
    with serving(state) as url:
        yield state, url


@pytest.fixture
def farm(server: tuple[FarmState, str], home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FarmState]:
    state, url = server
    vars(state).update(vars(FarmState()))
    monkeypatch.setenv("TRIFARM_URL", url)
    monkeypatch.setenv("TRIFARM_TOKEN", TOKEN)
    yield state
    state.hang_stream = False


@pytest.fixture
def trifarm(home: Path, capsys: pytest.CaptureFixture[str]) -> Trifarm:
    def call(*arguments: str) -> Ended:
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            run(list(arguments))
        out, err = capsys.readouterr()
        return Ended(int(end.value.code or 0), out, err)

    return call


@pytest.fixture
def manifest(tmp_path: Path) -> Callable[..., Path]:
    """Writes the manifest of the packing tests with changes."""

    def write(**changes):
        path = tmp_path / "wanted.json"
        path.write_text(PolicyManifest.model_validate(json.loads(MANIFEST.model_dump_json()) | changes).model_dump_json())
        return path

    return write
