"""One parameterised test over the whole catalogue: absent is nominal to the bit, present is not, trial and batch agree."""

import json

import numpy as np
import pytest

from sim_backend.driver.driver import Segment
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.__main__ import main
from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import LOOKS, Acts, Effect
from sim_backend.effects.physics import Physics
from tests.unit.sim_backend.effects.rig import c, go_to, present, run, start_of

EVERY = list(CATALOGUE.values())
ON_JOINTS = [effect for effect in EVERY if effect.acts is not Acts.TRACKER and effect.acts not in LOOKS]
NAMED = {"argvalues": EVERY, "ids": [effect.name for effect in EVERY]}
JOINTS_NAMED = {"argvalues": ON_JOINTS, "ids": [effect.name for effect in ON_JOINTS]}
SUFFIXES = {
    "": "",
    "s": "_s",
    "m": "_m",
    "N": "_n",
    "K": "_k",
    "Hz": "_hz",
    "px": "_px",
    "rad": "_rad",
    "rad/s": "_rad_s",
    "m/s^2": "_m_s2",
    "N m": "_nm",
    "1/K": "_per_k",
    "1/rad": "_per_rad",
    "1/(N m)": "_per_nm",
    "N m/rad": "_nm_rad",
    "N m s/rad": "_nm_s_rad",
    "kg m^2": "_kg_m2",
    "K/(N m)^2": "_k_nm2",
}
ARRAYS = [name for name in Segment._fields if name != "first_step"]


def course(driver: SimulatedDriver, seed: int = 5, periods: int = 40) -> dict[str, np.ndarray]:
    """Random torques with fingers at table and cube, then position commands, then against both ends of the joints."""
    rng, segments = np.random.default_rng(seed), []
    for _ in range(periods // 2):
        torque = np.repeat(rng.uniform(-0.3, 0.3, (1, 1, 9)), 20, axis=1).repeat(driver.robots, axis=0)
        segments.append(driver.advance_torques(np.ascontiguousarray(torque)))
    for _ in range(periods // 2):
        segments.append(go_to(driver, rng.uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD), 20))
    segments += [run(driver, torque_nm, 5 * periods) for torque_nm in (0.39, -0.39)]
    return {name: np.concatenate([getattr(segment, name) for segment in segments], axis=1) for name in ARRAYS}


@pytest.fixture(scope="module")
def nominal() -> dict[str, np.ndarray]:
    driver = SimulatedDriver()
    driver.reset(start_of(joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325)))
    return course(driver)


def test_there_are_at_least_24():
    assert len(EVERY) >= 24


@pytest.mark.parametrize("effect", **NAMED)
def test_numbers_are_bounded_and_sourced(effect: Effect):
    assert effect.about and effect.source and callable(effect.apply) and effect.apply.__doc__
    assert effect.parameters
    for parameter in effect.all_parameters:
        assert parameter.lower <= parameter.absent <= parameter.upper, parameter
        assert parameter.lower < parameter.upper, parameter
        assert parameter.name.endswith(SUFFIXES[parameter.unit]), f"{parameter}: the unit belongs into the name"
    assert Physics.of(1, present(effect)).has(effect.name)
    absent = {effect.key(parameter): parameter.absent for parameter in effect.all_parameters}
    assert Physics.of(1, absent).is_nominal


@pytest.mark.parametrize("effect", **JOINTS_NAMED)
def test_absent_is_nominal_to_the_bit_and_present_is_not(effect: Effect, nominal):
    """Two robots side by side: one with the effect, one without; the second must not know of the first."""
    values = {
        key: np.stack([np.full(PARAMETERS[key].width, PARAMETERS[key].absent), np.full(PARAMETERS[key].width, value)])
        if PARAMETERS[key].width > 1
        else np.array([PARAMETERS[key].absent, value])
        for key, value in present(effect).items()
    }
    driver = SimulatedDriver(robots=2, physics=Physics.of(2, values))
    driver.reset(start_of(2, joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325)))
    both = course(driver)
    assert all((both[name][0] == nominal[name][0]).all() for name in ARRAYS)
    assert any((both[name][1] != nominal[name][0]).any() for name in ARRAYS)


@pytest.mark.parametrize("effect", **JOINTS_NAMED)
def test_a_trial_and_a_batch_agree(effect: Effect):
    physics = Physics.of(3, present(effect))
    start = start_of(3, joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325))
    batch = SimulatedDriver(robots=3, threads=2, physics=physics)
    batch.reset(start)
    many = course(batch, periods=20)
    trial = SimulatedDriver(physics=physics.row(2))
    trial.reset(start_of(joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325), first_seed=3))
    one = course(trial, periods=20)
    for name in ARRAYS:
        assert np.abs(one[name][0] - many[name][2]).max() <= 1e-9, name


def everything(n: int) -> Physics:
    """All effects at once, mildly: a tenth of the way to their bounds; faults left out."""
    values = {}
    for effect in ON_JOINTS:
        for parameter in effect.parameters if effect.group != "fault" else ():
            bound = max((parameter.lower, parameter.upper), key=lambda value: abs(value - parameter.absent))
            values[effect.key(parameter)] = parameter.absent + (bound - parameter.absent) / 10
    return Physics.of(n, values)


def test_a_trial_and_a_batch_agree_over_two_seconds_with_all_effects():
    batch = SimulatedDriver(robots=4, threads=2, physics=everything(4))
    batch.reset(start_of(4, joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325)))
    many = course(batch, periods=68)
    trial = SimulatedDriver(physics=everything(1))
    trial.reset(start_of(joints=c.START_JOINT_POSITION_RAD, cube=(0.06, 0.06, 0.0325), first_seed=4))
    one = course(trial, periods=68)
    assert many["joint_position_rad"].shape[1] >= 2000
    for name in ARRAYS:
        assert np.abs(one[name][0] - many[name][3]).max() <= 1e-9, name


def test_a_measurement_is_the_next_row_of_the_log():
    driver = SimulatedDriver(robots=2, physics=everything(2))
    driver.reset(start_of(2))
    course(driver, periods=4)
    measured = driver.measure()
    row = driver.advance_torques(np.zeros((2, 1, 9)))
    assert (measured.joint_position_rad == row.joint_position_rad[:, 0]).all()
    assert (measured.joint_velocity_rad_s == row.joint_velocity_rad_s[:, 0]).all()
    assert (measured.joint_position_rad != measured.true_joint_position_rad).any()


def test_effects_may_change_between_control_periods_and_states_stay():
    driver, untouched = SimulatedDriver(), SimulatedDriver()
    for each in (driver, untouched):
        each.reset(start_of())
        course(each, periods=4)
    driver.set_physics(Physics.of(1, {"stuck_joint.holding_torque_nm": [[20.0] + 8 * [0.0]]}))
    assert (driver.measure().true_joint_position_rad == untouched.measure().true_joint_position_rad).all()
    driver.set_physics(Physics.nominal())
    first, second = course(driver, periods=4), course(untouched, periods=4)
    assert all((first[name] == second[name]).all() for name in ARRAYS)


def test_the_command_lists_everything(capsys):
    assert main(["--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert [effect["name"] for effect in listed] == list(CATALOGUE)
    assert {parameter["key"] for effect in listed for parameter in effect["parameters"]} == set(PARAMETERS)
    assert main([]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name}: " in text for name in CATALOGUE)
