"""Networks with the module names of the training libraries, and forward passes written from the libraries' descriptions."""

import itertools

import torch
from torch import nn


def mlp(*sizes, activation=nn.ELU, last=False):
    """Linear layers with the activation between; after the last as well if asked."""
    layers = []
    for index, (takes, gives) in enumerate(itertools.pairwise(sizes)):
        layers += [nn.Linear(takes, gives), activation()] if last or index < len(sizes) - 2 else [nn.Linear(takes, gives)]
    return nn.Sequential(*layers)


class Named(nn.Module):
    """A module that holds one under the name ``rnn``, as the libraries wrap recurrent layers."""

    def __init__(self, rnn):
        super().__init__()
        self.rnn = rnn


class Statistics(nn.Module):
    """Buffers of running statistics under a library's names."""

    def __init__(self, size, mean, second, shape):
        super().__init__()
        self.register_buffer(mean, torch.randn(size, dtype=torch.float64).reshape(shape))
        self.register_buffer(second, torch.rand(size, dtype=torch.float64).reshape(shape) + 0.1)
        self.register_buffer("count", torch.tensor(100.0))


class RlGames(nn.Module):
    """``a2c_network`` and ``running_mean_std`` as rl_games saves them under the key ``model``."""

    def __init__(self, size, kind):
        super().__init__()
        torch.manual_seed(2)
        self.kind = kind
        self.running_mean_std = Statistics(size, "running_mean", "running_var", (size,))
        self.value_mean_std = Statistics(1, "running_mean", "running_var", (1,))
        net = nn.Module()
        net.actor_mlp = mlp(24 if kind == "gru-before" else size, 32, last=True)
        net.value = nn.Linear(32, 1)
        if kind == "lstm-after":
            net.rnn, net.layer_norm = Named(nn.LSTM(32, 32, 2)), nn.LayerNorm(32)
            nn.init.normal_(net.layer_norm.weight)
        if kind == "gru-before":
            net.rnn = Named(nn.GRU(size, 24))
        if kind == "bins":
            net.logits = nn.ModuleList(nn.Linear(32, 11) for _ in range(9))
        else:
            net.mu = nn.Linear(32, 9)
            net.sigma = nn.Parameter(torch.zeros(9))
        self.a2c_network = net

    def forward(self, trial):
        statistics, net = self.running_mean_std, self.a2c_network
        x = (trial - statistics.running_mean.float()) / torch.sqrt(statistics.running_var.float() + 1e-5)
        x = x.clamp(-5, 5)
        if self.kind == "gru-before":
            x = net.rnn.rnn(x)[0]
        x = net.actor_mlp(x)
        if self.kind == "lstm-after":
            x = net.layer_norm(net.rnn.rnn(x)[0])
        if self.kind == "bins":
            return torch.stack([logit(x).argmax(1) for logit in net.logits], 1) / 5 - 1
        return net.mu(x).clamp(-1, 1)


class RslRl(nn.Module):
    """An actor as rsl_rl saves it: in one ``model_state_dict``, or since version 4 as a model of its own."""

    def __init__(self, size, kind):
        super().__init__()
        torch.manual_seed(3)
        self.kind = kind
        self.normaliser = Statistics(size, "_mean", "_std", (1, size))
        memory = {"lstm": nn.LSTM, "gru": nn.GRU}.get(kind)
        self.memory = Named(memory(size, 24)) if memory else None
        self.actor = mlp(24 if memory else size, 32, 9)
        self.critic = mlp(size, 8, 1)

    def checkpoint(self):
        actor, normaliser = self.actor.state_dict(), self.normaliser.state_dict()
        critic = {f"critic.{name}": value for name, value in self.critic.state_dict().items()}
        if self.kind == "since-4":
            state = {f"mlp.{name}": value for name, value in actor.items()}
            state |= {f"obs_normalizer.{name}": value for name, value in normaliser.items()}
            return {"actor_state_dict": state | {"distribution.std_param": torch.ones(9)}, "critic_state_dict": critic, "iter": 3}
        state = {"std": torch.ones(9)} | {f"actor.{name}": value for name, value in actor.items()} | critic
        if self.memory is not None:
            state |= {f"memory_a.{name}": value for name, value in self.memory.state_dict().items()}
            state |= {f"memory_c.{name}": value for name, value in self.memory.state_dict().items()}
        if self.kind == "normaliser-apart":
            return {"model_state_dict": state, "obs_norm_state_dict": normaliser, "iter": 3, "infos": None}
        state |= {f"actor_obs_normalizer.{name}": value for name, value in normaliser.items()}
        return {"model_state_dict": state, "iter": 3, "infos": None}

    def forward(self, trial):
        x = ((trial - self.normaliser._mean) / (self.normaliser._std + 1e-2)).float()
        return self.actor(x if self.memory is None else self.memory.rnn(x)[0])


