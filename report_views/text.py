"""A report as plain text for people, at most 100 columns wide."""

import textwrap
from collections.abc import Iterator

from api_schemas.physics import ObjectName
from api_schemas.report import BetweenRobots, ExcitationRow, FaultRow, IdentificationReport, Report, TimingRow, TrialRow
from api_schemas.scene_form import told_forms
from api_schemas.success_rate import SHOWN, SHOWN_LEVEL, wilson
from api_schemas.tracker import told_trackers
from api_schemas.trial import Fault, Outcome, OutcomeKind
from api_schemas.visible import visible

WIDTH = 100
REASON_WIDTH = 44


def render(report: Report | IdentificationReport) -> str:
    """The whole report: rate and intervals first, then robots, trials, and apart from them the platform's faults."""
    lines = _lines(report) if isinstance(report, Report) else _identification(report)
    return "\n".join(visible(line)[:WIDTH].rstrip() for line in lines) + "\n"


def _lines(report: Report) -> Iterator[str]:
    yield f"Report of job {report.job_id}: {report.trials} x {report.task} with policy {_cut(report.policy_name, 40)}"
    yield f"policy {report.policy}   seed {report.seed}"
    yield from _object(report)
    yield ""
    yield f"success rate   {report.successes} of {report.trials} = {report.success_rate:.3f}"
    kind = "Wilson" if report.intervals == "wilson" else "confidence sequence, holds at every look"
    yield f"  {SHOWN} {_interval(report.interval_95)}   ({kind})"
    yield from _question(report)
    yield f"  reached at any time {report.success_ever} of {report.trials}{_means(report)}"
    policy_faults = f"policy {report.policy_faults} (counted as failures)"
    yield f"errors         {policy_faults}, platform {report.platform_faults} (retried, not counted)"
    yield f"attempts       {report.attempts} for {report.trials} trials"
    yield from _timing(report.timing)
    if report.jail is not None:
        yield f"jail           {report.jail.level} ({len(report.jail.layers)} layers)"
    yield ""
    yield f"{'robot':<20} {'trials':>6} {'successes':>9} {'rate':>6}  {SHOWN:<13}  {'platform faults':>15}"
    for row in report.per_robot:
        rate = f"{row.robot:<20} {row.trials:>6} {row.successes:>9} {row.success_rate:>6.3f}"
        yield f"{rate}  {_interval(wilson(row.successes, row.trials, SHOWN_LEVEL)):<13}  {row.platform_faults:>15}"
    yield from _between(report)
    yield ""
    yield f"{'trial':>5} {'robot':<16} {'outcome':<20} {'error mm':>8} {'deg':>6} {'tries':>5}  reason"
    for row in report.per_trial:
        yield _trial(row)
    if len(report.per_trial) < report.trials:
        yield f"the first {len(report.per_trial)} of {report.trials}; 'trifarm fetch {report.job_id} --table FILE' has all"
    yield from _failures(report)
    yield from _faults(report.platform_fault_attempts)
    yield from _departures(report.per_trial)
    yield from _made(report)


def _question(report: Report) -> Iterator[str]:
    if report.own_goals:
        yield "goals          brought by the user; leaderboards do not take them"
    if (asked := report.question) is None:
        return
    for number, part in enumerate(textwrap.wrap(asked.sentence, WIDTH - 15)):
        yield f"{'' if number else 'question':<15}{part}"
    if report.uncounted:
        yield f"               {report.uncounted} more trials had ended by then and do not count"


def _identification(report: IdentificationReport) -> Iterator[str]:
    recorded = "1 excitation" if report.trials == 1 else f"{report.trials} excitations"
    yield f"Report of job {report.job_id}: {recorded} recorded on {report.robot}"
    yield f"seed {report.seed}"
    yield from _object(report)
    yield f"attempts       {report.attempts} for {report.trials} recordings, platform faults {report.platform_faults}"
    yield ""
    yield f"{'trial':>5} {'excitation':<16} {'robot':<20} {'tries':>5}  log"
    for row in report.per_trial:
        yield _excitation(row)
    yield from _faults(report.platform_fault_attempts)
    yield from _made(report)


def _excitation(row: ExcitationRow) -> str:
    log = "-" if row.log_sha256 is None else row.log_sha256[:16] + "…"
    return f"{row.trial:>5} {row.excitation:<16} {_cut(row.robot, 20):<20} {row.attempts:>5}  {log}"


def _object(report: Report | IdentificationReport) -> Iterator[str]:
    if (report.object, report.object_scale) != (ObjectName.CUBE, 1.0):
        yield f"object {report.object}, {report.object_scale:g} x its usual size"


def _between(report: Report) -> Iterator[str]:
    if report.between_robots is not None:
        yield _share(report.between_robots)
    elif len(report.per_robot) > 1:
        yield "between robots: no share of the variance can be told from these outcomes"


def _share(between: BetweenRobots) -> str:
    low, high = (100 * bound for bound in between.interval_80)
    told = f"between robots: {100 * between.variance_share:.1f} % of the variance of success"
    return f"{told} (80 % interval {low:.1f}–{high:.1f} %, {between.robots} robots)"


def _made(report: Report | IdentificationReport) -> Iterator[str]:
    yield ""
    yield f"queued {report.created_at}, started {report.started_at}, ended {report.ended_at}"
    yield ", ".join(f"{name} {version}" for name, version in sorted(report.versions.items()))
    yield f"form of the scene: {told_forms(report.forms)}"
    if isinstance(report, Report) and report.trackers:
        yield f"tracker: {told_trackers(report.trackers)}"


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
    reason = "" if outcome.kind == OutcomeKind.SUCCEEDED else _cut(_one_line(_why(outcome)), REASON_WIDTH - 12)
    kind = f"{outcome.kind}" if outcome.fault == Fault.NONE else f"{outcome.kind} !"
    return f"{row.trial:>5} {_cut(row.robot, 16):<16} {_cut(kind, 20):<20} {error:>8} {angle:>6} {row.attempts:>5}  {reason}"


def _why(outcome: Outcome) -> str:
    return outcome.reason if outcome.failure is None else outcome.failure.sentence


def _failures(report: Report) -> Iterator[str]:
    if not report.failures:
        return
    yield ""
    yield "why trials failed, as measured:"
    for row in report.failures:
        yield f"  {len(row.trials):>4} x {row.kind:<22} trials {_cut(', '.join(map(str, row.trials)), WIDTH - 40)}"
    yield ""
    for trial in report.per_trial:
        if trial.outcome.failure is not None:
            yield from textwrap.wrap(f"  {trial.trial:>5}  {trial.outcome.failure.sentence}", WIDTH, subsequent_indent=" " * 9)


def _faults(rows: tuple[FaultRow, ...]) -> Iterator[str]:
    if not rows:
        return
    yield ""
    yield "platform errors (retried, not counted):"
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
