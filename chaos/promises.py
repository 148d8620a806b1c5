"""The checker: from histories, the rows of the database and the files to the promises that were broken; it opens nothing.

It believes nobody alone. What a client was told is compared with what the database holds, what the database holds with what
robots were told, and what robots did with the leases that they had. Each promise is one function that gives a sentence for
every case in which it was broken:

====================  =================================================================================================
``lost``              a submission that was acknowledged is there, with all its trials, and is found under its key; an
                      outcome that a robot was told to count does, and its log is there with the content that its name says
``duplicated``        one submission under one key is one job; a trial has one accepted attempt, its newest; no robot was
                      told that its outcome counts when another's does; a job counts each trial once
``stuck``             a job that is not over has a robot whose lease lives, or says what it waits for
``acted_too_long``    after its lease has ended a robot acts once more at most: it looks at the lease in every control period
``changed_reports``   a report is what it was when somebody first read it
``changed_rates``     the successes of a job are those that its trials' seeds give, whatever happened to the platform
``untyped_errors``    every refusal names its problem, and none is an error that nobody foresaw
====================  =================================================================================================
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from chaos.history import Line

FINAL = frozenset({"succeeded", "failed", "cancelled"})
ACTIVE = frozenset({"leased", "running"})


@dataclass(frozen=True)
class Job:
    """A job as the database has it; ``because`` is what the API says that it waits for, ``key`` what it was sent under."""

    job_id: str
    owner: str
    key: str | None
    state: str
    trials: int
    trials_done: int
    successes: int
    because: str | None


@dataclass(frozen=True)
class Trial:
    """A trial as the database has it."""

    trial_id: str
    job_id: str
    state: str
    fence: int
    seed: int
    lease_until_s: float | None
    outcome: str | None
    log_sha256: str | None


@dataclass(frozen=True)
class Attempt:
    """An attempt as the database has it."""

    trial_id: str
    fence: int
    robot: str
    state: str


@dataclass(frozen=True)
class Report:
    """A stored report: the SHA-256 that was written beside it, that of its content, and what it counts."""

    job_id: str
    named_sha256: str
    sha256: str
    trials: int
    successes: int


@dataclass(frozen=True)
class Evidence:
    """All that is known when a run is over.

    Args:
        lines: all histories, in the order of time.
        jobs: by id.
        trials: all.
        attempts: all.
        reports: by job.
        files: for every stored file whether its content has the SHA-256 that is its name.
        now_s: the farm's clock when the database was read.
        grace_s: how long after a lease's end the farm may take to see that it ended.
    """

    lines: tuple[Line, ...]
    jobs: Mapping[str, Job]
    trials: tuple[Trial, ...]
    attempts: tuple[Attempt, ...]
    reports: Mapping[str, Report]
    files: Mapping[str, bool]
    now_s: float
    grace_s: float


@dataclass(frozen=True)
class Verdict:
    """A sentence for every case in which a promise was broken, and what the promises were kept over."""

    broken: Mapping[str, tuple[str, ...]]
    acknowledged: int
    trials_done: int
    failed_jobs: int
    stale_refused: int
    stale_accepted: int

    @property
    def held(self) -> bool:
        """Whether all promises were kept."""
        return not any(self.broken.values())


def check(evidence: Evidence, expected_success: Callable[[int], bool]) -> Verdict:
    """Judges a run.

    Args:
        evidence: what is known of it.
        expected_success: whether a trial with this seed reaches its goal when nothing disturbs it.
    """
    promises: dict[str, Iterator[str]] = {
        "lost": _lost(evidence),
        "duplicated": _duplicated(evidence),
        "stuck": _stuck(evidence),
        "acted_too_long": _acted_too_long(evidence.lines),
        "changed_reports": _changed_reports(evidence),
        "changed_rates": _changed_rates(evidence, expected_success),
        "untyped_errors": _untyped_errors(evidence.lines),
    }
    newest = {trial.trial_id: trial.fence for trial in evidence.trials}
    acknowledged = {line.more["job"]: line.more["trials"] for line in evidence.lines if line.did == "acknowledged"}
    return Verdict(
        broken={name: tuple(found) for name, found in promises.items()},
        acknowledged=sum(acknowledged.values()),
        trials_done=sum(trial.state == "done" for trial in evidence.trials),
        failed_jobs=sum(job.state == "failed" for job in evidence.jobs.values()),
        stale_refused=sum(line.did == "refused" and line.more["problem"] == "stale-fence" for line in evidence.lines),
        stale_accepted=sum(line.more["fence"] != newest.get(line.more["trial"]) for line in _told_to_count(evidence.lines)),
    )


def _lost(evidence: Evidence) -> Iterator[str]:
    trials: dict[str, int] = defaultdict(int)
    for trial in evidence.trials:
        trials[trial.job_id] += 1
    keys = {(job.owner, job.key) for job in evidence.jobs.values()}
    for line in evidence.lines:
        if line.did != "acknowledged":
            continue
        job_id, wanted = line.more["job"], line.more["trials"]
        if job_id not in evidence.jobs:
            yield f"job {job_id} was acknowledged to {line.who} and is not there"
        elif trials[job_id] != wanted:
            yield f"job {job_id} was acknowledged with {wanted} trials and has {trials[job_id]}"
        elif line.more["key"] is not None and (line.more["owner"], line.more["key"]) not in keys:
            yield f"job {job_id} was acknowledged under key {line.more['key']}, and nothing is found under this key"
    accepted = {(attempt.trial_id, attempt.fence) for attempt in evidence.attempts if attempt.state == "accepted"}
    for line in _told_to_count(evidence.lines):
        if (line.more["trial"], line.more["fence"]) not in accepted:
            yield f"{line.who} was told that attempt {line.more['fence']} of trial {line.more['trial']} counts, and it does not"
    for trial in evidence.trials:
        if trial.log_sha256 is not None and not evidence.files.get(trial.log_sha256, False):
            there = "is not there" if trial.log_sha256 not in evidence.files else "has another content"
            yield f"the log {trial.log_sha256} of trial {trial.trial_id} {there}"


def _told_to_count(lines: tuple[Line, ...]) -> Iterator[Line]:
    """What robots were told of outcomes that end a trial for good."""
    return (line for line in lines if line.did == "answered" and line.more["status"] == 200 and line.more["counts"])


def _duplicated(evidence: Evidence) -> Iterator[str]:
    yield from _keys_with_more_jobs(evidence.lines)
    yield from _trials_with_more_outcomes(evidence)
    done: dict[str, int] = defaultdict(int)
    for trial in evidence.trials:
        done[trial.job_id] += trial.state == "done"
    for job in evidence.jobs.values():
        if job.trials_done != done[job.job_id]:
            yield f"job {job.job_id} counts {job.trials_done} trials done, and {done[job.job_id]} are"


def _keys_with_more_jobs(lines: tuple[Line, ...]) -> Iterator[str]:
    of_key: dict[tuple[str, str], set[str]] = defaultdict(set)
    for line in lines:
        if line.did == "acknowledged" and line.more["key"] is not None:
            of_key[line.more["owner"], line.more["key"]].add(line.more["job"])
    for (_, key), job_ids in of_key.items():
        if len(job_ids) > 1:
            yield f"key {key} made the jobs {', '.join(sorted(job_ids))}"


def _trials_with_more_outcomes(evidence: Evidence) -> Iterator[str]:
    counted: dict[str, set[tuple[int, str]]] = defaultdict(set)
    fences = {trial.trial_id: trial.fence for trial in evidence.trials}
    for line in _told_to_count(evidence.lines):
        counted[line.more["trial"]].add((line.more["fence"], line.who))
    for attempt in evidence.attempts:
        if attempt.state == "accepted":
            counted[attempt.trial_id].add((attempt.fence, attempt.robot))
            if attempt.fence != fences[attempt.trial_id]:
                newest = fences[attempt.trial_id]
                yield f"attempt {attempt.fence} of trial {attempt.trial_id} was accepted, and the newest is {newest}"
    for trial_id, attempts in counted.items():
        if len(attempts) > 1:
            said = ", ".join(f"attempt {fence} of {robot}" for fence, robot in sorted(attempts))
            yield f"trial {trial_id} has more than one outcome that counts: {said}"


def _stuck(evidence: Evidence) -> Iterator[str]:
    trials: dict[str, list[Trial]] = defaultdict(list)
    for trial in evidence.trials:
        trials[trial.job_id].append(trial)
    for job in evidence.jobs.values():
        if job.state in FINAL:
            continue
        active = [trial for trial in trials[job.job_id] if trial.state in ACTIVE]
        for trial in active:
            late_s = evidence.now_s - (trial.lease_until_s or 0.0)
            if late_s > evidence.grace_s:
                yield f"trial {trial.trial_id} is {trial.state}, and its lease ended {late_s:.1f} s ago"
        if not active and not job.because:
            yield f"job {job.job_id} is {job.state}, no robot has a trial of it, and it does not say why"


def _acted_too_long(lines: tuple[Line, ...]) -> Iterator[str]:
    """A lease ends ``lease_s`` after it was taken or after the last renewal that was granted was asked for."""
    ends_s: dict[tuple[str, str, int], float] = {}
    lasts_s: dict[tuple[str, str, int], float] = {}
    after: dict[tuple[str, str, int], int] = defaultdict(int)
    for line in lines:
        if "fence" not in line.more:
            continue
        held = (line.who, line.more["trial"], line.more["fence"])
        if line.did == "accepted":
            lasts_s[held] = line.more["lease_s"]
            ends_s[held] = line.at_s + line.more["lease_s"]
        elif line.did == "renewed":
            ends_s[held] = max(ends_s[held], line.more["asked_s"] + lasts_s[held])
        elif line.did == "acted" and line.at_s > ends_s[held]:
            after[held] += 1
    for (robot, trial_id, fence), times in after.items():
        if times > 1:
            yield f"{robot} acted {times} times in attempt {fence} of trial {trial_id} after its lease had ended"


def _changed_reports(evidence: Evidence) -> Iterator[str]:
    for report in evidence.reports.values():
        if report.named_sha256 != report.sha256:
            yield f"the report of job {report.job_id} is not what it was when it was written"
    for line in evidence.lines:
        if line.did == "read-report":
            report = evidence.reports.get(line.more["job"])
            if report is None:
                yield f"{line.who} read a report of job {line.more['job']}, and it is not there"
            elif report.sha256 != line.more["sha256"]:
                yield f"{line.who} read another report of job {line.more['job']} than is there"
    for job in evidence.jobs.values():
        if job.state == "succeeded" and job.job_id not in evidence.reports:
            yield f"job {job.job_id} succeeded and has no report"


def _changed_rates(evidence: Evidence, expected_success: Callable[[int], bool]) -> Iterator[str]:
    expected: dict[str, int] = defaultdict(int)
    for trial in evidence.trials:
        if trial.state == "done":
            expected[trial.job_id] += expected_success(trial.seed)
    for job in evidence.jobs.values():
        if job.successes != expected[job.job_id]:
            yield f"job {job.job_id} counts {job.successes} successes, and its seeds give {expected[job.job_id]}"
        report = evidence.reports.get(job.job_id)
        if report is not None and (report.trials, report.successes) != (job.trials, expected[job.job_id]):
            yield f"the report of job {job.job_id} says {report.successes} of {report.trials}, not {expected[job.job_id]}"


def _untyped_errors(lines: tuple[Line, ...]) -> Iterator[str]:
    for line in lines:
        if line.did == "refused":
            problem = line.more["problem"]
            if problem is None or line.more["status"] == 500:
                status, asked = line.more["status"], line.more["asked"]
                yield f"{line.who} was answered {status} ({problem or 'no problem document'}) when it {asked}"
