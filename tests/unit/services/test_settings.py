import subprocess
import sys

import pytest

from services.__main__ import settings_from


def test_flags_win_over_variables_over_defaults(monkeypatch):
    assert settings_from(["serve"]).port == 8000
    monkeypatch.setenv("TRIFARM_PORT", "1234")
    monkeypatch.setenv("TRIFARM_PASS_OVER_S", "5")
    assert settings_from(["serve"]).port == 1234
    assert settings_from(["serve", "--port", "99"]).port == 99
    assert settings_from(["serve"]).pass_over_s == 5


@pytest.mark.parametrize("arguments", [[], ["fly"], ["serve", "--port", "x"]])
def test_wrong_arguments_end_with_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        settings_from(arguments)
    assert ended.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_importing_the_services_loads_neither_physics_nor_learning():
    heavy = "{'mujoco', 'torch', 'stable_baselines3', 'onnx', 'onnxruntime', 'scipy', 'sim_backend', 'robot_farm', 'client_cli'}"
    code = f"import services.serve, services.__main__, sys; print(sorted({heavy} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
