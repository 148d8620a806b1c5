"""Every command of docs/bring-your-weights.md that packs is run as it stands, on a checkpoint of that library's layout."""

import json
import re
import shlex
import sys
from pathlib import Path

import pytest
import safetensors.torch
import torch
from torch import nn

from api_schemas.policy import LAYOUTS, PolicyManifest
from client_cli.policies.policy_files import read_policy
from tests import ROOT
from tests.unit.client_cli.packing.checkpoints import LEROBOT, CleanRlPpo, CleanRlSac, RlGames, RslRl, Skrl, TorchLstm, mlp

PAGE = (ROOT / "docs" / "bring-your-weights.md").read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
ROBOT = next(text for kind, text in BLOCKS if kind == "json")
PYTHON, TURNED = [text for kind, text in BLOCKS if kind == "python"]
COMMANDS = [line for kind, text in BLOCKS if not kind for line in text.splitlines() if " pack " in line]
SIZE = PolicyManifest.model_validate_json(ROBOT).observation_size

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def stable_baselines():
    stable = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    from tests.unit.client_cli.packing.toy_env import ToyEnv

    normalised = VecNormalize(DummyVecEnv([lambda: ToyEnv(SIZE)]))
    model = stable.PPO("MlpPolicy", normalised, device="cpu", n_steps=16, batch_size=16)
    model.learn(32)
    model.save("model.zip")
    normalised.save("vec_normalize.pkl")


def state_dict():
    parts = {"memory": nn.GRU(SIZE, 16), "actor": mlp(16, 16, 9), "critic": mlp(SIZE, 1)}
    torch.save(nn.ModuleDict(parts).state_dict(), "weights.pt")


def programs():
    exec(PYTHON, {"torch": torch, "network": mlp(SIZE, 16, 9)})


def published():
    torch.jit.script(mlp(LAYOUTS["rrc2022-push-flat"].observation_size, 16, 9)).save("push.pt")


def hub():
    Path("hub").mkdir()
    Path("hub/config.json").write_text('{"hidden": 16}')
    safetensors.torch.save_file(mlp(SIZE, 16, 16, 9, activation=nn.Tanh).state_dict(), "hub/model.safetensors")


def lerobot():
    """A folder as LeRobot writes it, and an interpreter with what our exporter asks of LeRobot."""
    Path("FOLDER").mkdir()
    features = {"observation.state": {"type": "STATE", "shape": [SIZE]}}
    Path("FOLDER/config.json").write_text(json.dumps({"type": "act", "input_features": features}))
    normaliser = {f"unnormalize_outputs.buffer_action.{each}": torch.rand(9) + 0.1 for each in ("mean", "std")}
    actor = {f"model.{name}": value for name, value in mlp(SIZE, 36).state_dict().items()}
    safetensors.torch.save_file(actor | normaliser, "FOLDER/model.safetensors")
    package = Path("lerobot/lib/lerobot/policies/act")
    package.mkdir(parents=True)
    (package / "modeling_act.py").write_text(LEROBOT)
    python = Path("lerobot/bin/python")
    python.parent.mkdir()
    python.write_text(f'#!/bin/sh\nPYTHONPATH={Path("lerobot/lib").resolve()} exec {sys.executable} "$@"\n')
    python.chmod(0o755)


MAKERS = {
    "push.pt": published,
    "model.zip": stable_baselines,
    "last_cube_ep_500.pth": lambda: torch.save({"model": RlGames(SIZE, "lstm-after").state_dict()}, "last_cube_ep_500.pth"),
    "model_1500.pt": lambda: torch.save(RslRl(SIZE, "lstm").checkpoint(), "model_1500.pt"),
    "agent_36000.pt": lambda: torch.save(Skrl(SIZE, "mlp").checkpoint(), "agent_36000.pt"),
    "weights.pt": state_dict,
    "ppo_continuous_action.cleanrl_model": lambda: torch.save(
        CleanRlPpo(SIZE).state_dict(), "ppo_continuous_action.cleanrl_model"
    ),
    "actor.pt": lambda: torch.save(CleanRlSac(SIZE).state_dict(), "actor.pt"),
    "hub": hub,
    "FOLDER": lerobot,
    "network.pt2": programs,
    "network.pt": programs,
    "recurrent.pt": lambda: torch.jit.script(TorchLstm(SIZE)).save("recurrent.pt"),
}


def test_an_action_of_one_is_the_same_with_and_without_packing():
    commands = [shlex.split(line) for line in COMMANDS]
    stated = {float(words[words.index("--scale") + 1]) for words in commands if "--scale" in words}
    assert stated == {PolicyManifest.model_validate_json(ROBOT).output_scaling.scale}
    unstated = {words[2] for words in commands if "--scale" not in words}
    assert unstated == {"push.pt", "FOLDER"}, "a layout in N m, and a folder that brings its normaliser of actions"


def test_every_example_has_a_checkpoint():
    assert [shlex.split(line)[2] for line in COMMANDS] == list(MAKERS)


def test_the_views_of_each_finger_are_what_the_page_says():
    """Joints, cube and goal turned by 120° about the vertical: the finger that now stands there does what the first one did."""
    names: dict = {"torch": torch}
    exec(TURNED, names)
    torch.manual_seed(0)
    program = names["Turned"](mlp(9, 16, 3)).eval()
    joints, places = torch.randn(3, 3), torch.randn(2, 3)
    turn = torch.tensor([[-0.5, 0.75**0.5, 0.0], [-(0.75**0.5), -0.5, 0.0], [0.0, 0.0, 1.0]])
    before = program(torch.cat([joints.ravel(), places.ravel()])[None]).reshape(3, 3)
    after = program(torch.cat([joints.roll(1, 0).ravel(), (places @ turn.T).ravel()])[None]).reshape(3, 3)
    assert before.std() > 1e-3
    torch.testing.assert_close(after, before.roll(1, 0), atol=1e-4, rtol=0)


@pytest.mark.parametrize("line", COMMANDS, ids=lambda line: shlex.split(line)[2])
def test_the_example_packs(line, tmp_path, monkeypatch, trifarm):
    monkeypatch.chdir(tmp_path)
    torch.manual_seed(0)
    words = shlex.split(line)
    MAKERS[words[2]]()
    Path("robot.json").write_text(ROBOT)
    ended = trifarm(*words[1:], "--no-try")
    assert ended.code == 0, ended.err
    assert "largest difference" in ended.out
    out = Path(words[words.index("--out") + 1] if "--out" in words else "push.onnx")
    size = LAYOUTS[words[words.index("--layout") + 1]].observation_size if "--layout" in words else SIZE
    assert read_policy(out, None, None).manifest.observation_size == size, "ready for trifarm submit"
