"""Demonstrations as files: what a policy saw and did in trials that succeeded, in the environment or on a farm.

    python -m sim_backend.training.demonstrations.recording POLICY --task push --out FILE [--trials 100] [--physics real]
        [--first-seed N] [--noise 0.3] [--layout NAME] [--failed-too]
    python -m sim_backend.training.demonstrations.recording --logs FOLDER --out FILE [--failed-too]

The first lets a policy (a shipped one's name, or a file) try goals; with ``--noise`` its torques are disturbed, in each trial by
another amount up to that share of the largest, while what it wanted is what is kept: clones of undisturbed demonstrations fail as
soon as they leave the path. Run again, it goes on with what is missing. The second reads the logs that ``trifarm fetch`` brought.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from api_schemas.policy import PolicyManifest
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import begin_trials
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.training.demonstrations.teacher import find_policy
from sim_backend.training.export import ExportedPolicy
from sim_backend.training.trying import robots_of
from sim_backend.trifinger import constants as c
from trial_logs.disk import put_in_place
from trial_logs.reader import LogUnreadableError, TrialLog, read_log

TRIALS_AT_ONCE = 50
TRAINING_STEP_S = 0.004
"""As in training; experts succeed as often as with 1 ms."""


@dataclass(frozen=True)
class Demonstrations:
    """Trials one after the other.

    Attributes:
        observation: shape (samples, size), as the manifest names it.
        action: shape (samples, 9), what the policy wanted, as the manifest means it.
        first: shape (trials,), index of each trial's first sample.
        manifest: of the policy that acted.
        tried: trials that were tried, with those that were left out because they failed.
    """

    observation: np.ndarray
    action: np.ndarray
    first: np.ndarray
    manifest: PolicyManifest
    tried: int


def write_demonstrations(demonstrations: Demonstrations, path: Path, source: dict) -> None:
    """Write a safetensors file; ``source`` says where they come from."""
    arrays = {"observation": demonstrations.observation.astype(np.float32), "action": demonstrations.action.astype(np.float32)}
    about = {"manifest": demonstrations.manifest.model_dump_json(), "tried": str(demonstrations.tried)}
    fresh = path.with_name(path.name + ".new")
    save_file(arrays | {"first": demonstrations.first}, fresh, metadata=about | {"source": json.dumps(source)})
    put_in_place(fresh, path)


def read_demonstrations(path: Path) -> Demonstrations:
    """Demonstrations as they were written.

    Raises:
        ValueError: the file is not there or holds none.
    """
    if not path.is_file():
        raise ValueError(f"there are no demonstrations {path}; record some with sim_backend.training.demonstrations.recording")
    try:
        with safe_open(path, framework="numpy") as file:
            about = file.metadata() or {}
            observation, action, first = (file.get_tensor(name) for name in ("observation", "action", "first"))
        manifest = PolicyManifest.model_validate_json(about["manifest"])
        return Demonstrations(observation, action, first, manifest, int(about["tried"]))
    except (SafetensorError, KeyError) as error:
        raise ValueError(f"{path} holds no demonstrations ({error}); record them anew") from error


def source_of(path: Path) -> dict:
    """What :func:`write_demonstrations` was told of where they come from."""
    with safe_open(path, framework="numpy") as file:
        return json.loads((file.metadata() or {})["source"])


def joined(parts: list[Demonstrations]) -> Demonstrations:
    """One after the other; all are of policies that see the same."""
    observations = {part.manifest.observation for part in parts}
    if len(observations) != 1:
        raise ValueError(f"the demonstrations see {len(observations)} different things; take those of one kind of policy")
    ends = np.cumsum([0, *(len(part.observation) for part in parts)])
    first = np.concatenate([part.first + end for part, end in zip(parts, ends, strict=False)])
    observation, action = (np.concatenate([getattr(part, name) for part in parts]) for name in ("observation", "action"))
    return Demonstrations(observation, action, first, parts[0].manifest, sum(part.tried for part in parts))


def record_trials(
    policy: ExportedPolicy,
    task: str,
    seeds: range,
    physics: Physics,
    *,
    noise: float,
    rng: np.random.Generator,
    failed_too: bool = False,
) -> Demonstrations:
    """Let a policy try the goals of the seeds on these robots, its actions disturbed; keeps the trials that succeed."""
    n, manifest = len(seeds), policy.manifest
    episode, goal = begin_trials(manifest, TASKS[task], seeds, physics=physics, threads=1, physics_step_s=TRAINING_STEP_S)
    policy.begin(n)
    deviation = rng.uniform(0, noise, (n, 1)) * c.MAX_TORQUE_NM
    seen, wanted = [], []
    for _ in range(TASKS[task].steps // manifest.period_steps):
        seen.append(episode.observe().astype(np.float32))
        wanted.append(np.asarray(policy(seen[-1]), dtype=np.float32))
        episode.advance(wanted[-1] + deviation * rng.standard_normal((n, 9)))
    state = episode.measurement
    scores = score(TASKS[task], goal, state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
    kept = np.flatnonzero(scores.success | failed_too)
    observation, action = (np.stack(each, axis=1)[kept].reshape(-1, each[0].shape[1]) for each in (seen, wanted))
    return Demonstrations(observation, action, np.arange(len(kept)) * len(seen), manifest, n)


def from_logs(folder: Path, *, failed_too: bool = False) -> Demonstrations:
    """The policy's trials that succeeded, of the logs in a folder.

    Raises:
        ValueError: there are none, or their policies see different things.
    """
    parts = []
    paths = sorted(folder.glob("*.mcap"))
    for path in paths:
        try:
            log = read_log(path)
        except LogUnreadableError as error:
            raise ValueError(f"{error}; take it out of the folder") from error
        if (failed_too or log.outcome.get("kind") == "succeeded") and log.manifest is not None and len(log.observation):
            parts.append(_of_log(log, log.manifest))
    if not parts:
        raise ValueError(
            f"{folder} has {len(paths)} logs, and none is of a policy's trial that succeeded; fetch a job that has some"
        )
    found = joined(parts)
    return Demonstrations(found.observation, found.action, found.first, found.manifest, len(paths))


def _of_log(log: TrialLog, manifest: str) -> Demonstrations:
    known = PolicyManifest.model_validate_json(manifest)
    return Demonstrations(log.observation, log.action, np.zeros(1, dtype=np.int64), known, 1)


def record(options: argparse.Namespace) -> Demonstrations:
    """Record what is missing, in pieces, telling how fast and how long."""
    policy = find_policy(options.policy, options.layout)
    source = {name: getattr(options, name) for name in ("policy", "task", "physics", "first_seed", "noise", "failed_too")}
    how = {"noise": options.noise, "failed_too": options.failed_too}
    kept = [read_demonstrations(options.out)] if options.out.exists() else []
    if kept and source_of(options.out) != source:
        raise ValueError(f"{options.out} holds demonstrations made with other settings; give another --out")
    begun_s, before = time.monotonic(), sum(part.tried for part in kept)
    done = before
    while done < options.trials:
        n = min(TRIALS_AT_ONCE, options.trials - done)
        first = options.first_seed + done
        robots, rng = robots_of(options.physics, n, first), np.random.default_rng(first)
        kept.append(record_trials(policy, options.task, range(first, first + n), robots, **how, rng=rng))
        kept = [joined(kept)]
        write_demonstrations(kept[0], options.out, source)
        done += n
        rate = (done - before) / (time.monotonic() - begun_s)
        left_min = (options.trials - done) / rate / 60
        good = len(kept[0].first)
        print(f"{done} of {options.trials} trials, {good} succeeded  {rate:.2f}/s  {left_min:.1f} min left", file=sys.stderr)
    return kept[0]


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Record demonstrations.")
    parser.add_argument("policy", nargs="?")
    parser.add_argument("--layout")
    parser.add_argument("--task", choices=list(TASKS))
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=40_000_000)
    parser.add_argument("--physics", default="real")
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--failed-too", action="store_true")
    parser.add_argument("--logs", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    if (options.logs is None) == (options.policy is None) or (options.policy and not options.task):
        parser.error("give a policy and a --task, or --logs FOLDER")
    try:
        if options.logs is None:
            found = record(options)
        else:
            found = from_logs(options.logs, failed_too=options.failed_too)
            write_demonstrations(found, options.out, {"logs": options.logs.name})
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{options.out}: {len(found.first)} of {found.tried} trials, {len(found.observation)} samples")
    return 0


if __name__ == "__main__":
    sys.exit(main())
