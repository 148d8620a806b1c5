"""Which healthy sessions a study is compared with."""

import numpy as np

from sim_backend.reality_gap.bench.joint_calibration import ALONE_RULE, summarise_alone
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
