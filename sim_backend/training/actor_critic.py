"""The networks that PPO trains: normalised inputs completed by differences, an actor that sees, a critic that may know more."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from api_schemas.observation import sizes_of
from api_schemas.policy import PolicyManifest
from sim_backend.environments.vec_env import PRIVILEGED, SEEN

CLIP, EPSILON = 5.0, 1e-5
"""Of the normalised inputs, as the manifests of exported policies say."""
DIFFERENCE_SCALE_M = 0.1
"""Differences of places are given to the networks in units of this."""


class Inputs(BaseFeaturesExtractor):
    """Normalises observations and adds differences between the places in them: [seen, differences, privileged].

    Mean and variance are learned from what is seen until they are frozen; they belong to the weights.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor
    differences: torch.Tensor

    def __init__(self, observation_space: spaces.Space, manifest: PolicyManifest) -> None:
        seen = observation_space[SEEN] if isinstance(observation_space, spaces.Dict) else observation_space
        self.seen = int(np.prod(seen.shape or ()))
        whole = spaces.flatdim(observation_space)
        matrix = difference_matrix(manifest)
        super().__init__(observation_space, whole + len(matrix))
        self.actor_inputs = self.seen + len(matrix)
        self._fixed: tuple[torch.Tensor, torch.Tensor] | None = None
        self.register_buffer("mean", torch.zeros(whole))
        self.register_buffer("variance", torch.ones(whole))
        self.register_buffer("count", torch.zeros(()))
        self.register_buffer("differences", torch.from_numpy(matrix.astype(np.float32)))

    @torch.no_grad()
    def fix(self, mean: torch.Tensor, variance: torch.Tensor) -> None:
        """Scale what is seen by these, each of shape (seen,), whatever is learned from now on."""
        self._fixed = mean, variance
        self.mean[: self.seen], self.variance[: self.seen] = self._fixed

    def forward(self, observations) -> torch.Tensor:
        """Features, shape (n, features)."""
        deviation = torch.sqrt(self.variance + EPSILON)
        x = ((whole_of(observations) - self.mean) / deviation).clamp(-CLIP, CLIP)
        seen = x[:, : self.seen]
        places_m = seen * deviation[: self.seen] + self.mean[: self.seen]
        return torch.cat([seen, places_m @ self.differences.T, x[:, self.seen :]], dim=1)

    @torch.no_grad()
    def learn_scaling(self, observations: torch.Tensor) -> None:
        """Take more observations, shape (n, whole), into mean and variance."""
        n, mean, variance = len(observations), observations.mean(0), observations.var(0, correction=0)
        total = self.count + n
        apart = mean - self.mean
        squares = self.variance * self.count + variance * n + apart**2 * self.count * n / total
        self.mean += apart * n / total
        self.variance.copy_(squares / total)
        self.count.copy_(total)
        if self._fixed is not None:
            self.fix(*self._fixed)


def whole_of(observations) -> torch.Tensor:
    """What is seen and what is privileged side by side."""
    if isinstance(observations, dict):
        return torch.cat([observations[SEEN], observations[PRIVILEGED]], dim=1)
    return observations


def difference_matrix(manifest: PolicyManifest) -> np.ndarray:
    """Differences between places in an observation, shape (k, size): of tips and cube, cube and goal, tips and their goals."""
    at, first = {}, 0
    for name, size in zip(manifest.observation, sizes_of(manifest.observation), strict=True):
        at[name] = first
        first += size
    cube, goal = _centre(at, first, "cube"), _centre(at, first, "goal")
    rows = []
    if "fingertip_position_world_m" in at:
        tips = _place(at["fingertip_position_world_m"], first, 9)
        if cube is not None:
            rows.append(tips - np.tile(cube, (3, 1)))
        if "goal_fingertip_position_world_m" in at:
            rows.append(tips - _place(at["goal_fingertip_position_world_m"], first, 9))
    if cube is not None and goal is not None:
        rows.append(goal - cube)
    return np.concatenate(rows) / DIFFERENCE_SCALE_M if rows else np.zeros((0, first))


