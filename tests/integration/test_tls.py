"""The services over https: the command line and the robots trust the certificate that they are told to trust, and no other."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from robot_farm.link.api_link import ApiUnreachableError, own_token
from tests.integration.farm_process import ROOT, services

EXTENSIONS = (
    "subjectAltName=IP:127.0.0.1,DNS:localhost",
    "basicConstraints=critical,CA:TRUE",
    "keyUsage=critical,digitalSignature,keyCertSign",
)


def self_signed(folder, name):
    """A certificate for this machine and its key."""
    certificate, key = folder / f"{name}.pem", folder / f"{name}-key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    command += ["-subj", "/CN=localhost", "-keyout", str(key), "-out", str(certificate)]
    for extension in EXTENSIONS:
        command += ["-addext", extension]
    subprocess.run(command, check=True, capture_output=True)
    return certificate, key


def status(farm, **environment):
    """``trifarm status --json`` as a user runs it."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("TRIFARM_", "SSL_"))}
    told = {"TRIFARM_URL": farm.api, "TRIFARM_TOKEN": farm.tokens["admin"], "TRIFARM_HOME": str(farm.data.parent / "home")}
    command = [sys.executable, "-m", "client_cli", "status", "--json"]
    environment = clean | told | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl, which makes the certificate of this test, is not installed")
def test_the_status_over_https(tmp_path):
    certificate, key = self_signed(tmp_path, "farm")
    other, _ = self_signed(tmp_path, "other")
    with services(tmp_path / "farm", tls_certificate=certificate, tls_key=key) as farm:
        assert farm.api.startswith("https://")
        good = status(farm, TRIFARM_CA=str(certificate))
        assert good.returncode == 0, good.stderr
        assert json.loads(good.stdout)["farm"] == "farm"
        by_name = status(farm, TRIFARM_CA=str(certificate), TRIFARM_URL=farm.api.replace("127.0.0.1", "localhost"))
        assert by_name.returncode == 0, by_name.stderr
        for untrusted in ({}, {"TRIFARM_CA": str(other)}):
            refused = status(farm, **untrusted)
            assert refused.returncode != 0
            assert "certificate" in refused.stderr.lower(), refused.stderr
        missing = status(farm, TRIFARM_CA=str(tmp_path / "nothing.pem"))
        assert "TRIFARM_CA" in missing.stderr
        joined = own_token(farm.api, farm.tokens["robot"], "robot-0", ca=certificate)
        assert farm.client(joined).get("/v1/status").status_code == 200
        with pytest.raises(ApiUnreachableError, match=r"(?i)certificate"):
            own_token(farm.api, farm.tokens["robot"], "robot-0")
