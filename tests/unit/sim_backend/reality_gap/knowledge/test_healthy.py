"""Which healthy sessions a study is compared with."""

import numpy as np
import pytest

from sim_backend.reality_gap.bench.joint_calibration_table import (
    ALONE_RULE,
    LEAST_GATE,
    gates,
    summarise_again,
    summarise_alone,
    tail_gates,
)
from sim_backend.reality_gap.knowledge.healthy import healthy_sessions

STANDARD, RAMPS, CHIRPS = (healthy_sessions((name,)) for name in ("standard", "slow_ramps", "chirps"))


def test_each_study_has_sessions_of_its_own_excitation_where_there_are_any():
    assert healthy_sessions() is healthy_sessions()
    np.testing.assert_array_equal(healthy_sessions().largest_gains, STANDARD.largest_gains)
    assert RAMPS.gates != CHIRPS.gates != STANDARD.gates
    assert RAMPS.left_nats > STANDARD.left_nats == 0.0
    for several in (("standard", "slow_ramps"), ("slow_ramps", "slow_ramps"), ("standard", "standard"), ("anything",)):
        assert healthy_sessions(several).gates == CHIRPS.gates, "gains add up over recordings"


def test_no_gate_is_lower_than_that_of_the_standard_excitation():
    for known in (RAMPS, CHIRPS):
        assert all(known.gates[effect] >= gate for effect, gate in STANDARD.gates.items())


def test_gates_lie_beyond_the_largest_gain_of_any_session():
    lines = [
        {"excitation": "slow_ramps", "seed": 1, "gain": 30.0, "gain_by_effect": {"backlash": 30.0, "cogging": 1.0}, "left": 40.0},
        {"excitation": "slow_ramps", "seed": 1, "gain": 9.0, "gain_by_effect": {"backlash": 9.0}, "left": 50.0},
        {"excitation": "hold_poses", "seed": 2, "gain": 3.0, "gain_by_effect": {"backlash": 3.0}, "left": 0.0},
    ]
    made = summarise_alone({"gates": {"backlash": 7.0, "gravity": 6.0}, "alone": {"chirps": {}}}, lines)["alone"]
    assert set(made) == {"chirps", "slow_ramps", "hold_poses"}
    ramps = made["slow_ramps"]
    least, factor, margin = ALONE_RULE
    assert ramps["gates"] == {"backlash": factor * 30.0 + margin, "gravity": 6.0, "cogging": least}
    assert (ramps["left_nats"], ramps["sessions"], ramps["seeds"]) == (factor * 50.0 + margin, 2, [1])
    assert made["hold_poses"]["gates"]["backlash"] == factor * 3.0 + margin


def test_one_session_in_a_thousand_reaches_a_gate_and_sessions_of_a_later_tool_raise_those_of_other_excitations():
    rng = np.random.default_rng(1)
    tail, none = rng.exponential(2.0, 4000), rng.exponential(0.1, 4000)
    lines = [
        {"seed": 3, "gain": a, "gain_by_effect": {"backlash": a, "gravity": b}, "noise_ratio": 1.1}
        for a, b in zip(tail, none, strict=True)
    ]
    found = tail_gates(lines)
    assert found["backlash"] == pytest.approx(2.0 * np.log(1000.0), rel=0.15)
    assert found["gravity"] == LEAST_GATE
    old = {"gates": {"backlash": 29.0, "gravity": 5.0}, "sessions": [40, 188], "seeds": [1, 2], "tolerances": {"a": [1.0]}}
    old |= {"elsewhere": {"gates": {"backlash": 9.0, "gravity": 6.0}}, "alone": {"ramps": {"gates": {"backlash": 30.0}}}}
    made = summarise_again(old, lines)
    assert made["gates"] == found
    assert (made["sessions"], made["seeds"], made["largest_gains"]) == ([40, 4000], [1, 2, 3], list(tail))
    assert made["elsewhere"]["gates"] == {"backlash": found["backlash"], "gravity": 6.0}
    assert made["alone"]["ramps"]["gates"] == {"backlash": 30.0, "gravity": LEAST_GATE}, "also of what was not measured there"
    assert tail_gates(lines[:10]) == gates(lines[:10]), "so few have no tail"
    assert made["tolerances"] == old["tolerances"]
