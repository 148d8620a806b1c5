"""What an extended model bought in success: a policy's rate predicted by the nominal and by the extended model, and measured.

All three are tried with the same goals, so that they are compared goal by goal. Rates have Wilson's 80 % intervals, differences
95 % intervals by a bootstrap of goals. A gain of zero is reported as such.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from api_schemas.policy import PolicyManifest
from api_schemas.report import Report, read_report
from api_schemas.success_rate import wilson
from api_schemas.trial import Fault, OutcomeKind
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Group
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import Act, evaluate
from sim_backend.tasks import TASKS
from sim_backend.trifinger.objects import CUBE, Shape, shape_of

RESAMPLES = 9999
BATCH = 100
"""Trials that are tried at once."""
NOISE_SEED = 1 << 40
"""Added to a trial's seed to seed the noise of its prediction: no farm's noise, and the same for both models."""
MEASURED_NAME = "report.json"


@dataclass(frozen=True)
class Measured:
    """Trials of a policy on the robot: their seeds and successes, shape (n,), what was asked, and where the object began.

    Trials without an accepted outcome and those that ended by the platform's fault are not among them.
    """

    task: str
    seeds: tuple[int, ...]
    success: np.ndarray
    shape: Shape = CUBE


@dataclass(frozen=True)
class SuccessRow:
    """A rate with Wilson's 80 % interval; ``label`` is ``nominal``, ``extended`` or ``measured``."""

    label: str
    rate: float
    interval_80: tuple[float, float]


