"""Actor and critic with a memory, an LSTM before their layers, for RecurrentPPO of sb3-contrib."""

from typing import Any

import numpy as np
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from torch import nn

from sim_backend.training.actor_critic import Inputs


class RecurrentActorCritic(RecurrentActorCriticPolicy):
    """The policy that sb3-contrib trains; inputs as without memory (:class:`Inputs`)."""

    features_extractor: Inputs

    def __init__(self, *arguments: Any, actor: tuple[int, ...], critic: tuple[int, ...], memory: int, **keywords: Any) -> None:
        layers = {"net_arch": {"pi": list(actor), "vf": list(critic)}, "activation_fn": nn.ELU, "lstm_hidden_size": memory}
        super().__init__(*arguments, **keywords, **layers)

    @property
    def actor_layers(self) -> list[nn.Linear]:
        """The hidden layers of the actor, after its memory."""
        return [module for module in self.mlp_extractor.policy_net if isinstance(module, nn.Linear)]


class Memory:
    """The LSTM of an exported actor in many trials at once, computed as torch does it. Owner of the trials' states.

    Args:
        tensors: with ``recurrent.*`` of one layer, named as torch names them.
    """

    def __init__(self, tensors: dict[str, np.ndarray]) -> None:
        self._input, self._own = (tensors[f"recurrent.{name}_l0"].T for name in ("weight_ih", "weight_hh"))
        self._bias = tensors["recurrent.bias_ih_l0"] + tensors["recurrent.bias_hh_l0"]
        self.begin(0)

    def begin(self, trials: int) -> None:
        """Forget all that was."""
        self._hidden = self._cell = np.zeros((trials, len(self._own)), dtype=np.float32)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """What the layers after it get, shape (n, cells), for the next inputs (n, size)."""
        if len(self._hidden) != len(x):
            self.begin(len(x))
        takes, keeps, new, gives = np.split(x @ self._input + self._hidden @ self._own + self._bias, 4, axis=1)
        self._cell = _sigmoid(keeps) * self._cell + _sigmoid(takes) * np.tanh(new)
        self._hidden = _sigmoid(gives) * np.tanh(self._cell)
        return self._hidden


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1.0 + np.tanh(0.5 * x))
