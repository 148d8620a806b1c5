"""The demonstration term of DAPG (Rajeswaran et al. 2017, arXiv 1709.10087): PPO's gradient and a part of cloning's that decays.

Before PPO begins, the actor is a clone of the demonstrations; then the critic learns alone for some iterations, since the
gradients of a critic that knows nothing undo what was cloned.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from sim_backend.environments.practice import Practice
from sim_backend.environments.vec_env import PRIVILEGED, SEEN
from sim_backend.training.actor_critic import ActorCritic, hold_actor
from sim_backend.training.demonstrations.cloning import as_practised
from sim_backend.training.demonstrations.recording import joined, read_demonstrations
from sim_backend.training.recipe import DemonstrationTable

CLONING_RATE = 1e-3


class DemonstrationTerm:
    """What is demonstrated and how much it counts. Owner of the generator that draws from it.

    Args:
        settings: files and weights.
        practice: what is practised.
        policy: whose actor is pulled towards the demonstrations.
        seed: of the draws.

    Raises:
        ValueError: the demonstrations are missing or do not fit what is practised.
    """

    def __init__(self, settings: DemonstrationTable, practice: Practice, policy: ActorCritic, seed: int) -> None:
        found = joined([read_demonstrations(Path(file)) for file in settings.files])
        self._seen, self._wanted = (torch.from_numpy(each) for each in as_practised(found, practice))
        self._settings, self._policy, self._rng = settings, policy, np.random.default_rng(seed)
        inputs = policy.features_extractor
        inputs.fix(self._seen.mean(0), self._seen.var(0))
        self._privileged = None if inputs.seen == len(inputs.mean) else inputs.mean[inputs.seen :]

    def weight(self, iteration: int) -> float:
        """What the cloning loss counts in an iteration, counted from 0."""
        past = max(0, iteration - self._settings.critic_first)
        return max(self._settings.least_weight, self._settings.weight * self._settings.decay**past)

    def loss(self) -> torch.Tensor:
        """Mean squared difference between the actor's mean actions and the demonstrated ones."""
        rows = torch.from_numpy(self._rng.integers(len(self._seen), size=self._settings.batch))
        mean = self._policy.get_distribution(self._observations(rows)).distribution.mean  # type: ignore[union-attr]
        return nn.functional.mse_loss(mean, self._wanted[rows])

    def clone(self, tell: Callable[[str], None]) -> None:
        """Let the actor imitate the demonstrations, before PPO begins."""
        optimizer, loss = torch.optim.Adam(self._policy.parameters(), lr=CLONING_RATE), torch.zeros(())
        updates = self._settings.clone_updates
        for update in range(updates):
            optimizer.param_groups[0]["lr"] = CLONING_RATE * (1 - 0.9 * update / updates)
            loss = self.loss()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        tell(f"cloned {len(self._seen):,} samples of demonstrations by {updates:,} updates, loss {loss.item():.4f}")

    def join(self, optimizer: torch.optim.Optimizer, iteration: Callable[[], int]) -> None:
        """Add the term's gradient to whatever the optimiser is about to take."""
        critic_first = self._settings.critic_first
        hold_actor(self._policy, optimizer, lambda: iteration() < critic_first)

        def before_step(*_: Any) -> None:
            if iteration() < critic_first:
                return
            weight = self.weight(iteration())
            if weight > 0.0:
                (weight * self.loss()).backward()

        optimizer.register_step_pre_hook(before_step)

    def _observations(self, rows: torch.Tensor) -> Any:
        seen = self._seen[rows]
        return seen if self._privileged is None else {SEEN: seen, PRIVILEGED: self._privileged.expand(len(rows), -1)}
