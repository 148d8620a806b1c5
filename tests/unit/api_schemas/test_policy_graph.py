"""The runtime reports to nobody, whoever asks for it."""

import os
import re
import subprocess
import sys

import pytest

from tests import ROOT

PACKAGES = ("api_schemas", "client_cli", "robot_farm", "services", "sim_backend")
THREADS = "import os; print(len(os.listdir('/proc/self/task')))"


def test_nobody_imports_it_but_the_one_file():
    imports = re.compile(r"^\s*(import|from) onnxruntime\b", re.MULTILINE)
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    found = [path.relative_to(ROOT).as_posix() for path in files if imports.search(path.read_text())]
    assert found == ["api_schemas/policy_graph.py"]


def threads(code: str) -> int:
    """How many threads a fresh interpreter has after it ran the code, the telemetry not switched off from outside."""
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    environment |= {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", f"{code}; {THREADS}"]
    return int(subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=120).stdout)


def test_no_thread_is_started_that_reports():
    assert threads("from api_schemas.policy_graph import runtime; runtime()") == 1
    if threads("import onnxruntime") == 1:
        pytest.skip("here the runtime starts no thread of its own on import, so there is none to be kept from starting")
