"""Success of a policy on the robot that a study is about, predicted by the nominal and by the extended model."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from api_schemas.policy import PolicyManifest
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import Act
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.success.gain import Measured, SuccessGain, predicted, read_measured, success_gain
from sim_backend.reality_gap.success.policy_file import load_policy


@dataclass(frozen=True)
class Trials:
    """What a user names: a job's folder as ``trifarm fetch`` made it, the policy's file and its manifest (or layout)."""

    folder: Path
    policy: Path
    manifest: str


@dataclass(frozen=True)
class Question:
    """Trials and policy, read."""

    measured: Measured
    act: Act
    manifest: PolicyManifest


def read_question(trials: Trials, robot: str | None) -> Question:
    """Read both before any long work.

    Args:
        trials: what was named.
        robot: whose trials count; those of all robots if None.

    Raises:
        RecordingError: there are no such trials, or the file is no policy for the manifest; the message says which.
    """
    try:
        measured = read_measured(trials.folder, robot)
        act, manifest = load_policy(trials.policy, trials.manifest)
    except ValueError as error:
        raise RecordingError(str(error)) from error
    return Question(measured, act, manifest)


def success_of(
    question: Question, extended: Physics, rng: np.random.Generator, progress: Callable[[str, float], None]
) -> SuccessGain:
    """Try every goal with both models and compare with what was measured.

    Args:
        question: policy and trials.
        extended: the model of the study.
        rng: for the bootstrap.
        progress: told what is done, and which share of all.
    """
    goals = len(question.measured.seeds)

    def success(name: str, physics: Physics, share: float) -> np.ndarray:
        def told(done: int) -> None:
            progress(f"{name} model: {done} of {goals} trials", share + 0.5 * done / goals)

        threads = os.cpu_count() or 1
        return predicted(question.act, question.manifest, question.measured, physics, threads=threads, progress=told)

    nominal, better = success("nominal", Physics.nominal(), 0.0), success("extended", extended, 0.5)
    return success_gain(nominal, better, question.measured.success, rng, physics=extended)
