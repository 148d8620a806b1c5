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
    settings = dagger.Settings(steps=600, robots=16, physics="nominal", hidden=(32,), evaluation_trials=4)
    torch.manual_seed(0)
    before = distance(dagger.Student(dagger.MANIFEST.observation_size, settings.hidden), teacher)
    student, run = dagger.train(settings, teacher)
    assert run["samples"] == 600 * 16
    assert distance(student, teacher) < 0.7 * before
    assert dagger.measured(settings, student, "real")["trials"] == 4
    dagger.export(student, tmp_path, "push")
    PolicyManifest.model_validate_json((tmp_path / "push.json").read_text())
    command = [sys.executable, "-m", "services.policies.conversion"]
    files = [str(tmp_path / name) for name in ("push.safetensors", "push.json", "push.onnx")]
    done = subprocess.run([*command, *files, "none"], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert json.loads(done.stdout.splitlines()[0]) == {"converted": True}


@pytest.mark.filterwarnings("default")
def test_the_same_seed_gives_the_same_student(teacher):
    settings = dagger.Settings(steps=40, robots=4, hidden=(8,), batch=64)
    first, again = (dagger.train(settings, teacher)[0].state_dict() for _ in range(2))
    assert all(torch.equal(first[name], again[name]) for name in first)


def test_minutes_count_unless_steps_are_given():
    assert dagger.Settings(minutes=2.0).done(10**6, 30.0) == 0.25
    assert dagger.Settings(minutes=2.0, steps=400).done(100, 10**6) == 0.25


def test_memory_forgets_the_oldest_samples():
    memory = dagger.Memory(dagger.Settings(largest_memory=6))
    for value in range(4):
        memory.add(torch.full((2, 54), float(value)), torch.full((2, 9), 0.1 * value))
    observation, wanted = memory.draw(np.random.default_rng(0), 200)
    assert memory.count == 8
    assert set(observation[:, 0].tolist()) == {1.0, 2.0, 3.0}
    np.testing.assert_allclose(wanted[:, 0], 0.1 * observation[:, 0] / 0.396, rtol=1e-6)
    assert memory.scaling()[0][0] == 2.0


def test_trials_begin_with_the_cube_at_rest():
    physics = Physics.of(4, {"cube_size.factor": [1.0, 0.9, 1.1, 0.997]})
    episode = dagger.begin(dagger.Settings(), physics, range(4))
    begun = episode.measurement.cube_position_world_m.copy()
    np.testing.assert_allclose(begun[:, 2], 0.0325 * np.array([1.0, 0.9, 1.1, 0.997]), rtol=1e-12)
    episode.observe()
    episode.advance(np.zeros((4, 9)))
    fallen_m = begun[:, 2] - episode.measurement.cube_position_world_m[:, 2]
    assert (np.abs(fallen_m) < 1e-3).all()  # contacts yield by some tenths of a millimetre; free fall would be 2 mm


def test_the_page_of_the_command_names_its_default_time():
    assert f"[--minutes {dagger.Settings.minutes:g}]" in dagger.__doc__
