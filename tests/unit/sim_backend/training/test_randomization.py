"""Robots to train on: from presets, from a study's intervals, and from ranges that grow with success."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")

from sim_backend.effects.ranges import load_ranges
from sim_backend.training.adr import AutomaticRandomization
from sim_backend.training.randomization import FixedRandomization, ranges_to_train_on
from sim_backend.training.recipe import Randomization

ROBOTS = np.arange(400)


@pytest.mark.parametrize("preset", ["dactyl", "allshire", "isaacgymenvs", "real"])
def test_presets_draw_other_robots_for_each_trial(preset):
    randomizer, rng = FixedRandomization(ranges_to_train_on(preset)), np.random.default_rng(0)
    first, second = randomizer.draw(rng, ROBOTS[:8]), randomizer.draw(rng, ROBOTS[:8])
    differing = [key for key, values in first.given.items() if (values != second.given[key]).any()]
    assert differing
    assert set(differing) <= {row.key for row in load_ranges(preset).rows}


def test_a_share_of_the_robots_is_nominal():
    randomizer = FixedRandomization(ranges_to_train_on("real"), nominal_share=0.25)
    drawn = randomizer.draw(np.random.default_rng(0), ROBOTS)
    ideal = [(drawn.value(key) == 0.0).all(axis=1) for key in ("coulomb_friction.torque_nm", "action_delay.delay_s")]
    np.testing.assert_array_equal(*ideal)
    assert 0.18 < ideal[0].mean() < 0.32


def test_a_study_is_drawn_from_its_intervals(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(
        "[coulomb_friction]\ntorque_nm = 0.02\n[[interval_90]]\n"
        'key = "coulomb_friction.torque_nm"\nwhere = "all joints"\nlow = 0.01\nhigh = 0.03\n'
    )
    randomizer = FixedRandomization(ranges_to_train_on(str(path)))
    drawn = randomizer.draw(np.random.default_rng(0), ROBOTS).value("coulomb_friction.torque_nm")
    assert 0.01 <= drawn.min() < 0.012 and 0.028 < drawn.max() <= 0.03
    assert (drawn == drawn[:, :1]).all()


def adr(**changes) -> AutomaticRandomization:
    return AutomaticRandomization(load_ranges("real"), Randomization(method="adr", trials=8, **changes), len(ROBOTS))


def trials(randomizer: AutomaticRandomization, rounds: int, success: bool) -> None:
    rng = np.random.default_rng(0)
    for _ in range(rounds):
        randomizer.draw(rng, ROBOTS)
        randomizer.told(ROBOTS, np.full(len(ROBOTS), success))


def test_ranges_begin_at_the_nominal_robot_and_grow_with_success():
    randomizer = adr()
    effects = randomizer.draw(np.random.default_rng(0), ROBOTS)
    assert not any(effects.has(name) for name in ("coulomb_friction", "action_delay", "fingertip_friction", "cube_mass"))
    before = randomizer.entropy
    trials(randomizer, 40, success=True)
    assert before < randomizer.entropy < 0.0
    assert randomizer.draw(np.random.default_rng(0), ROBOTS).has("coulomb_friction")


def test_all_succeeding_opens_everything_and_all_failing_closes_it():
    randomizer = adr(step=0.5)
    trials(randomizer, 80, success=True)
    assert randomizer.entropy == pytest.approx(0.0, abs=1e-9)
    drawn = randomizer.draw(np.random.default_rng(1), ROBOTS)
    for row in load_ranges("real").rows:
        values = drawn.value(row.key)
        assert values.min() >= min(row.low, row.parameter.absent) - 1e-12
        assert values.max() <= max(row.high, row.parameter.absent) + 1e-12
    trials(randomizer, 160, success=False)
    assert (randomizer.reach == 0.0).all()


def test_only_the_trials_at_a_boundary_count_and_each_for_its_own():
    randomizer = adr(at_boundary=0.0)
    trials(randomizer, 20, success=True)
    assert (randomizer.reach == 0.0).all()
    randomizer = adr()
    rng = np.random.default_rng(0)
    for _ in range(40):
        randomizer.draw(rng, ROBOTS)
        randomizer.told(ROBOTS, randomizer._was_at == 3)
    assert randomizer.reach[1, 1] > 0.0
    assert (np.delete(randomizer.reach.ravel(), 3) == 0.0).all()


def test_boundaries_outlive_a_checkpoint():
    randomizer, other = adr(), adr()
    trials(randomizer, 30, success=True)
    other.restore(randomizer.state())
    np.testing.assert_array_equal(other.reach, randomizer.reach)
    assert other.document() == randomizer.document()
