"""What the bus of a process is: open or guarded, a router or a client; and what is missing is said before it starts."""

import json
import subprocess
import sys

import pytest
from pydantic import ValidationError

from services.errors import NotReady
from services.joining.rules import access_rules
from services.joining.session import session_config
from services.settings import Settings
from services.signing import FarmKey

KEY = FarmKey(bytes(32))


def config(key=KEY, **settings):
    return json.loads(session_config(Settings(**settings), key))


def test_an_open_bus_has_neither_certificates_nor_rules():
    made = config(None, bus="tcp/127.0.0.1:1")
    assert (made["mode"], made["listen"]["endpoints"]) == ("router", ["tcp/127.0.0.1:1"])
    assert "tls" not in made["transport"]["link"]
    assert "access_control" not in made


def test_a_guarded_router_has_both_and_a_client_shows_a_certificate():
    router = config(bus="tls/127.0.0.1:1", bus_robots=2)
    assert router["transport"]["link"]["tls"]["enable_mtls"]
    assert [each["id"] for each in router["access_control"]["subjects"]] == ["services of the farm", "robot-0", "robot-1"]
    client = config(bus_connect="tls/127.0.0.1:1")
    assert client["mode"] == "client"
    assert client["transport"]["link"]["tls"]["verify_name_on_connect"]


def test_every_rule_of_a_robot_is_about_its_own_keys():
    rules = access_rules("farm", ("robot-1", "robot-12"))
    assert rules["default_permission"] == "deny"
    by_name = {rule["id"]: rule for rule in rules["rules"]}
    for policy in rules["policies"][1:]:
        (robot,) = policy["subjects"]
        shared, *own = policy["rules"]
        assert by_name[shared]["messages"] == ["declare_subscriber"]
        assert by_name[shared]["flows"] == ["egress"]
        assert all(f"/robot/{robot}/" in key and "*" not in key for name in own for key in by_name[name]["key_exprs"])


def test_what_a_guarded_bus_lacks_is_said(tmp_path):
    with pytest.raises(NotReady, match="set TRIFARM_FARM_KEY"):
        config(None, bus="tls/127.0.0.1:1", data=tmp_path)
    assert list(tmp_path.iterdir()) == []  # no key of its own, which nobody would believe
    with pytest.raises(NotReady, match="set TRIFARM_BUS_ADDRESSES"):
        config(bus="tls/0.0.0.0:1")
    config(bus="tls/0.0.0.0:1", bus_addresses="tls/farm.example.org:1")
    with pytest.raises(ValidationError, match="either all begin with tls/ or none"):
        Settings(bus="tcp/0.0.0.0:1", bus_addresses="tls/farm.example.org:1")


def test_the_key_of_the_data_folder_will_do(tmp_path):
    FarmKey.of(tmp_path)
    assert config(None, bus="tls/127.0.0.1:1", data=tmp_path)["mode"] == "router"


def test_a_router_needs_of_the_farms_key_only_what_is_printed_for_it(tmp_path):
    FarmKey.of(tmp_path)
    command = [sys.executable, "-P", "-m", "services", "bus-key", "--data", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    router = config(None, bus="tls/127.0.0.1:1", data=tmp_path / "empty", bus_key=printed)
    client = config(FarmKey.of(tmp_path), bus_connect="tls/127.0.0.1:1")
    assert trusted_by(router) == trusted_by(client)
    assert bytes.fromhex(printed) != FarmKey.of(tmp_path).seed
    with pytest.raises(NotReady, match="TRIFARM_BUS_KEY is not 64 hexadecimal digits"):
        config(None, bus="tls/127.0.0.1:1", data=tmp_path, bus_key="x")


def trusted_by(made):
    return made["transport"]["link"]["tls"]["root_ca_certificate_base64"]
