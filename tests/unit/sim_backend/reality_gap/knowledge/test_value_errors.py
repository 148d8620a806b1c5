"""What is added to intervals where a robot differs everywhere."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.joint_effects import SCALES
from sim_backend.reality_gap.knowledge.value_errors import (
    COVERED,
    STANDSTILL_SPEED,
    UsualErrors,
    circumstance,
    deviation,
    document,
    is_telling,
    likeliest,
    measured_errors,
    place_in_finger,
    usual_errors,
)

KEY, TRADED = "viscous_friction.damping_nm_s_rad", "coulomb_friction.torque_nm"
UPPERMOST, LOWEST = "base_to_upper", "middle_to_lower"


def measured(rows) -> dict[str, dict[str, UsualErrors]]:
    return measured_errors([[row] for row in rows])


def rows_of(errors, own=0.0, key=KEY, where="finger0_base_to_upper"):
    return [{"key": key, "where": where, "value": 0.04 + error, "truth": 0.04, "own": own} for error in errors]


def test_so_many_values_to_come_are_held_as_wanted():
    rng = np.random.default_rng(5)
    held = []
    for _ in range(300):
        usual = measured(rows_of(rng.normal(0.0, 0.003, 60)))[KEY][UPPERMOST]
        off = rng.normal(0.0, 0.003, 1000)
        held.append(np.mean((off <= usual.below) & (-off <= usual.above)))
    assert np.mean(held) == pytest.approx(COVERED, abs=0.02)


def test_what_the_own_noise_explains_is_not_added_again():
    assert measured(rows_of([0.003, -0.003] * 20, own=0.003))[KEY][UPPERMOST] == pytest.approx((0.0, 0.0), abs=1e-8)
    assert measured(rows_of([0.005, -0.005] * 20, own=0.003))[KEY][UPPERMOST] == pytest.approx((0.004, 0.004))


def test_of_a_few_values_the_largest_error_counts():
    assert measured(rows_of([0.001, 0.002, 0.006]))[KEY][UPPERMOST] == pytest.approx((0.006, 0.0))


def test_what_is_off_to_one_side_is_widened_to_that_side():
    usual = measured(rows_of(np.random.default_rng(6).normal(-0.04, 0.01, 200)))[KEY][UPPERMOST]
    assert usual.below == 0.0
    assert usual.above == pytest.approx(0.04 + 1.645 * 0.01, rel=0.1)


def test_a_joint_s_place_in_its_finger_decides():
    above, below = rows_of([0.001] * 20), rows_of([0.02] * 20, where="finger240_middle_to_lower")
    assert {at: usual.below for at, usual in measured(above + below)[KEY].items()} == pytest.approx(
        {UPPERMOST: 0.001, LOWEST: 0.02}
    )
    assert [place_in_finger(where) for where in ("finger120_upper_to_middle", "platform")] == ["upper_to_middle", "platform"]


@pytest.mark.parametrize(
    ("speed", "at"),
    [(0.02, f"{UPPERMOST}, its speed unseen"), (0.1, UPPERMOST), (None, f"{UPPERMOST}, no friction near standstill")],
)
@pytest.mark.parametrize("key", [KEY, TRADED, "torque_constant.error"])
def test_what_trades_with_friction_near_standstill_has_errors_by_whether_its_speed_is_seen(key, speed, at):
    row = {"key": key, "where": "finger0_base_to_upper", "value": 0.2, "truth": 0.005, "own": 0.0}
    beside = [] if speed is None else [row | {"key": STANDSTILL_SPEED, "value": speed, "truth": speed}]
    at = UPPERMOST if key == KEY else at
    assert measured_errors([[row, *beside]])[key] == {at: pytest.approx((0.195, 0.0))}
    assert circumstance(key, "finger0_base_to_upper", speed) == at


def test_turns_of_a_motor_have_no_whole_ones():
    assert deviation("cogging.phase_rad", 3.1, -3.1) == pytest.approx(6.2 - 2 * np.pi)
    assert deviation(KEY, 3.1, -3.1) == pytest.approx(6.2)


def test_the_file_says_what_it_is_made_of():
    found = document([rows_of([0.01] * 20), rows_of([0.04] * 20, key="load_friction.coefficient")], [1, 3])
    assert (found["robots"], found["seeds"]) == (2, [1, 3])
    assert found["values"] == {KEY: {UPPERMOST: 20}, "load_friction.coefficient": {UPPERMOST: 20}}
    assert found["errors"] == {
        KEY: {UPPERMOST: pytest.approx((0.01, 0.0))},
        "load_friction.coefficient": {UPPERMOST: pytest.approx((0.04, 0.0))},
    }


@pytest.mark.parametrize("key", ["controller_restart.off", "position_gain.factor", "timing_jitter.std_s"])
def test_what_takes_over_nothing_can_be_told(key):
    assert usual_errors(key, "platform", None) == (0.0, 0.0)
    assert is_telling(key, "platform", None)


def test_what_is_usually_far_off_tells_nothing_and_the_same_may_tell_where_it_is_not():
    assert not is_telling("load_friction.coefficient", "finger120_middle_to_lower", None)
    assert is_telling("load_friction.coefficient", "finger120_upper_to_middle", None)
    assert not is_telling("stribeck_friction.speed_rad_s", "finger0_base_to_upper", 0.1)


@pytest.mark.parametrize("key", SCALES)
def test_every_number_that_a_study_can_name_has_one(key):
    assert 0.0 <= usual_errors(key, "finger0_base_to_upper", 0.1).half < 10 * SCALES[key]


def test_a_value_is_drawn_towards_nominal_as_far_as_it_is_unsure_on_that_side():
    key = "load_friction.coefficient"
    assert likeliest(key, 0.6, (0.599, 5.0), 0.0) == pytest.approx(0.6, abs=0.001)
    assert likeliest(key, 0.6, (0.04, 0.61), 0.0) == pytest.approx(0.097, abs=0.002)
    assert likeliest(key, -0.2, (-5.0, -0.199), 0.0) == pytest.approx(-0.2, abs=0.001)
    assert likeliest(key, 0.1, (-1.0, 1.2), 0.1) == 0.1
    assert likeliest("joint_noise.position_rad", 2e-4, (0.0, 4e-4), 0.0) == 2e-4, "what is no part of the fit stays"
