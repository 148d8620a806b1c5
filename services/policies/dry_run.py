"""A first run of a converted graph, before anything is queued: on what a robot saw in real trials, the way a robot asks it.

One observation after the other with the memory of a trial, forgotten between trials, the policy's own last action among what it
sees. What a robot would end a trial for, or what no robot can carry out, is refused here.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from api_schemas import policy_graph
from api_schemas.observation import MOST_PERIODS_AGO
from api_schemas.physics import MAX_TORQUE_NM, SOFT_LIMIT_LOWER_RAD, SOFT_LIMIT_UPPER_RAD
from api_schemas.policy import ACTION_SIZE, ActionKind, PolicyManifest
from api_schemas.policy_graph import GraphRunner, Session
from services.policies.recorded import RecordedTrial, recorded_images, recorded_trials
from services.policies.unfit import UnfitError, too_slow

ENOUGH_CPU_S = 1.0
"""A policy that has computed for so long is judged by the actions that it has given."""
TOLERANCE = 1.01
"""Published policies were trained with a torque limit of 0.397 N m."""
MOST_OUTSIDE = 0.5
"""Robots clip what is asked beyond their limits, and good policies ask for it now and then; not most of the time."""
NOISE = 1e-6
"""N m or rad; actions that differ by less are the same."""
UNITS = {ActionKind.TORQUE: "N m", ActionKind.JOINT_POSITION: "rad", ActionKind.JOINT_POSITION_DELTA: "rad"}


@dataclass(frozen=True)
class DryRun:
    """The actions of all trials one after the other, shape (n, 9), and the CPU time that each took, shape (n,)."""

    actions: np.ndarray
    spent_s: np.ndarray


def load(graph: Path) -> Session:
    """A session as robots have it.

    Raises:
        UnfitError: the runtime cannot load the graph.
    """
    try:
        return policy_graph.session(graph)
    except Exception as error:
        raise UnfitError(f"the runtime cannot load the network: {error}") from error


def run(session: Session, manifest: PolicyManifest) -> list[str]:
    """Runs the graph through the recorded trials and judges it; gives a sentence for each thing a user should know.

    Raises:
        UnfitError: the network fails, or no robot could run it.
    """
    done = _through_trials(session, manifest)
    check_finite(done.actions)
    check_pace(done.spent_s, 1 / manifest.rate_hz)
    warnings = check_limits(done.actions, manifest.action_kind)
    check_varied(done.actions)
    return warnings


def _through_trials(session: Session, manifest: PolicyManifest) -> DryRun:
    actions, spent_s = [], []
    policy = GraphRunner(session)
    for trial in recorded_trials():
        policy.forget()
        for action, cpu_s in _trial(policy, trial, manifest):
            actions.append(action)
            spent_s.append(cpu_s)
            if sum(spent_s) > ENOUGH_CPU_S:
                return DryRun(np.stack(actions), np.array(spent_s))
    return DryRun(np.stack(actions), np.array(spent_s))


def _trial(policy: GraphRunner, trial: RecordedTrial, manifest: PolicyManifest) -> Iterator[tuple[np.ndarray, float]]:
    actions = [np.zeros(ACTION_SIZE, np.float32)]
    seen = [None] if manifest.images is None else recorded_images(manifest.images.edge_px)
    for step in range(trial.steps):
        observation = trial.observation(step, manifest, np.stack(actions[-MOST_PERIODS_AGO - 1 :]))[None]
        began_s = time.process_time()
        try:
            action = policy.act(observation, seen[step % len(seen)])
        except Exception as error:
            reason = str(error).strip()[:300]
            raise UnfitError(f"the network fails on a recorded observation ({reason})", slug="dry-run-failed") from error
        cpu_s = time.process_time() - began_s
        if action.shape != (1, ACTION_SIZE):
            raise UnfitError(f"the network gives an array of shape {action.shape} instead of (1, {ACTION_SIZE})")
        actions.append(action[0])
        yield action[0], cpu_s


def check_finite(actions: np.ndarray) -> None:
    """Raises unless all actions are numbers; a trial ends at the first that is not.

    Raises:
        UnfitError: says which action is not.
    """
    wrong = ~np.isfinite(actions).all(axis=1)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise UnfitError(
            f"{int(wrong.sum())} of {len(actions)} actions on recorded observations are not finite, first number {first + 1}: "
            f"{actions[first].tolist()}",
            part="the dry run",
            instead="look for a division by zero, a root or a logarithm, and for inputs that are not scaled",
            slug="dry-run-not-finite",
        )


def check_pace(spent_s: np.ndarray, period_s: float) -> None:
    """Raises unless the typical action is ready within a control period.

    Raises:
        UnfitError: says how long it takes.
    """
    typical_s = float(np.median(spent_s))
    if typical_s > period_s:
        raise too_slow(f"an action takes {typical_s * 1e3:.3g} ms of CPU time, the control period is {period_s * 1e3:g} ms")


def check_limits(actions: np.ndarray, kind: ActionKind) -> list[str]:
    """Raises when most of what a policy asks for is more than a robot can do; a sentence where some is.

    Raises:
        UnfitError: says the limits and what was asked.
    """
    lower, upper = limits(kind)
    share = float(((actions < lower) | (actions > upper)).mean())
    if share == 0:
        return []
    unit = UNITS[kind]
    said = (
        f"asks for {actions.min():.3g} to {actions.max():.3g} {unit}, and {share:.0%} of its numbers lie outside of what a robot "
        f"does ({_span(lower, upper)} {unit})"
    )
    if share <= MOST_OUTSIDE:
        return [f"{said}; robots clip them"]
    raise UnfitError(
        f"the policy {said}",
        part="the dry run",
        instead="state in output_scaling what an output of 1 is (scale) and where the training clipped it (clip), "
        "and check action_kind",
        slug="dry-run-limits",
    )


def limits(kind: ActionKind) -> tuple[np.ndarray, np.ndarray]:
    """The least and the most that a robot does with each number of an action of this kind, shape (9,) each."""
    if kind is ActionKind.TORQUE:
        most = np.full(ACTION_SIZE, MAX_TORQUE_NM * TOLERANCE)
        return -most, most
    lower, upper = np.array(SOFT_LIMIT_LOWER_RAD), np.array(SOFT_LIMIT_UPPER_RAD)
    if kind is ActionKind.JOINT_POSITION:
        return lower, upper
    return lower - upper, upper - lower


def _span(lower: np.ndarray, upper: np.ndarray) -> str:
    """Once where the three fingers' joints are all alike, else joint by joint of one finger."""
    pairs = [f"{low:.3g} to {high:.3g}" for low, high in zip(lower[:3], upper[:3], strict=True)]
    return pairs[0] if len(set(pairs)) == 1 else ", ".join(pairs)


def check_varied(actions: np.ndarray) -> None:
    """Raises when the actions do not depend on what is observed.

    Raises:
        UnfitError: shows the one action.
    """
    if len(actions) > 1 and float(np.ptp(actions, axis=0).max()) <= NOISE:
        raise UnfitError(
            f"the policy gives the same action on {len(actions)} different observations: "
            f"{[round(float(number), 4) for number in actions[0]]}",
            part="the dry run",
            instead="check input and output scaling: an input that is clipped to a corner, or an output that always saturates, "
            "makes every observation look the same; or the weights are not those of the training",
            slug="dry-run-constant",
        )