class Skrl(nn.Module):
    """A Gaussian policy of skrl's model instantiator, one shared with the value, and one with an LSTM as users write it."""

    def __init__(self, size, kind):
        super().__init__()
        torch.manual_seed(4)
        self.kind = kind
        self.scaler = Statistics(size, "running_mean", "running_variance", (size,))
        policy = nn.Module()
        if kind == "lstm":
            policy.lstm = nn.LSTM(size, 24)
        policy.net_container = mlp(24 if kind == "lstm" else size, 32, 32, last=True)
        policy.policy_layer = nn.Linear(32, 9)
        policy.log_std_parameter = nn.Parameter(torch.zeros(9))
        if kind == "shared":
            policy.value_layer = nn.Linear(32, 1)
        self.policy = policy

    def checkpoint(self):
        return {
            "policy": self.policy.state_dict(),
            "value": {"net_container.0.weight": torch.zeros(3, 3)},
            "optimizer": {"state": {}, "param_groups": []},
            "state_preprocessor": self.scaler.state_dict(),
        }

    def forward(self, trial):
        spread = torch.sqrt(self.scaler.running_variance.float()) + 1e-8
        x = ((trial - self.scaler.running_mean.float()) / spread).clamp(-5, 5)
        x = self.policy.lstm(x)[0] if self.kind == "lstm" else x
        return self.policy.policy_layer(self.policy.net_container(x))


class TorchLstm(nn.Module):
    """A program whose states are its inputs and outputs."""

    def __init__(self, size):
        super().__init__()
        self.memory, self.last = nn.LSTM(size, 16), nn.Linear(16, 9)

    def forward(self, x, h, c):
        y, (h, c) = self.memory(x[None], (h, c))
        return self.last(y[0]), h, c

    @torch.jit.unused
    def whole_trial(self, trial):
        return self.last(self.memory(trial)[0])


class CleanRlPpo(nn.Module):
    """The agent of CleanRL's ``ppo_continuous_action.py``."""

    def __init__(self, size):
        super().__init__()
        self.critic = mlp(size, 16, 16, 1, activation=nn.Tanh)
        self.actor_mean = mlp(size, 16, 16, 9, activation=nn.Tanh)
        self.actor_logstd = nn.Parameter(torch.zeros(1, 9))


class CleanRlSac(nn.Module):
    """The actor of CleanRL's ``sac_continuous_action.py``."""

    def __init__(self, size):
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(size, 16), nn.Linear(16, 16)
        self.fc_mean, self.fc_logstd = nn.Linear(16, 9), nn.Linear(16, 9)
        self.register_buffer("action_scale", torch.full((9,), 0.8))
        self.register_buffer("action_bias", torch.full((9,), 0.1))


LEROBOT = '''
"""Stands for LeRobot's ACT: a linear layer plans four actions."""

import json
from types import SimpleNamespace

import safetensors.torch
import torch


class Plan(torch.nn.Linear):
    def forward(self, seen):
        return super().forward(seen["observation.state"]).reshape(-1, 4, 9), None


class ACTPolicy(torch.nn.Module):
    @classmethod
    def from_pretrained(cls, folder):
        policy = cls()
        features = json.loads((folder / "config.json").read_text())["input_features"]
        tensors = safetensors.torch.load_file(folder / "model.safetensors")
        policy.model = Plan(*reversed(tensors["model.0.weight"].shape))
        policy.model.load_state_dict({"weight": tensors["model.0.weight"], "bias": tensors["model.0.bias"]})
        policy.config = SimpleNamespace(
            normalization_mapping={"ACTION": "MEAN_STD"},
            n_action_steps=3,
            input_features={name: SimpleNamespace(**each) for name, each in features.items()},
            output_features={"action": SimpleNamespace(shape=(9,))},
            image_features={},
            temporal_ensemble_coeff=None,
        )
        return policy
'''
"""What ``lerobot_export.py`` asks of LeRobot, which wants another torch and so is not installed beside trifarm."""
