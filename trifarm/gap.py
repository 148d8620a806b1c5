"""Measured data against the simulation."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.study import StudyResult, run_study
from trifarm.wording import of_python


def study(
    source: Path | str,
    out: Path | str,
    *,
    data: Path | str | None = None,
    method: Literal["naming", "rollouts", "torques", "simopt", "coordinate-descent"] = "naming",
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda *_: None,
) -> StudyResult:
    """Says where measured data and a model disagree, names the cause, writes the better model and measures its gain.

    Args:
        source: a folder of a farm's logs, or a ``study.toml`` that describes any robot's recordings.
        out: folder for ``study.json``, ``report.html`` and the extended model; made if absent.
        data: folder of the recordings that a ``study.toml`` names; beside the file if None.
        method: ``naming`` judges every effect: of a ``study.toml`` by torques and simulated motions, of a farm's logs by torques.
            ``rollouts`` (simulated motions alone) and ``torques`` are for a ``study.toml``. ``simopt`` and ``coordinate-descent``
            only calibrate numbers.
        seed: of permutations and bootstraps.
        progress: called with what is being done and the share that is done, 0 to 1.

    Returns:
        The verdict, the document of the report, and the files that were written.

    Raises:
        RecordingError: the data cannot be used; the message names file, place and reason.

    Example:
        >>> import trifarm
        >>> result = trifarm.study("pendulum/study.toml", "answer")
        >>> result.verdict.verdict.value
        'named'
    """
    folder = None if data is None else Path(data)
    try:
        return run_study(Path(source), Path(out), data_root=folder, method=method, seed=seed, progress=progress)
    except RecordingError as error:
        error.args = (of_python(str(error), {}),)
        raise
