import json

import pytest

from api_schemas.excitation import ExcitationName
from api_schemas.report import (
    BetweenRobots,
    ExcitationRow,
    FaultRow,
    IdentificationReport,
    Report,
    RobotRow,
    TimingRow,
    TrialRow,
    read_report,
)
from api_schemas.trial import FAULT_OF, Measures, Outcome, OutcomeKind
from report_views.text import WIDTH, render


def trial(number, kind=OutcomeKind.SUCCEEDED, departure=None, reason="reached", *, angle=None, name="robot-0"):
    measures = Measures(
        success_at_end=kind == OutcomeKind.SUCCEEDED,
        success_ever=True,
        success_fraction=0.25,
        final_position_error_m=0.0123,
        final_angle_error_rad=angle,
        episode_return=12.0,
        control_steps=750,
        simulated_s=15.0,
    )
    outcome = Outcome(kind=kind, fault=FAULT_OF[kind], reason=reason, measures=measures)
    return TrialRow(
        trial=number,
        trial_id=f"j-{number:03d}",
        robot=name,
        seed=2**63 - 1,
        attempts=1,
        outcome=outcome,
        departure=departure,
        log_sha256="0" * 64,
    )


def report(*trials, faults=(), timing=None, name="push"):
    """A report as it is read, with all that it was written with."""
    made = Report(
        job_id="jabcdefghijkl",
        task="push",
        policy="f" * 64,
        policy_name=name,
        seed=2**63 - 1,
        trials=len(trials),
        successes=1,
        success_rate=0.9,
        interval_80=(0.82312, 0.9461),
        interval_95=(0.7, 0.97),
        success_ever=1,
        mean_success_fraction=0.25,
        mean_return=12.0,
        policy_faults=1,
        platform_faults=len(faults),
        attempts=len(trials) + len(faults),
        timing=timing,
        per_robot=(RobotRow(robot="r" * 40, trials=2, successes=1, success_rate=0.5, interval_80=(0, 1), platform_faults=0),),
        per_trial=trials,
        platform_fault_attempts=faults,
        created_at="2026-01-01T00:00:00.000Z",
        started_at=None,
        ended_at="2026-01-01T00:00:09.000Z",
        versions={"trifarm": "0.1.0"},
    )
    return Report.model_validate_json(made.model_dump_json())


def test_a_report_says_what_matters():
    timing = TimingRow(p99_ms=1.5, max_ms=20, allowed_ms=11, missed=3, actions=30_000, keeps_rate=True)
    fault = FaultRow(trial=1, attempt=1, robot="robot-1", reason="robot-1 was lost")
    departed = trial(1, OutcomeKind.NONFINITE_ACTION, "robot-3 is draining", "action 3 was\nNaN", angle=0.5)
    text = render(report(trial(0), departed, faults=(fault,), timing=timing))
    for words in (
        "1 of 2 = 0.900",
        "95 % interval 0.700–0.970",
        "keeps its rate: 3 of 30000 actions over 11 ms",
        "nonfinite_action !",
        "action 3 was NaN",
        "12.3",
        "28.6",
        "trial 1, attempt 1 on robot-1: robot-1 was lost",
        "robot-3 is draining",
    ):
        assert words in text, words


@pytest.mark.parametrize("kind", OutcomeKind)
def test_every_line_fits_whatever_it_holds(kind):
    fault = FaultRow(trial=999, attempt=5, robot="r" * 40, reason="x" * 2000)
    timing = TimingRow(p99_ms=1e4, max_ms=1e5, allowed_ms=11, missed=10**6, actions=10**7, keeps_rate=False)
    row = trial(999, kind, "y" * 500, "z" * 2000, angle=3.1, name="r" * 40)
    text = render(report(row, faults=(fault,), timing=timing, name="n" * 100))
    assert max(len(line) for line in text.splitlines()) <= WIDTH
    assert text.endswith("\n")
    assert not text.endswith("\n\n")


def test_a_quiet_report_has_no_empty_sections():
    text = render(report(trial(0)))
    assert "did not go" not in text
    assert "tried again, not counted" not in text


def test_the_share_between_robots_is_told_or_that_it_cannot_be():
    between = BetweenRobots(variance_share=0.0834, interval_80=(0.021, 0.16049), robots=8)
    told = render(report(trial(0)).model_copy(update={"between_robots": between}))
    assert "between robots: 8.3 % of the variance of success (80 % interval 2.1–16.0 %, 8 robots)" in told
    one = report(trial(0))
    assert "between robots" not in render(one)
    assert "no share of the variance can be told" in render(one.model_copy(update={"per_robot": one.per_robot * 2}))


def identification(*rows, faults=()):
    return IdentificationReport(
        job_id="jabcdefghijkl",
        task="identify",
        object="cube",
        object_scale=1.0,
        robot="r" * 40,
        seed=2**63 - 1,
        trials=len(rows),
        platform_faults=len(faults),
        attempts=len(rows) + len(faults),
        per_trial=rows,
        platform_fault_attempts=faults,
        created_at="2026-01-01T00:00:00.000Z",
        started_at=None,
        ended_at="2026-01-01T00:00:09.000Z",
        versions={"trifarm": "0.1.0"},
    )


def test_an_identification_lists_its_recordings_and_has_no_rate():
    outcome = Outcome(kind=OutcomeKind.RECORDED, fault=FAULT_OF[OutcomeKind.RECORDED], reason="recorded")
    rows = [
        ExcitationRow(
            trial=n,
            trial_id=f"j-{n:03d}",
            excitation=name,
            robot="r" * 40,
            seed=n,
            attempts=1,
            outcome=outcome,
            log_sha256="a" * 64,
        )
        for n, name in enumerate(ExcitationName)
    ]
    fault = FaultRow(trial=999, attempt=5, robot="r" * 40, reason="x" * 2000)
    text = render(identification(*rows, faults=(fault,)))
    assert all(name in text for name in ExcitationName)
    assert "rate" not in text
    assert max(len(line) for line in text.splitlines()) <= WIDTH


def test_a_stored_report_of_either_kind_is_read_back_also_one_of_before_there_were_objects():
    kept = report(trial(0)), identification()
    assert tuple(read_report(each.model_dump_json().encode()) for each in kept) == kept
    old = report(trial(0)).model_dump(mode="json", exclude={"object", "object_scale", "between_robots"})
    assert read_report(json.dumps(old).encode()) == kept[0]
