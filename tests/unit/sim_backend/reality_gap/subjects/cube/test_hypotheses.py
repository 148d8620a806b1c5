"""Hypotheses about cube and tracker, on vectors that are made up from the package's own scatter."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.cube import TRIALS, Kind
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES, ContactSummary
from sim_backend.reality_gap.subjects.cube.counts import count_gain
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.hypotheses import farthest, judge, response_table, whitened, without_worst
from sim_backend.reality_gap.subjects.cube.replay import Replayed
from sim_backend.reality_gap.subjects.cube.summary import NAMES, TRACKER_NAMES, CubeEvidence, CubeSummary
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics

NULL = load_calibration().null


def _tracker(gaps=0, jumps=0) -> TrackerStatistics:
    return TrackerStatistics(500, 0.1, 0.09, 0.003, gaps, gaps, jumps, 450, 0.0325, 0.001, 0.012, 0.92)


def _contact() -> ContactSummary:
    """Every trial moves the score in a direction of its own."""
    rng, response = np.random.default_rng(5), {}
    for effect in dict.fromkeys(trial.effect for trial in TRIALS[1:]):
        values = np.array([trial.value for trial in TRIALS if trial.effect == effect])
        nominal = 0.0 if effect.startswith("tracking") else 1.0
        response[effect] = (values, np.outer((values - nominal) / np.abs(values - nominal).max(), 40 * rng.normal(size=16)))
    return ContactSummary(5, np.zeros(len(CONTACT_NAMES)), response)


def _summary(moved: dict[str, float], contact=None, **counts) -> CubeSummary:
    vector = NULL.mean.copy()
    for name, change in moved.items():
        vector[NAMES.index(name)] += change
    if contact is None:
        vector[len(TRACKER_NAMES) :] = np.nan
    return CubeSummary(vector, contact, _tracker(**counts))


def test_a_healthy_vector_gains_nothing():
    summary = _summary({}, _contact())
    assert judge(summary, NULL)[0].gain < 1.0
    assert np.allclose(whitened(summary, NULL).vector, 0.0)


def test_a_late_tracker_is_named_with_its_delay():
    best = judge(_summary({"delay_s": 0.02}), NULL)[0]
    assert best.effect == "tracking_latency"
    assert best.estimates[0].value == pytest.approx(0.02)
    assert 0.0 < best.estimates[0].std < 0.005


def test_the_number_that_is_farthest_off_is_told_by_kind_and_gone_where_its_cause_is_fitted():
    delay = NAMES.index("delay_s")
    summary = _summary({"delay_s": 4.0 * float(np.sqrt(NULL.covariance[delay, delay]))}, _contact())
    seen = whitened(summary, NULL)
    assert farthest(seen, seen.vector) == {Kind.TRACKER: pytest.approx(4.0), Kind.PUSHES: pytest.approx(0.0, abs=1e-9)}
    best = judge(summary, NULL)[0]
    assert farthest(seen, best.left)[Kind.TRACKER] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("effect", ["cube_mass", "tracking_offset", "cube_size"])
def test_what_a_hypothesis_leaves_has_the_squares_that_it_does_not_gain(effect):
    contact = _contact()
    values, moves = response_table(_summary({}, contact), "cube_mass")
    vector = NULL.mean + np.array([np.interp(1.2, values, column) for column in moves.T])
    summary = CubeSummary(vector, contact, _tracker())
    seen = whitened(summary, NULL)
    (found,) = [row for row in judge(summary, NULL) if row.effect == effect]
    further = len(found.estimates) - 1
    assert found.left @ found.left == pytest.approx(seen.vector @ seen.vector - 2.0 * (found.gain + further), rel=1e-9)


@pytest.mark.parametrize(("number", "effect"), [("log_noise_m", "tracking_noise"), ("log_delay_std", "tracking_jitter")])
def test_more_noise_than_usual_is_a_cause_and_less_is_none(number, effect):
    more, less = (judge(_summary({number: change}), NULL) for change in (1.5, -1.5))
    assert more[0].effect == effect and more[0].gain > 5.0
    assert all(row.gain < 0.5 for row in less if row.effect == effect)


def test_another_rate_is_named_in_hertz():
    best = judge(_summary({"log_interval": float(np.log(2.0))}), NULL)[0]
    assert best.effect == "tracking_rate"
    assert best.estimates[0].value == pytest.approx(5.0, rel=0.01)


@pytest.mark.parametrize(("counts", "effect"), [({"gaps": 25}, "tracking_dropout"), ({"jumps": 20}, "orientation_jumps")])
def test_many_losses_and_jumps_are_named(counts, effect):
    best = judge(_summary({}, **counts), NULL)[0]
    assert best.effect == effect
    assert best.gain > 20.0


def test_one_lost_frame_is_nothing():
    assert count_gain(1, 500, NULL.gap_mean, NULL.gap_variance) < 1.0


@pytest.mark.parametrize(("effect", "value"), [("cube_mass", 1.2), ("table_friction", 0.8), ("fingertip_friction", 0.65)])
def test_a_cube_is_found_at_a_value_between_those_that_were_replayed(effect, value):
    contact = _contact()
    values, moves = response_table(_summary({}, contact), effect)
    vector = NULL.mean + np.array([np.interp(value, values, column) for column in moves.T])
    best = judge(CubeSummary(vector, contact, _tracker()), NULL)[0]
    assert best.effect == effect
    assert best.estimates[0].value == pytest.approx(value, abs=0.02)


def test_an_offset_beyond_those_that_were_replayed_is_found():
    contact, true_m = _contact(), (-0.010, 0.006)
    vector = NULL.mean.copy()
    for trial, value in zip(("tracking_offset_x", "tracking_offset_y"), true_m, strict=True):
        values, moves = response_table(_summary({}, contact), trial, 0.0)
        vector += np.array([np.interp(value, values, column) for column in moves.T])
    best = judge(CubeSummary(vector, contact, _tracker()), NULL)[0]
    assert best.effect == "tracking_offset"
    assert [estimate.value for estimate in best.estimates] == pytest.approx([*true_m, 0.0], abs=3e-4)


def test_a_hypothesis_that_is_left_out_is_not_judged():
    moved = _summary({"delay_s": 0.02})
    assert judge(moved, NULL)[0].effect == "tracking_latency"
    assert "tracking_latency" not in {row.effect for row in judge(moved, NULL, without=("tracking_latency",))}


def _push(rng, wrong: float) -> Replayed:
    """A push that fits but for noise, and for errors of its own."""
    way = rng.normal(0.0, 0.3, (len(TRIALS), 120))
    way[0] = 0.0
    residual = rng.normal(0.0, 0.02, 120) + wrong * rng.normal(size=120) - way
    return Replayed(residual, np.arange(120) % 6, np.linspace(0.0, 0.6, 120))


def test_the_push_that_went_wrong_is_left_out():
    rng = np.random.default_rng(4)
    pushes = tuple(_push(rng, 6.0 if i == 2 else 0.0) for i in range(5))
    null = replace(NULL, mean=np.zeros(len(NAMES)), covariance=np.eye(len(NAMES)))
    kept = without_worst(CubeEvidence(_tracker(), pushes), null).replayed
    assert len(kept) == 4
    assert not any(push is pushes[2] for push in kept)
    assert without_worst(CubeEvidence(_tracker(), pushes[:3]), null).replayed == pushes[:3]


def test_without_pushes_nothing_is_said_about_mass_and_friction():
    effects = {row.effect for row in judge(_summary({}), NULL)}
    assert "tracking_latency" in effects
    assert not effects & {"cube_mass", "table_friction", "fingertip_friction"}
