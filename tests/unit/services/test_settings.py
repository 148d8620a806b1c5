import json
import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from jail.level import JailLevel
from services.__main__ import parsed
from services.dashboard.trial_page import viewers


def test_flags_win_over_variables_over_defaults(monkeypatch):
    assert parsed(["serve"])[1].port == 8787
    monkeypatch.setenv("TRIFARM_PORT", "1234")
    monkeypatch.setenv("TRIFARM_PASS_OVER_S", "5")
    assert parsed(["serve"])[1].port == 1234
    assert parsed(["serve", "--port", "99"])[1].port == 99
    assert parsed(["serve"])[1].pass_over_s == 5


def test_the_least_jail_is_a_setting(monkeypatch):
    assert parsed(["serve"])[1].jail_level is JailLevel.LIMITS
    monkeypatch.setenv("TRIFARM_JAIL_LEVEL", "filesystem")
    assert parsed(["serve"])[1].jail_level is JailLevel.FILESYSTEM
    assert parsed(["serve", "--jail-level", "full"])[1].jail_level is JailLevel.FULL


def test_no_log_is_opened_on_another_site_unless_the_operator_names_it(monkeypatch):
    def offered():
        farm: Any = SimpleNamespace(settings=parsed(["serve"])[1])
        return viewers(farm)

    assert offered() == {}
    monkeypatch.setenv("TRIFARM_RERUN_URL", "https://viewer.example/?url=")
    assert offered() == {"rerun": "https://viewer.example/?url="}


@pytest.mark.parametrize("arguments", [[], ["fly"], ["serve", "--port", "x"]])
def test_wrong_arguments_end_with_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        parsed(arguments)
    assert ended.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_importing_the_services_loads_neither_physics_nor_learning():
    heavy = "{'mujoco', 'torch', 'stable_baselines3', 'onnx', 'onnxruntime', 'scipy', 'sim_backend', 'robot_farm', 'client_cli'}"
    code = f"import services.serve, services.__main__, sys; print(sorted({heavy} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_a_variable_that_nobody_reads_is_told_at_the_start(tmp_path):
    """The process itself: a misspelt setting had no effect, and nobody heard of it."""
    command = [sys.executable, "-P", "-m", "services", "bus-key", "--data", str(tmp_path)]
    environment = os.environ | {"TRIFARM_KEEP_LOG_DAYS": "30", "TRIFARM_FARM_KEY": "5a" * 32}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=True)
    (told,) = (json.loads(line) for line in ended.stderr.splitlines())
    assert told["level"] == "warning"
    assert told["reason"] == "no program of trifarm reads TRIFARM_KEEP_LOG_DAYS; did you mean TRIFARM_KEEP_LOGS_DAYS?"
    assert len(ended.stdout.splitlines()) == 1
