"""DAgger in small: a student comes closer to its teacher, and what is exported is a policy the farm would take."""

import json
import subprocess
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")

from safetensors.numpy import save_file  # noqa: E402

from api_schemas.policy import PolicyManifest  # noqa: E402
from sim_backend.effects.physics import Physics  # noqa: E402
from sim_backend.training import dagger  # noqa: E402


@pytest.fixture
def teacher(tmp_path):
    rng = np.random.default_rng(0)
    tensors = {
        "observation_low": -np.ones(54),
        "observation_high": np.ones(54),
        "running_mean": np.zeros(54),
        "running_var": np.ones(54),
        "torque_limit_nm": np.full(9, 0.397),
        "layer0.weight": rng.normal(size=(16, 54)) * 0.2,
        "layer0.bias": np.zeros(16),
        "layer1.weight": rng.normal(size=(9, 16)) * 0.2,
        "layer1.bias": np.zeros(9),
    }
    path = tmp_path / "teacher.safetensors"
    save_file({name: value.astype(np.float32) for name, value in tensors.items()}, path)
    return dagger.Teacher(path)


def distance(student: dagger.Student, teacher: dagger.Teacher) -> float:
    episode = dagger.begin(dagger.Settings(), Physics.nominal(16), range(900, 916))
    errors = []
    for _ in range(50):
        observation = torch.from_numpy(episode.observe()).float()
        wanted = teacher.act(observation)
        errors.append(float((student.act(observation) - wanted).abs().mean()))
        episode.advance(wanted.double().numpy())
    return float(np.mean(errors))


@pytest.mark.filterwarnings("default")  # torch's own
def test_student_learns_and_is_exported(teacher, tmp_path):
    settings = dagger.Settings(minutes=0.15, robots=16, hidden=(32,), evaluation_trials=4)
    torch.manual_seed(0)
    before = distance(dagger.Student(dagger.MANIFEST.observation_size, settings.hidden), teacher)
    student, run = dagger.train(settings, teacher)
    assert run["samples"] > 1000
    assert distance(student, teacher) < 0.7 * before
    assert dagger.measured(settings, student, "real")["trials"] == 4
    dagger.export(student, tmp_path, "push")
    PolicyManifest.model_validate_json((tmp_path / "push.json").read_text())
    command = [sys.executable, "-m", "services.policies.conversion"]
    files = [str(tmp_path / name) for name in ("push.safetensors", "push.json", "push.onnx")]
    done = subprocess.run([*command, *files], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[0]) == {"converted": True}
