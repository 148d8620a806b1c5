"""Parts of the networks that torch does not have as they are needed here."""

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")

import torch

from sim_backend.training.actor_critic import Elu


def test_elu_is_torchs_own_with_its_derivative():
    x = torch.linspace(-20.0, 5.0, 501, requires_grad=True)
    torch.testing.assert_close(Elu()(x), torch.nn.functional.elu(x), atol=2e-7, rtol=0)
    exact = torch.randn(40, 5, dtype=torch.double, requires_grad=True, generator=torch.Generator().manual_seed(1))
    assert torch.autograd.gradcheck(Elu(), exact)
