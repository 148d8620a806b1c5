"""The checker finds every promise that is broken, and nothing where all were kept."""

from dataclasses import replace

import pytest

from chaos.history import Line
from chaos.promises import Attempt, Evidence, Job, Report, Trial, check

LOG = "a" * 64
ABOUT = {"trial": "j1-000", "fence": 2}


def line(did, who="robot-0", at_s=1.0, **more):
    return Line(at_s, who, did, more)


def acknowledged(job="j1", key="k1", trials=1):
    return line("acknowledged", "client-0", job=job, owner="user-0", key=key, trials=trials, status=201)


JOB = Job("j1", "user-0", "k1", "succeeded", 1, 1, 1, None)
TRIAL = Trial("j1-000", "j1", "done", 2, 5, None, "succeeded", LOG)
REPORT = Report("j1", "r1", "r1", 1, 1)
KEPT = Evidence(
    lines=(
        acknowledged(),
        line("accepted", at_s=10.0, lease_s=3.0, **ABOUT),
        line("renewed", at_s=11.1, asked_s=11.0, **ABOUT),
        line("acted", at_s=13.9, **ABOUT),
        line("acted", at_s=14.1, **ABOUT),  # stopped in between, it finds out in the same control period
        line("answered", status=200, counts=True, asked="brought an outcome", **ABOUT),
        line("read-report", "client-0", job="j1", sha256="r1"),
        line("refused", "client-0", status=503, problem="database-unavailable", asked="submitted a job"),
    ),
    jobs={"j1": JOB},
    trials=(TRIAL,),
    attempts=(Attempt("j1-000", 1, "robot-1", "platform_fault"), Attempt("j1-000", 2, "robot-0", "accepted")),
    reports={"j1": REPORT},
    files={LOG: True, "b" * 64: True},
    now_s=100.0,
    grace_s=2.0,
)
UNENDED = replace(JOB, state="running", trials_done=0, successes=0)
HELD = replace(TRIAL, state="running", lease_until_s=99.0, outcome=None, log_sha256=None)


def with_lines(*more):
    return replace(KEPT, lines=KEPT.lines + more)


def unended(job=UNENDED, trial=HELD):
    return replace(
        KEPT, lines=(acknowledged(),), jobs={"j1": job}, trials=(trial,), attempts=KEPT.attempts[:1], reports={}, files={}
    )


BROKEN = {
    "a job that is not there": ("lost", with_lines(acknowledged(job="j2", key="k2"))),
    "a trial that is not there": ("lost", with_lines(acknowledged(trials=2))),
    "a key under which nothing is found": ("lost", replace(KEPT, jobs={"j1": replace(JOB, key=None)})),
    "an outcome that was taken and does not count": (
        "lost",
        replace(
            KEPT,
            attempts=KEPT.attempts[:1],
            trials=(replace(HELD, state="cancelled"),),
            jobs={"j1": replace(UNENDED, state="cancelled")},
            reports={},
            lines=KEPT.lines[:6],
        ),
    ),
    "a log that is not there": ("lost", replace(KEPT, files={})),
    "a log with another content": ("lost", replace(KEPT, files={LOG: False})),
    "a key with two jobs": (
        "duplicated",
        replace(
            with_lines(acknowledged(job="j2")),
            jobs={"j1": JOB, "j2": replace(JOB, job_id="j2", trials_done=0, successes=0, state="cancelled")},
            trials=(TRIAL, replace(HELD, trial_id="j2-000", job_id="j2", state="cancelled")),
        ),
    ),
    "two accepted attempts": (
        "duplicated",
        replace(KEPT, attempts=(Attempt("j1-000", 1, "robot-1", "accepted"), *KEPT.attempts[1:])),
    ),
    "an accepted attempt that is not the newest": ("duplicated", replace(KEPT, trials=(replace(TRIAL, fence=3),))),
    "two robots that were told that they count": (
        "duplicated lost",
        with_lines(line("answered", "robot-1", status=200, counts=True, asked="", trial="j1-000", fence=1)),
    ),
    "a trial that was counted twice": ("duplicated", replace(KEPT, jobs={"j1": replace(JOB, trials_done=2)})),
    "a lease that ended long ago": ("stuck", unended(trial=replace(HELD, lease_until_s=90.0))),
    "a queued job that does not say why": (
        "stuck",
        unended(job=replace(UNENDED, state="queued"), trial=replace(HELD, state="queued", lease_until_s=None)),
    ),
    "a robot that went on": ("acted_too_long", with_lines(line("acted", at_s=14.2, **ABOUT))),
    "a report that changed": ("changed_reports", replace(KEPT, reports={"j1": replace(REPORT, sha256="r2", named_sha256="r2")})),
    "a report that is not what was written": (
        "changed_reports",
        replace(KEPT, reports={"j1": replace(REPORT, named_sha256="r2")}),
    ),
    "a report that is not there": ("changed_reports", replace(KEPT, reports={})),
    "another success rate": ("changed_rates", replace(KEPT, jobs={"j1": replace(JOB, successes=0)})),
    "another rate in the report": ("changed_rates", replace(KEPT, reports={"j1": replace(REPORT, successes=0)})),
    "an error that nobody foresaw": ("untyped_errors", with_lines(line("refused", status=500, problem="internal", asked=""))),
    "an error without a problem": ("untyped_errors", with_lines(line("refused", status=503, problem=None, asked=""))),
}


def judged(evidence):
    return check(evidence, expected_success=lambda seed: seed == 5)


def test_nothing_is_found_where_all_was_kept():
    verdict = judged(KEPT)
    assert verdict.broken == dict.fromkeys(verdict.broken, ())
    assert verdict.held
    assert (verdict.acknowledged, verdict.trials_done, verdict.failed_jobs) == (1, 1, 0)


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_promise_is_found_and_no_other(case):
    promise, evidence = BROKEN[case]
    broken = {name for name, found in judged(evidence).broken.items() if found}
    assert broken == set(promise.split())


@pytest.mark.parametrize(
    "evidence",
    [
        unended(),
        unended(job=replace(UNENDED, state="queued", because="no robot is in service"), trial=replace(HELD, state="queued")),
    ],
    ids=["a living lease", "a printed reason"],
)
def test_a_job_with_an_owner_or_a_reason_is_not_stuck(evidence):
    assert judged(evidence).held


def test_a_submission_that_was_never_answered_may_be_there_or_not():
    sent = line("submits", "client-0", owner="user-0", key="k9", trials=1)
    assert judged(with_lines(sent)).held
    there = replace(JOB, job_id="j9", key="k9", trials_done=0, successes=0, state="cancelled")
    assert judged(replace(with_lines(sent), jobs=dict(KEPT.jobs) | {"j9": there})).held