def _place(start: int, size: int, numbers: int) -> np.ndarray:
    return np.eye(size)[start : start + numbers]


def _centre(at: dict[str, int], size: int, of: str) -> np.ndarray | None:
    if f"{of}_position_world_m" in at:
        return _place(at[f"{of}_position_world_m"], size, 3)
    if f"{of}_keypoints_world_m" in at:
        return _place(at[f"{of}_keypoints_world_m"], size, 24).reshape(8, 3, size).mean(axis=0)
    return None


class Networks(nn.Module):
    """Actor and critic up to their last layers; the actor gets the first of the features only."""

    def __init__(self, actor_inputs: int, features: int, actor: tuple[int, ...], critic: tuple[int, ...]) -> None:
        super().__init__()
        self._actor_inputs = actor_inputs
        self.actor: nn.Sequential
        self.critic: nn.Sequential
        self.actor, self.critic = _layers((actor_inputs, *actor)), _layers((features, *critic))
        self.latent_dim_pi, self.latent_dim_vf = actor[-1], critic[-1]

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Both, shapes (n, last hidden)."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """The actor's."""
        return self.actor(features[:, : self._actor_inputs])

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """The critic's."""
        return self.critic(features)


class _Elu(torch.autograd.Function):
    """As torch's ``elu`` to 1e-7, whose ``expm1`` takes a processor longer than the layers do."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:
        y = torch.exp(x.clamp(max=0.0)).sub_(1.0).add_(x.clamp(min=0.0))
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        (y,) = ctx.saved_tensors
        return grad * y.clamp(max=0.0).add_(1.0)


class Elu(nn.Module):
    """Exponential linear unit, made for training on processors."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Any shape to the same shape."""
        return _Elu.apply(x)  # type: ignore[return-value]


def _layers(sizes: tuple[int, ...]) -> nn.Sequential:
    return nn.Sequential(*(module for a, b in pairwise(sizes) for module in (nn.Linear(a, b), Elu())))


class ActorCritic(ActorCriticPolicy):
    """The policy that stable-baselines3 trains."""

    features_extractor: Inputs  # pyrefly: ignore[bad-override-mutable-attribute] - nobody sets another

    def __init__(self, *arguments: Any, actor: tuple[int, ...], critic: tuple[int, ...], **keywords: Any) -> None:
        self._actor, self._critic = actor, critic
        super().__init__(*arguments, **keywords)

    @property
    def actor_layers(self) -> list[nn.Linear]:
        """The hidden layers of the actor."""
        networks = self.mlp_extractor
        assert isinstance(networks, Networks)
        return [module for module in networks.actor if isinstance(module, nn.Linear)]

    @property
    def all_actor_layers(self) -> list[nn.Linear]:
        """The hidden layers of the actor and its last one."""
        assert isinstance(self.action_net, nn.Linear)
        return [*self.actor_layers, self.action_net]

    def actor_parameters(self) -> list[nn.Parameter]:
        """What draws actions: the actor's layers and the deviation."""
        return [*(parameter for module in self.all_actor_layers for parameter in module.parameters()), self.log_std]

    def _build_mlp_extractor(self) -> None:
        inputs = self.features_extractor
        self.mlp_extractor = Networks(inputs.actor_inputs, inputs.features_dim, self._actor, self._critic)  # type: ignore[assignment]


def hold_actor(policy: ActorCritic, optimizer: torch.optim.Optimizer, while_true: Callable[[], bool]) -> None:
    """Leave the actor as it is while the critic learns alone: the gradients of a critic that knows nothing would spoil it."""
    actor = policy.actor_parameters()

    def before_step(*_: Any) -> None:
        if while_true():
            for parameter in actor:
                parameter.grad = None

    optimizer.register_step_pre_hook(before_step)
