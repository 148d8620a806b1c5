"""Trials as a table: flat, complete, and no formula to a spreadsheet."""

import csv
import io

from api_schemas.trial import FailureCause, Fault, Measures, Outcome, OutcomeKind, Trial, TrialState
from report_views.trial_table import COLUMNS, as_csv, row

MEASURES = Measures(
    success_at_end=False, success_ever=True, success_fraction=0.25, final_position_error_m=0.031, final_angle_error_rad=None,
    episode_return=-1.5, control_steps=750, simulated_s=15.0,
)  # fmt: skip


def trial(**more):
    asked = {
        "trial_id": "jx-003", "job_id": "jx", "ordinal": 3, "state": TrialState.DONE, "waiting_because": None, "task": "push",
        "seed": 2**62, "robot": "robot-1", "robot_order": (), "outcome": None, "log_sha256": None, "log_bytes": None,
        "attempts": (),
    }  # fmt: skip
    return Trial.model_validate(asked | more)


def failed(sentence):
    cause = FailureCause(kind="left", sentence=sentence, at_s=3.5)
    return Outcome(kind=OutcomeKind.FAILED, fault=Fault.NONE, reason="goal missed", measures=MEASURES, failure=cause)


def test_a_row_has_every_column_and_what_was_measured():
    known = row(trial(outcome=failed("it slid away")))
    assert tuple(known) == COLUMNS
    assert (known["outcome"], known["failure"], known["failure_at_s"], known["seed"]) == ("failed", "left", 3.5, 2**62)
    assert (known["final_position_error_m"], known["episode_return"]) == (0.031, -1.5)
    assert set(row(trial()).values()) >= {None, "jx-003", "done"}


def test_csv_reads_back_and_no_text_of_others_is_a_formula():
    text = as_csv([trial(outcome=failed('=HYPERLINK("http://x")')), trial(robot='a,b\n"c')])
    first, second = csv.DictReader(io.StringIO(text))
    assert first["failure_sentence"] == '\'=HYPERLINK("http://x")'
    assert first["episode_return"] == "-1.5", "numbers stay numbers"
    assert (second["robot"], second["outcome"]) == ('a,b\n"c', "")
