"""What PPO learns from where its rollouts are spread over workers: the same bits for any number of them, also ahead of updates.

The robots are divided into slices, each with seeds of its own (``rollouts.py``). In an iteration each slice is rolled out once by
whichever worker is free; all are put together in the order of the slices before anything is summed. A checkpoint is written after
an update and holds the state of every slice, so that a run that goes on from there is the run that was never ended.
"""

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer

from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.environments.vec_env import PRIVILEGED, SEEN
from sim_backend.training.actor_critic import ActorCritic, whole_of
from sim_backend.training.ledger import Ledger, account
from sim_backend.training.recipe import Recipe
from sim_backend.training.returns import advantages_by_importance
from sim_backend.training.rollouts import Rollout
from sim_backend.training.slice_collector import Collected, SliceCollector, Weights

if TYPE_CHECKING:
    from sim_backend.training.progress import Watch
    from sim_backend.training.train import Run


class Slices(AbstractContextManager["Slices"]):
    """What PPO learns from: iterations of all slices, what they are worth, and what the run used and did.

    With ``ppo.lag`` of 1 workers roll an iteration out while the learner is busy with the one before, so that its networks are
    those before the last updates. The present policy's log-probabilities and the present critic's values then take the place of
    what workers wrote, and advantages are weighted (:func:`~sim_backend.training.returns.advantages_by_importance`). What follows
    an iteration's last step, or a trial that only time ended, stays valued by the older critic: it was seen by workers only.

    Args:
        run: that learns.
        workers: how many; 0 for the calling process.
        cluster: as for ``open_workers``.

    Raises:
        ValueError: the recipe does not go with workers; the message says why.
    """

    def __init__(self, run: "Run", workers: int, cluster: str | None) -> None:
        _check(run.recipe, workers)
        self.run, self._count, self._cluster, self._recipe = run, workers, cluster, run.recipe
        self.collector = SliceCollector(run.recipe, workers, cluster, run.threads)
        self._return = np.zeros(run.recipe.ppo.robots)
        self._seconds = {"waiting": 0.0, "learning": 0.0, "rolling out": 0.0}
        self._moved_bytes = self._lost = self._samples = self._behind = 0
        self._weights = [0.0, 0]  # sum of the importance weights before they are limited, and how many were limited
        self._older: Weights | None = None  # by which the next iteration is rolled out, if it is not under way
        self.watch: Watch | None = None

    def __enter__(self) -> "Slices":
        """Begin the workers."""
        self.collector.__enter__()
        self._ledger = Ledger.of_next_start(self.run.folder, self.run.starts)
        self.run.starts = self._ledger.start
        self._ledger.write("started", self.run.iterations)
        return self

    def __exit__(self, *failed: Any) -> None:
        """End the workers."""
        self.collector.__exit__(*failed)

    def look_around(self) -> None:
        """Learn the scaling of the inputs from actions by chance, before anything else; these samples are not learned from."""
        self.collector.start(self.run.iterations, None)
        columns = self._collected().columns
        seen = {name: torch.from_numpy(columns[name].reshape(-1, columns[name].shape[-1])) for name in self._parts}
        self.run.policy.features_extractor.learn_scaling(whole_of(seen) if PRIVILEGED in seen else seen[SEEN])
        self.collector.states = [None] * self._recipe.ppo.slices

    def ahead(self) -> None:
        """Before an iteration's updates: let workers begin with the next, if they may be behind.

        At the end of a run, or of this start of it, only the networks are kept: whoever goes on rolls out by them.
        """
        run = self.run
        if not self._recipe.ppo.lag:
            return
        if run.samples < self._recipe.samples and not run.stopped:
            self._start(self._networks())
        else:
            self._older = self._networks()

    def _start(self, weights: Weights) -> None:
        self._ledger.write("asked", self.run.iterations, self._samples_of_iteration)
        self.collector.start(self.run.iterations, weights)

    def _networks(self) -> Weights:
        """A copy where they are used while the learner changes them."""
        given = {name: values.numpy() for name, values in self.run.policy.state_dict().items()}
        return {name: values.copy() for name, values in given.items()} if self._recipe.ppo.lag else given

    def collect(self, buffer: RolloutBuffer) -> None:
        """Fill PPO's buffer with an iteration of all slices, whose observations stay where the workers wrote them."""
        run = self.run
        behind = self.collector.under_way is not None or self._older is not None
        if self.collector.under_way is None:
            self._start(self._older or self._networks())
            self._older = None
        collected = self._collected()
        columns, rollouts = collected.columns, collected.rollouts
        self._behind += behind * self._samples_of_iteration
        rewards = np.empty_like(columns["rewards"])
        for step, (reward, done) in enumerate(zip(columns["rewards"], columns["dones"], strict=True)):
            rewards[step] = run.returns.scaled(reward, done)
        rewards += np.float32(self._recipe.ppo.discount) * columns["bootstrap"]
        buffer.reset()
        seen = {name: columns[name] for name in self._parts}
        if isinstance(buffer, DictRolloutBuffer):
            buffer.observations = seen
        else:
            buffer.observations = seen[SEEN]
        buffer.actions, buffer.rewards = columns["actions"], rewards
        buffer.values, buffer.log_probs = columns["values"], columns["log_probs"]
        buffer.episode_starts[1:] = columns["dones"][:-1]
        buffer.pos, buffer.full = len(rewards), True
        last_values = np.concatenate([rollout.last_values for rollout in rollouts])
        if behind:
            self._weigh(buffer, seen, columns["dones"], last_values)
        else:
            buffer.compute_returns_and_advantage(torch.from_numpy(last_values), columns["dones"][-1])
        self._count_trials(columns["rewards"], rollouts)

    def _collected(self) -> Collected:
        assert self.collector.under_way is not None
        _, weights = self.collector.under_way
        collected = self.collector.finish()
        of_slice = self._samples_of_iteration // self._recipe.ppo.slices
        for place in collected.lost if weights is not None else ():
            self._ledger.write("lost", self.run.iterations, of_slice, slice=place)
        self._lost += len(collected.lost)
        self._moved_bytes += collected.moved_bytes
        self._seconds["waiting"] += collected.waited_s
        self._seconds["rolling out"] += sum(rollout.work_s for rollout in collected.rollouts)
        return collected

    def _weigh(self, buffer: RolloutBuffer, seen: dict[str, np.ndarray], dones: np.ndarray, last_values: np.ndarray) -> None:
        """What an older policy's rollouts are worth to the present one."""
        ppo, shape, policy = self._recipe.ppo, buffer.rewards.shape, self.run.policy
        assert isinstance(policy, ActorCritic)
        values, log_probs = np.empty(shape, np.float32), np.empty(shape, np.float32)
        with torch.no_grad():
            for step in range(len(values)):
                parts = {name: torch.from_numpy(array[step]) for name, array in seen.items()}
                acted = torch.from_numpy(buffer.actions[step])
                found = policy.evaluate_actions(parts if PRIVILEGED in parts else parts[SEEN], acted)
                values[step], log_probs[step] = found[0].flatten().numpy(), found[1].numpy()
        likelier = np.exp(log_probs - buffer.log_probs)
        self._weights[0] += float(likelier.sum(dtype=np.float64))
        self._weights[1] += int((likelier > 1.0).sum())
        buffer.values, buffer.log_probs = values, log_probs
        buffer.advantages, buffer.returns = advantages_by_importance(
            buffer.rewards, values, last_values, dones, np.minimum(likelier, 1.0), ppo.discount, ppo.gae_lambda
        )

    def _count_trials(self, rewards: np.ndarray, rollouts: list[Rollout]) -> None:
        robots, steps = self._recipe.ppo.robots // self._recipe.ppo.slices, self._recipe.ppo.steps
        ends: dict[int, list[tuple[int, bool]]] = {step: [] for step in range(steps)}
        for rollout in rollouts:
            for step, robot, success in rollout.ended:
                ends[step].append((rollout.slice * robots + robot, success))
        for step, ended in ends.items():
            self._return += rewards[step]
            over = [robot for robot, _ in ended]
            assert self.watch is not None
            self.watch.count([success for _, success in ended], self._return[over].tolist())
            self._return[over] = 0.0

    def updated(self, learning_s: float) -> None:
        """After the updates of an iteration: its samples are used, and what is kept from now on has them in it."""
        self._seconds["learning"] += learning_s
        self._samples += self._samples_of_iteration
        self._ledger.write("used", self.run.iterations - 1, self._samples_of_iteration)
        assert self.watch is not None
        self.watch.updated()

    @property
    def _samples_of_iteration(self) -> int:
        return self._recipe.ppo.robots * self._recipe.ppo.steps

    @property
    def _parts(self) -> tuple[str, ...]:
        return (SEEN, PRIVILEGED) if self._recipe.networks.privileged else (SEEN,)

    def document(self) -> dict[str, Any]:
        """What the run used and did: workers, samples, lag, idle share of the learner, bytes for each sample."""
        waiting_s, learning_s = self._seconds["waiting"], self._seconds["learning"]
        ledger, samples = account(self.run.folder), max(self._samples, 1)
        return {
            "workers": self._count,
            "cluster": self._cluster is not None,
            "slices": self._recipe.ppo.slices,
            "workers_lost": self._lost,
            "asked": ledger.asked,
            "used": ledger.used,
            "dropped": ledger.dropped,
            "lag_updates": round(self._behind / samples, 4),  # of a sample, in the mean
            "importance_weight": round(self._weights[0] / self._behind, 4) if self._behind else None,
            "weights_limited_share": round(self._weights[1] / self._behind, 4) if self._behind else None,
            "learner_idle_share": round(waiting_s / max(waiting_s + learning_s, 1e-9), 4),
            "seconds": {name: round(value, 2) for name, value in self._seconds.items()},
            "moved_bytes_per_sample": round(self._moved_bytes / samples, 1),
            "shared_bytes_per_sample": round(self.collector.shared_bytes_per_sample, 1),
        }

    def state(self) -> dict[str, Any]:
        """For the checkpoint: tensors, numbers, lists and tables. Of what is under way only the networks are kept."""
        own = [
            self.collector.states,
            self._return,
            self.run.returns.running,
            self._seconds,
            [self._moved_bytes, self._lost, self._samples, self._behind, *self._weights],
            self.collector.under_way[1] if self.collector.under_way else self._older,
        ]
        return {"slices": self._recipe.ppo.slices, "own": _tensors(own)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`state` gave, with any number of workers."""
        self.collector.states, self._return, self.run.returns.running, self._seconds, counts, self._older = _arrays(state["own"])
        self._moved_bytes, self._lost, self._samples, self._behind, *self._weights = counts


def _check(recipe: Recipe, workers: int) -> None:
    """Workers go with what is written for them so far."""
    robots, slices = recipe.ppo.robots, recipe.ppo.slices
    if robots % slices:
        raise ValueError(f"ppo.slices is {slices}; it must divide ppo.robots, {robots}")
    if workers > slices:
        raise ValueError(f"{workers} workers cannot share {slices} slices; ask for {slices} at most, or set ppo.slices")
    for what, there in (
        (f"method {recipe.method!r}", recipe.method != "ppo"),
        ("networks.memory", recipe.networks.memory is not None),
        ("a [[curriculum]]", bool(recipe.curriculum)),
        ("randomization.method 'adr'", recipe.randomization.method != "none"),
        (f"physics_backend {recipe.physics_backend.value!r}", recipe.physics_backend is not PhysicsBackend.CPU),
    ):
        if there:
            raise ValueError(f"{what} does not go with --workers; leave one of them out")


def _tensors(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return torch.from_numpy(value.copy())
    if isinstance(value, dict):
        return {name: _tensors(each) for name, each in value.items()}
    return [_tensors(each) for each in value] if isinstance(value, list) else value


def _arrays(value: Any) -> Any:
    if isinstance(value, torch.Tensor):
        return value.numpy()
    if isinstance(value, dict):
        return {name: _arrays(each) for name, each in value.items()}
    return [_arrays(each) for each in value] if isinstance(value, list) else value
