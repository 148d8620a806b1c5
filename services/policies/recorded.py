"""What a robot saw in real trials of several tasks, as any manifest's policy would have seen it.

The files beside this one are written by ``python -m tests.benchmarks.record_observations``; their headers say what they were made
with. Images are kept small and shown in any size.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import safetensors.numpy

from api_schemas.observation import OBSERVATION_SIZES, term_of
from api_schemas.policy import ACTION_SIZE, PolicyManifest

RECORDING = Path(__file__).with_name("recorded_observations.safetensors")
IMAGE_RECORDING = Path(__file__).with_name("recorded_images.safetensors")
IMAGES = "images"
PREVIOUS_ACTION = "previous_action"
"""Not recorded: it is the tried policy's own, zero before its first, as in every trial."""
FIELDS = tuple(name for name in OBSERVATION_SIZES if name != PREVIOUS_ACTION)


@dataclass(frozen=True)
class RecordedTrial:
    """The beginning of one trial.

    ``fields`` holds, by name, arrays of shape (steps, size) in the field's unit, one row for each control period of 20 ms.
    """

    task: str
    fields: Mapping[str, np.ndarray]

    @property
    def steps(self) -> int:
        """How many observations there are."""
        return len(next(iter(self.fields.values())))

    def observation(self, step: int, manifest: PolicyManifest, previous_actions: np.ndarray) -> np.ndarray:
        """What a policy of this manifest sees at a step; float32, shape (n,).

        Args:
            step: counted from the trial's begin.
            manifest: the policy's.
            previous_actions: its action before the step, shape (9,), or all of the trial, the oldest first, shape (k, 9).
        """
        return np.concatenate([self._seen(name, step, previous_actions) for name in manifest.observation]).astype(np.float32)

    def _seen(self, text: str, step: int, previous_actions: np.ndarray) -> np.ndarray:
        term = term_of(text)
        if term.field is None:
            return np.array(term.constant)
        rows, at = self.fields.get(term.field), step
        if rows is None:
            rows = np.atleast_2d(previous_actions)
            at = len(rows) - 1
        return np.concatenate([rows[max(0, at - ago)][list(term.numbers)] for ago in term.periods_ago])


def recorded_trials(path: Path = RECORDING) -> tuple[RecordedTrial, ...]:
    """The trials of a recording, in the order of their names."""
    tensors = safetensors.numpy.load(path.read_bytes())
    tasks = sorted({name.partition("/")[0] for name in tensors})
    return tuple(RecordedTrial(task, {field: tensors[f"{task}/{field}"] for field in FIELDS}) for task in tasks)


@functools.lru_cache(maxsize=2)
def recorded_images(edge_px: int, path: Path = IMAGE_RECORDING) -> tuple[np.ndarray, ...]:
    """What the cameras of a robot saw of a few scenes, each of shape (3, edge, edge, 3), uint8."""
    kept = safetensors.numpy.load(path.read_bytes())[IMAGES]
    at = np.arange(edge_px) * kept.shape[2] // edge_px
    return tuple(np.ascontiguousarray(each[:, at][:, :, at]) for each in kept)


def observations(manifest: PolicyManifest) -> np.ndarray:
    """All recorded observations as a policy sees them that has never acted, float32, shape (steps of all trials, n)."""
    still = np.zeros(ACTION_SIZE)
    return np.stack([trial.observation(step, manifest, still) for trial in recorded_trials() for step in range(trial.steps)])