@dataclass(frozen=True)
class SuccessGain:
    """How far the predictions are off.

    Attributes:
        trials: goals that were tried.
        rows: the three rates.
        gap_before: rate predicted by the nominal model minus the measured one, of -1 to 1.
        gap_after: the same of the extended model.
        gap_before_interval_95: by a bootstrap of goals, as the ones below.
        gap_after_interval_95: of the extended model's gap.
        closed: by how much the gap became smaller, absolute; below 0 if it became larger.
        closed_interval_95: of that.
        agreement_before: share of goals for which the nominal model predicts what was measured; chance alone keeps it below 1.
        agreement_after: the same of the extended model.
        summary: a sentence.
        notes: what the figures cannot say.
    """

    trials: int
    rows: tuple[SuccessRow, ...]
    gap_before: float
    gap_after: float
    gap_before_interval_95: tuple[float, float]
    gap_after_interval_95: tuple[float, float]
    closed: float
    closed_interval_95: tuple[float, float]
    agreement_before: float
    agreement_after: float
    summary: str
    notes: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Plain values: the ``success`` section of ``study.json``."""
        return asdict(self)


def read_measured(folder: Path, robot: str | None = None) -> Measured:
    """The trials of a job that ``trifarm fetch`` brought.

    Args:
        folder: where it brought them.
        robot: only this robot's; those of all robots if None.

    Raises:
        ValueError: the folder has no report of trials, or the robot had none; the message says which.
    """
    path = folder / MEASURED_NAME
    if not path.is_file():
        raise ValueError(f"{folder} has no {MEASURED_NAME}; bring a job's with `trifarm fetch JOB --to {folder}`")
    try:
        report = read_report(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"{path} is not the report of a job: {error.errors()[0]['msg']}") from error
    if not isinstance(report, Report):
        raise ValueError(f"{path} is the report of an identification, which has nothing to succeed in; name that of a job")
    rows = [row for row in report.per_trial if robot in (None, row.robot) and _counts(row.outcome.kind, row.outcome.fault)]
    if not rows:
        robots = ", ".join(row.robot for row in report.per_robot)
        raise ValueError(f"{path} has no counted trial{f' of {robot}; its robots are {robots}' if robot else ''}")
    success = np.array([row.outcome.kind is OutcomeKind.SUCCEEDED for row in rows])
    shape = shape_of(report.object.value, report.object_scale)
    return Measured(report.task, tuple(row.seed for row in rows), success, shape)


def _counts(kind: OutcomeKind, fault: Fault) -> bool:
    return fault is not Fault.PLATFORM and kind is not OutcomeKind.CANCELLED


def predicted(
    act: Act,
    manifest: PolicyManifest,
    measured: Measured,
    physics: Physics,
    *,
    threads: int = 1,
    progress: Callable[[int], None] = lambda _trials: None,
) -> np.ndarray:
    """Success of the measured trials' goals with a model, shape (n,).

    Args:
        act: the policy.
        manifest: what it expects.
        measured: the trials.
        physics: of one robot (n = 1).
        threads: of the physics.
        progress: told how many trials are done, now and then.
    """
    found: list[np.ndarray] = []
    for first in range(0, len(measured.seeds), BATCH):
        seeds = measured.seeds[first : first + BATCH]
        noise = np.array([seed % NOISE_SEED + NOISE_SEED for seed in seeds], dtype=float)
        robots = Physics.stack([physics] * len(seeds))
        task = TASKS[measured.task]
        tried = evaluate(act, manifest, task, seeds, physics=robots, noise_seeds=noise, shape=measured.shape, threads=threads)
        found.append(tried.success)
        progress(first + len(seeds))
    return np.concatenate(found)


def success_gain(
    nominal: Sequence[bool] | np.ndarray,
    extended: Sequence[bool] | np.ndarray,
    measured: Sequence[bool] | np.ndarray,
    rng: np.random.Generator,
    *,
    physics: Physics | None = None,
    resamples: int = RESAMPLES,
) -> SuccessGain:
    """Compare outcomes of the same goals, each of shape (n,).

    Args:
        nominal: predicted by the nominal model.
        extended: predicted by the extended one.
        measured: what the robot did.
        rng: for the bootstrap.
        physics: the extended model, for what it does not contain; nothing is said about that if None.
        resamples: of the bootstrap.

    Raises:
        ValueError: the three differ in length, or are empty.
    """
    tried = np.array([nominal, extended, measured], dtype=float) if len(nominal) == len(extended) == len(measured) else None
    if tried is None or tried.shape[1] == 0:
        raise ValueError(
            f"{len(nominal)}, {len(extended)} and {len(measured)} outcomes; nominal, extended and measured must be of the same "
            "goals, at least one"
        )
    trials = tried.shape[1]
    counts = rng.multinomial(trials, np.full(trials, 1 / trials), size=resamples)
    drawn = counts @ tried.T / trials
    before, after = drawn[:, 0] - drawn[:, 2], drawn[:, 1] - drawn[:, 2]
    rates = tried.mean(axis=1)
    gap_before, gap_after = float(rates[0] - rates[2]), float(rates[1] - rates[2])
    closed_95 = _middle_95(np.abs(before) - np.abs(after))
    return SuccessGain(
        trials=trials,
        rows=tuple(_row(label, row) for label, row in zip(("nominal", "extended", "measured"), tried, strict=True)),
        gap_before=gap_before,
        gap_after=gap_after,
        gap_before_interval_95=_middle_95(before),
        gap_after_interval_95=_middle_95(after),
        closed=abs(gap_before) - abs(gap_after),
        closed_interval_95=closed_95,
        agreement_before=float((tried[0] == tried[2]).mean()),
        agreement_after=float((tried[1] == tried[2]).mean()),
        summary=_summary(rates, trials, gap_before, gap_after, closed_95),
        notes=_notes(physics),
    )


def _row(label: str, success: np.ndarray) -> SuccessRow:
    return SuccessRow(label, float(success.mean()), wilson(int(success.sum()), len(success), 0.80))


def _middle_95(values: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def _summary(rates: np.ndarray, trials: int, before: float, after: float, closed_95: tuple[float, float]) -> str:
    nominal, extended, measured = (f"{rate:.0%}" for rate in rates)
    if closed_95[0] > 0.0:
        gained = "the extended model predicts better"
    elif closed_95[1] < 0.0:
        gained = "the extended model predicts worse"
    else:
        gained = f"no difference that {trials} trials can tell" if before != after else "no gain"
    points = f"{100 * before:+.1f} to {100 * after:+.1f} points"
    return f"success simulated {nominal} -> {extended}, measured {measured} ({trials} trials): gap {points}, {gained}"


def _notes(physics: Physics | None) -> tuple[str, ...]:
    notes = ["goals and starts are those of the trials' seeds; a farm that sweeps its arena begins where the object came to lie"]
    if physics is not None:
        there = {CATALOGUE[name].group for name in CATALOGUE if physics.has(name)}
        lacking = [str(group) for group in (Group.CONTACT, Group.TRACKING) if group not in there]
        if lacking:
            notes.append(
                f"the extended model has no effect of {' or '.join(lacking)}, which logs of joints alone cannot show; pushing "
                "and lifting depend on them, too"
            )
    return tuple(notes)
