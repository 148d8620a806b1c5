"""A plain state_dict with a normaliser is packed as the user says that it is applied, and not without a word."""

import pytest
import torch
from torch import nn

from tests.unit.client_cli.packing.checkpoints import RlGames, mlp
from tests.unit.client_cli.packing.packed import SCALE, SIZE, assert_same, pack


class Normalised(nn.Module):
    """A network that keeps statistics of its observations beside its layers."""

    def __init__(self, epsilon, clip, spread):
        super().__init__()
        self.actor, self.epsilon, self.clip, self.spread = mlp(SIZE, 16, 16, 9), epsilon, clip, spread
        self.register_buffer("running_mean", torch.linspace(-1.0, 1.0, SIZE))
        self.register_buffer(spread, torch.linspace(0.2, 3.0, SIZE))

    def forward(self, seen):
        spread = getattr(self, self.spread)
        by = spread + self.epsilon if self.spread == "running_std" else torch.sqrt(spread + self.epsilon)
        return self.actor(((seen - self.running_mean) / by).clip(-self.clip, self.clip))


@pytest.mark.parametrize("spread", ["running_var", "running_std"])
def test_a_state_dict_with_a_normaliser(spread, tmp_path, trifarm, manifest):
    module = Normalised(1e-2, 3.0, spread)
    path, out = tmp_path / "weights.pt", tmp_path / "packed.safetensors"
    torch.save(module.state_dict(), path)
    layers = ("--architecture", "actor.0,actor.2,actor.4", "--activation", "elu", "--scale", str(SCALE))
    told = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), *layers)
    assert told.code == 2
    assert f"--normaliser running_mean,{spread},EPSILON,CLIP" in told.err
    assert not out.exists()
    pack(trifarm, path, out=out, manifest=manifest(), options=(*layers, "--normaliser", f"running_mean,{spread},1e-2,3"))
    assert_same(out, module)
    pack(trifarm, path, out=out, manifest=manifest(), options=(*layers, "--normaliser", "none"))
    assert_same(out, module.actor)


@pytest.mark.parametrize(
    "wrong",
    [
        "nope",
        "running_mean",
        "running_mean,actor.0.bias",
        "running_mean,running_var,x",
        "a,b,1,2,3",
        "running_mean,running_var,-1",
        "running_mean,running_var,1e-8,0",
        "running_mean,running_var,1e-8,inf",
    ],
)
def test_a_normaliser_that_cannot_be(wrong, tmp_path, trifarm, manifest):
    path, out = tmp_path / "weights.pt", tmp_path / "packed.safetensors"
    torch.save(Normalised(1e-2, 3.0, "running_var").state_dict(), path)
    layers = ("--architecture", "actor.0,actor.2,actor.4", "--activation", "tanh")
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), *layers, "--normaliser", wrong)
    assert ended.code == 2
    assert "--normaliser" in ended.err


def test_what_a_normaliser_leaves_out_is_the_manifests(tmp_path, trifarm, manifest):
    module, path, out = Normalised(0.0, 1.5, "running_var"), tmp_path / "weights.pt", tmp_path / "packed.safetensors"
    state = module.state_dict()
    torch.save(state | {"running_mean": state["running_mean"].numpy()}, path)
    layers = ("--architecture", "actor.0,actor.2,actor.4", "--activation", "elu", "--scale", str(SCALE))
    clipped = manifest(input_scaling={"clip": 1.5})
    pack(trifarm, path, out=out, manifest=clipped, options=(*layers, "--normaliser", "running_mean,running_var,0"))
    assert_same(out, module)
    scaled = manifest(input_scaling={"mean": [0.0] * SIZE, "variance": [1.0] * SIZE, "epsilon": 1e-12})
    pack(trifarm, path, out=out, manifest=scaled, options=layers)
    assert_same(out, module.actor)


def test_statistics_of_one_observation_of_a_stack_are_seen(tmp_path, trifarm, manifest):
    module, path, out = Normalised(1e-2, 3.0, "running_var"), tmp_path / "weights.pt", tmp_path / "packed.safetensors"
    module.actor = mlp(2 * SIZE, 16, 16, 9)
    torch.save(module.state_dict(), path)
    stacked = str(manifest(frame_stack={"count": 2}))
    layers = ("--architecture", "actor.0,actor.2,actor.4", "--activation", "elu", "--scale", str(SCALE))
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", stacked, *layers)
    assert (ended.code, "look like a normaliser" in ended.err) == (2, True)
    pack(trifarm, path, out=out, manifest=stacked, options=(*layers, "--normaliser", "running_mean,running_var,1e-2,3"))


def test_a_normaliser_is_for_plain_state_dicts(tmp_path, trifarm, manifest):
    path, out = tmp_path / "rl_games.pth", tmp_path / "packed.safetensors"
    torch.save({"model": RlGames(SIZE, "mlp").state_dict()}, path)
    ended = trifarm("pack", str(path), "--out", str(out), "--manifest", str(manifest()), "--normaliser", "a,b")
    assert ended.code == 2
    assert "is rl-games" in ended.err
