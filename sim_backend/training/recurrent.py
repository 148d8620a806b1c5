"""Actor and critic with a memory, an LSTM before their layers, for RecurrentPPO of sb3-contrib."""

from typing import Any

import numpy as np
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from torch import nn

from api_schemas.policy_network import Cell
from sim_backend.training.actor_critic import Inputs


class RecurrentActorCritic(RecurrentActorCriticPolicy):
    """The policy that sb3-contrib trains; inputs as without memory (:class:`Inputs`)."""

    features_extractor: Inputs  # pyrefly: ignore[bad-override-mutable-attribute] - nobody sets another

    def __init__(self, *arguments: Any, actor: tuple[int, ...], critic: tuple[int, ...], memory: int, **keywords: Any) -> None:
        layers = {"net_arch": {"pi": list(actor), "vf": list(critic)}, "activation_fn": nn.ELU, "lstm_hidden_size": memory}
        super().__init__(*arguments, **keywords, **layers)

    @property
    def actor_layers(self) -> list[nn.Linear]:
        """The hidden layers of the actor, after its memory."""
        return [module for module in self.mlp_extractor.policy_net if isinstance(module, nn.Linear)]


class Memory:
    """The cells of an exported policy in many trials at once, computed as torch does it. Owner of the trials' states.

    Args:
        tensors: with ``recurrent.*`` of one layer, named as torch names them.
        cell: what they are of.
    """

    def __init__(self, tensors: dict[str, np.ndarray], cell: Cell) -> None:
        self._input, self._own = (tensors[f"recurrent.{name}_l0"].T for name in ("weight_ih", "weight_hh"))
        self._input_bias, self._own_bias = (tensors[f"recurrent.{name}_l0"] for name in ("bias_ih", "bias_hh"))
        self._advance = self._advance_lstm if cell is Cell.LSTM else self._advance_gru
        self.begin(0)

    def begin(self, trials: int) -> None:
        """Forget all that was."""
        self._hidden, self._cell = (np.zeros((trials, len(self._own)), dtype=np.float32) for _ in range(2))

    @property
    def hidden(self) -> np.ndarray:
        """What the layers after it got last, shape (n, cells)."""
        return self._hidden.copy()

    def forget(self, rows: np.ndarray) -> None:
        """These trials begin anew."""
        self._hidden[rows], self._cell[rows] = 0.0, 0.0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """What the layers after it get, shape (n, cells), for the next inputs (n, size)."""
        if len(self._hidden) != len(x):
            self.begin(len(x))
        self._advance(x @ self._input + self._input_bias, self._hidden @ self._own + self._own_bias)
        return self._hidden

    def _advance_lstm(self, of_input: np.ndarray, of_own: np.ndarray) -> None:
        takes, keeps, new, gives = np.split(of_input + of_own, 4, axis=1)
        self._cell = _sigmoid(keeps) * self._cell + _sigmoid(takes) * np.tanh(new)
        self._hidden = _sigmoid(gives) * np.tanh(self._cell)

    def _advance_gru(self, of_input: np.ndarray, of_own: np.ndarray) -> None:
        (resets, keeps, new), (own_resets, own_keeps, own_new) = np.split(of_input, 3, axis=1), np.split(of_own, 3, axis=1)
        keeps = _sigmoid(keeps + own_keeps)
        new = np.tanh(new + _sigmoid(resets + own_resets) * own_new)
        self._hidden = (1.0 - keeps) * new + keeps * self._hidden


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1.0 + np.tanh(0.5 * x))
