"""A report as plain text for people, at most 100 columns wide."""

from collections.abc import Iterator

from api_schemas.report import FaultRow, Report, TimingRow, TrialRow
from api_schemas.trial import Fault, OutcomeKind

WIDTH = 100
REASON_WIDTH = 44


def render(report: Report) -> str:
    """The whole report: rate and intervals first, then robots, trials, and apart from them the platform's faults."""
    return "\n".join(line[:WIDTH].rstrip() for line in _lines(report)) + "\n"


def _lines(report: Report) -> Iterator[str]:
    yield f"Report of job {report.job_id}: {report.trials} x {report.task} with policy {_cut(report.policy_name, 40)}"
    yield f"policy {report.policy}   seed {report.seed}"
    yield ""
    yield f"success rate   {report.successes} of {report.trials} = {report.success_rate:.3f}"
    yield f"  80 % interval {_interval(report.interval_80)}   95 % interval {_interval(report.interval_95)}   (Wilson)"
    yield f"  reached at any time {report.success_ever} of {report.trials}{_means(report)}"
    policy_faults = f"policy {report.policy_faults} (counted as failures)"
    yield f"faults         {policy_faults}, platform {report.platform_faults} (not counted)"
    yield f"attempts       {report.attempts} for {report.trials} trials"
    yield from _timing(report.timing)
    yield ""
    yield f"{'robot':<20} {'trials':>6} {'successes':>9} {'rate':>6}  {'80 % interval':<13}  {'platform faults':>15}"
    for row in report.per_robot:
        rate = f"{row.robot:<20} {row.trials:>6} {row.successes:>9} {row.success_rate:>6.3f}"
        yield f"{rate}  {_interval(row.interval_80):<13}  {row.platform_faults:>15}"
    yield ""
    yield f"{'trial':>5} {'robot':<16} {'outcome':<20} {'error mm':>8} {'deg':>6} {'tries':>5}  reason"
    for row in report.per_trial:
        yield _trial(row)
    yield from _faults(report.platform_fault_attempts)
    yield from _departures(report.per_trial)
    yield ""
    ran = f"queued {report.created_at}, started {report.started_at}, ended {report.ended_at}"
    yield ran
    yield ", ".join(f"{name} {version}" for name, version in sorted(report.versions.items()))


def _means(report: Report) -> str:
    parts = []
    if report.mean_success_fraction is not None:
        parts.append(f"mean fraction of time {report.mean_success_fraction:.3f}")
    if report.mean_return is not None:
        parts.append(f"mean return {report.mean_return:.1f}")
    return "".join(f"   {part}" for part in parts)


def _timing(timing: TimingRow | None) -> Iterator[str]:
    if timing is None:
        return
    verdict = "keeps its rate" if timing.keeps_rate else "would NOT keep its rate on hardware"
    yield (
        f"policy timing  {verdict}: {timing.missed} of {timing.actions} actions over {timing.allowed_ms:g} ms "
        f"(p99 {timing.p99_ms:.2f}, max {timing.max_ms:.2f})"
    )


def _trial(row: TrialRow) -> str:
    outcome, measures = row.outcome, row.outcome.measures
    error = "-" if measures is None else f"{measures.final_position_error_m * 1e3:.1f}"
    angle = "-"
    if measures is not None and measures.final_angle_error_rad is not None:
        angle = f"{measures.final_angle_error_rad * 57.29577951308232:.1f}"
    reason = "" if outcome.kind == OutcomeKind.SUCCEEDED else _cut(_one_line(outcome.reason), REASON_WIDTH - 12)
    kind = f"{outcome.kind}" if outcome.fault == Fault.NONE else f"{outcome.kind} !"
    return f"{row.trial:>5} {_cut(row.robot, 16):<16} {_cut(kind, 20):<20} {error:>8} {angle:>6} {row.attempts:>5}  {reason}"


def _faults(rows: tuple[FaultRow, ...]) -> Iterator[str]:
    if not rows:
        return
    yield ""
    yield "attempts that failed by the platform's fault (tried again, not counted):"
    for row in rows:
        yield f"  trial {row.trial}, attempt {row.attempt} on {row.robot}: {_cut(_one_line(row.reason), REASON_WIDTH)}"


def _departures(rows: tuple[TrialRow, ...]) -> Iterator[str]:
    departed = [row for row in rows if row.departure is not None]
    if not departed:
        return
    yield ""
    yield "trials that did not go to their first drawn robot:"
    for row in departed:
        yield f"  trial {row.trial} on {row.robot}: {_cut(_one_line(row.departure or ''), WIDTH - 40)}"


def _interval(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.3f}–{interval[1]:.3f}"


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"
