"""Tensors that a program does without are named, and those that look like a normaliser are never left out unsaid."""

import pytest
import torch
from torch import nn

from client_cli.packing.program_tensors import unused
from client_cli.packing.reading import Statement, pack_files
from client_cli.packing.whole import torch_script, whole_module
from client_cli.terminal.errors import UsageProblem
from tests.unit.client_cli.packing.checkpoints import TorchLstm, mlp
from tests.unit.client_cli.packing.packed import MANIFEST, SIZE

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:.*assigned during export:UserWarning")


class WithLeftOvers(nn.Module):
    """A program that holds tensors which its actions do not depend on; ``low`` counts only now and then."""

    def __init__(self, **more):
        super().__init__()
        torch.manual_seed(0)
        self.net, self.value = mlp(SIZE, 16, 9), nn.Linear(SIZE, 1)
        self.register_buffer("low", torch.full((9,), -0.1))
        for name, values in more.items():
            self.register_buffer(name, values)

    def forward(self, x):
        return torch.where(self.net(x) > self.low, self.net(x), self.low)


@pytest.mark.parametrize("scripted", [True, False])
def test_what_makes_no_difference_is_named_and_left_as_it_was(scripted, tmp_path):
    module, path = WithLeftOvers(steps=torch.tensor(7)), tmp_path / "policy.pt"
    if scripted:
        torch.jit.script(module).save(path)
    program = torch_script(path, ()) if scripted else whole_module(module, ())
    before = {name: each.clone() for name, each in program.module.state_dict().items()}
    assert set(unused(program, SIZE)) == {"steps", "value.weight", "value.bias"}
    assert all(torch.equal(each, before[name]) for name, each in program.module.state_dict().items())


def test_what_counts_through_the_memory_alone_is_used():
    states = ((1, 1, 16), (1, 1, 16))
    assert unused(whole_module(TorchLstm(SIZE), states), SIZE) == ()


@pytest.mark.parametrize(
    ("more", "option"),
    [
        ({"action_mean": torch.zeros(9), "action_std": torch.ones(9)}, "action_normaliser"),
        ({"obs_mean": torch.zeros(SIZE), "obs_var": torch.ones(SIZE)}, "normaliser"),
    ],
)
def test_a_normaliser_that_a_program_does_without_is_not_left_out_unsaid(more, option, tmp_path):
    path = tmp_path / "policy.pt"
    torch.jit.script(WithLeftOvers(**more)).save(path)
    with pytest.raises(UsageProblem, match=f"{', '.join(more)} look like a normaliser.* --{option.replace('_', '-')} none"):
        pack_files([path], Statement(MANIFEST))
    packing = pack_files([path], Statement(MANIFEST, **{option: "none"}))  # the way that the message names
    assert set(packing.unused) == {*more, "value.weight", "value.bias"}
    assert "does without 4 of the file's tensors" in packing.notes[-1]
