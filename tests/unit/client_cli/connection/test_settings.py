import json
import stat

import pytest

from client_cli.connection.settings import (
    DEFAULT_URL,
    Connection,
    default_data_folder,
    load_connection,
    save_connection,
    settings_file,
)
from client_cli.terminal.errors import UsageProblem
from trifarm import Farm


def test_a_saved_connection_is_found_again_and_is_private(tmp_path):
    path = save_connection(Connection("http://farm:1", "secret"), tmp_path / "new")
    assert load_connection({"TRIFARM_HOME": str(tmp_path / "new")}) == Connection("http://farm:1", "secret")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert json.loads(path.read_text()) == {"url": "http://farm:1", "token": "secret"}
    assert [entry.name for entry in path.parent.iterdir()] == ["settings.json"]


def test_each_environment_variable_wins_on_its_own(tmp_path):
    save_connection(Connection("http://farm:1", "stored"), tmp_path)
    home = {"TRIFARM_HOME": str(tmp_path)}
    assert load_connection(home | {"TRIFARM_URL": "http://other:2/"}) == Connection("http://other:2", None)
    assert load_connection(home | {"TRIFARM_TOKEN": "given"}) == Connection("http://farm:1", "given")


@pytest.mark.parametrize(
    ("asked", "is_same"),
    [
        ("http://farm:1/", True),
        ("http://FARM:1", True),
        ("https://farm:1", False),
        ("http://farm:2", False),
        ("http://farm", False),
        ("http://farm:1.evil.example", False),
        ("http://farm:1@evil.example:1", False),
    ],
)
def test_the_stored_token_is_shown_to_its_own_farm_alone(tmp_path, asked, is_same):
    save_connection(Connection("http://farm:1", "stored"), tmp_path)
    for given in ({"TRIFARM_URL": asked}, {}):
        try:
            token = load_connection({"TRIFARM_HOME": str(tmp_path)} | given, None if given else asked).token
        except UsageProblem:
            token = None
        assert token == ("stored" if is_same else None)


def test_a_program_names_address_and_token_itself(tmp_path, monkeypatch):
    save_connection(Connection("http://farm:1", "stored"), tmp_path)
    monkeypatch.setenv("TRIFARM_HOME", str(tmp_path))
    for name in ("TRIFARM_URL", "TRIFARM_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    seen = []
    monkeypatch.setattr("trifarm.farm.ApiClient", seen.append)
    Farm("http://other:2")
    Farm("http://other:2", "own")
    Farm()
    assert [connection.token for connection in seen] == [None, "own", "stored"]


def test_ends_of_lines_around_a_token_are_left_out(tmp_path):
    assert load_connection({"TRIFARM_HOME": str(tmp_path), "TRIFARM_TOKEN": " trifarm_a_b\r\n"}).token == "trifarm_a_b"


@pytest.mark.parametrize("token", ["geheim-schlüssel", "two words", "line\rline", "bell\x07"])
def test_what_no_token_can_be_is_refused_without_being_quoted(trifarm, monkeypatch, token):
    monkeypatch.setenv("TRIFARM_TOKEN", token)
    ended = trifarm("status", "--json")
    assert ended.code == 2
    assert "TRIFARM_TOKEN" in ended.err
    assert token[:3] not in ended.out + ended.err.removeprefix("error: ")


def test_without_anything_the_default_address_is_used(tmp_path):
    assert load_connection({"TRIFARM_HOME": str(tmp_path)}) == Connection(DEFAULT_URL, None)


@pytest.mark.parametrize("content", ["{", "[]", '{"url": 5}'])
def test_a_broken_settings_file_is_named(tmp_path, content):
    settings_file(tmp_path).write_text(content)
    with pytest.raises(UsageProblem, match=r"settings\.json"):
        load_connection({"TRIFARM_HOME": str(tmp_path)})


def test_an_address_without_scheme_is_refused(tmp_path):
    with pytest.raises(UsageProblem, match="http://"):
        load_connection({"TRIFARM_HOME": str(tmp_path), "TRIFARM_URL": "localhost:8787"})


def test_data_live_in_the_named_home_or_among_the_users_data(tmp_path):
    assert default_data_folder({"TRIFARM_HOME": str(tmp_path)}) == tmp_path / "farm"
    assert default_data_folder({"XDG_DATA_HOME": str(tmp_path)}) == tmp_path / "trifarm" / "farm"
