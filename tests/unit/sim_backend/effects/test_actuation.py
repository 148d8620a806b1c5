"""Each effect of actuation does what physics says it must."""

import numpy as np
import pytest

from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.actuation import MAX_DELAY_S
from sim_backend.effects.physics import Physics
from tests.unit.sim_backend.effects.rig import MID_RAD, UNDAMPED, WEIGHTLESS, c, go_to, only, rig, run, start_of

FREE = WEIGHTLESS | UNDAMPED


@pytest.mark.parametrize("steps", [1, 3, 20, 99])
def test_a_delay_of_n_ms_is_exactly_n_ms(steps: int):
    driver = rig(UNDAMPED | {"action_delay.delay_s": steps / 1000})
    segment = run(driver, only(1, 0.1), 150)
    arrived = segment.effective_torque_nm[0, :, 1]
    assert (arrived[:steps] == 0.0).all() and (arrived[steps:] == segment.applied_torque_nm[0, : 150 - steps, 1]).all()
    assert (segment.applied_torque_nm[0, :, 1] == 0.1).all(), "what was sent is not what has arrived"


def test_a_fraction_of_a_step_is_the_mean_over_the_step():
    segment = run(rig(UNDAMPED | {"action_delay.delay_s": 0.00225}), only(1, 0.1), 5)
    assert segment.effective_torque_nm[0, :, 1] == pytest.approx([0.0, 0.0, 0.075, 0.1, 0.1])


def test_each_motor_may_have_a_delay_of_its_own():
    delays_s = np.array([0, 1, 2, 3, 4, 5, 6, 7, 100]) / 1000
    assert delays_s.max() == MAX_DELAY_S
    segment = run(rig(UNDAMPED | {"action_delay.delay_s": delays_s[None]}), 0.05, 120)
    assert (segment.effective_torque_nm[0] != 0).argmax(axis=0) == pytest.approx(delays_s * 1000)


def lateness_s(std_s: float, step_s: float, robots: int = 2000) -> np.ndarray:
    """How late a command comes, from the torque that is missing at the end."""
    driver = SimulatedDriver(
        robots=robots, physics=Physics.of(robots, UNDAMPED | {"timing_jitter.std_s": std_s}), physics_step_s=step_s
    )
    driver.reset(start_of(robots))
    steps = round(max(0.012, 12 * std_s) / step_s)
    run(driver, 0.1, steps)
    torque = run(driver, -0.1, steps).applied_torque_nm[:, :, 0]
    assert np.abs(torque).max() <= 0.1 + 1e-12
    return step_s * (torque + 0.1).sum(axis=1) / 0.2


@pytest.mark.parametrize(
    ("step_s", "std_s"),
    [
        (0.001, 0.0005),
        (0.004, 1e-5),
        (0.004, 0.0005),
        (0.004, 0.005),
        pytest.param(0.001, 1e-5, marks=pytest.mark.scale),
        pytest.param(0.001, 0.005, marks=pytest.mark.scale),
    ],
)
def test_lateness_is_half_normal_whatever_the_step(std_s: float, step_s: float):
    """`test_lateness_is_half_normal_whatever_the_step` has every deviation and every step without scale."""
    late_s = lateness_s(std_s, step_s)
    expected, spread = std_s * np.sqrt(2 / np.pi), std_s * np.sqrt(1 - 2 / np.pi)
    assert late_s.mean() == pytest.approx(expected, abs=4 * spread / np.sqrt(len(late_s)))
    assert late_s.std() == pytest.approx(spread, rel=0.1)


def test_commands_that_come_faster_than_they_act_are_not_lost():
    driver = rig(UNDAMPED | {"timing_jitter.std_s": 0.005}, 50)
    torque = np.linspace(0.0, 0.2, 300)
    wanted = np.broadcast_to(torque[None, :, None], (50, 300, 9)).copy()
    acted = driver.advance_torques(wanted).applied_torque_nm[:, :, 0]
    behind = torque[None] - acted
    assert behind[:, 100:].max() < 0.2 / 300 * 25, "never more than five standard deviations behind"


def test_a_late_position_target_comes_late_too():
    driver = rig(WEIGHTLESS | {"timing_jitter.std_s": 0.01}, 200)
    segment = go_to(driver, MID_RAD + 0.05, 60)
    first = (segment.applied_torque_nm[:, :, 0] > 0.01).argmax(axis=1)
    assert (first == 0).mean() < 0.2 and first.max() > 10


def test_recorded_torques_replay_through_effects_without_being_protected_twice():
    values = {
        "action_delay.delay_s": 0.003,
        "torque_constant.error": 0.2,
        "load_friction.coefficient": 0.1,
        "encoder_offset.offset_rad": 0.05,
    }
    first = rig(values)
    seen = [run(first, torque, 100) for torque in (0.2, -0.1, 0.3)]
    again = SimulatedDriver(physics=Physics.of(1, values), safety=False)
    again.reset(start_of())
    for segment in seen:
        other = again.advance_torques(np.ascontiguousarray(segment.applied_torque_nm))
        assert (other.joint_position_rad == segment.joint_position_rad).all()
        assert (other.effective_torque_nm == segment.effective_torque_nm).all()


def test_the_measured_torque_is_that_of_the_current():
    values = {"action_delay.delay_s": 0.002, "torque_saturation.limit_nm": 0.1, "torque_constant.error": 0.3}
    segment = run(rig(UNDAMPED | values), only(1, 0.3), 5)
    assert segment.measured_torque_nm[0, :, 1] == pytest.approx([0.0, 0.0, 0.1, 0.1, 0.1])
    assert segment.effective_torque_nm[0, 4, 1] == pytest.approx(0.13)


def test_a_torque_constant_scales_every_torque():
    errors = np.linspace(-0.2, 0.2, 9)
    segment = run(rig({"torque_constant.error": errors[None]}), 0.2, 50)
    assert segment.effective_torque_nm[0] == pytest.approx(segment.applied_torque_nm[0] * (1 + errors))


def test_saturation_clips():
    segment = run(rig({"torque_saturation.limit_nm": 0.15} | UNDAMPED), np.linspace(-0.3, 0.3, 9), 20)
    assert segment.effective_torque_nm[0] == pytest.approx(np.clip(segment.applied_torque_nm[0], -0.15, 0.15))
    assert np.abs(segment.applied_torque_nm).max() > 0.29


def test_a_sagging_supply_lowers_the_limit_with_the_total():
    sag = 0.1
    one = run(rig({"supply_sag.loss_per_nm": sag} | UNDAMPED), only(0, 0.39), 1).effective_torque_nm[0, 0]
    all_nine = run(rig({"supply_sag.loss_per_nm": sag} | UNDAMPED), 0.39, 1).effective_torque_nm[0, 0]
    assert one[0] == pytest.approx(min(0.39, c.MAX_TORQUE_NM * (1 - sag * 0.39)))
    assert all_nine == pytest.approx(c.MAX_TORQUE_NM * (1 - sag * 9 * 0.39))


def test_a_sagging_supply_counts_what_motors_give_and_spares_those_below_it():
    values = {"supply_sag.loss_per_nm": 0.25, "torque_saturation.limit_nm": 0.1}
    given = run(rig(values | UNDAMPED), 0.39, 1).effective_torque_nm[0, 0]
    assert given == pytest.approx(np.full(9, 0.1)), "nine times 0.1 leave 0.307 each"


def test_motors_heat_up_and_cool_down_with_the_stated_time_constant():
    loss, rise, time_s, torque_nm = 0.004, 400.0, 2.0, 0.2
    values = {
        "thermal_derating.loss_per_k": loss,
        "thermal_derating.rise_k_nm2": rise,
        "thermal_derating.time_constant_s": time_s,
    }
    driver = rig(FREE | values | {"stuck_joint.holding_torque_nm": 20.0})
    segment = run(driver, torque_nm, 3000)
    final_k = rise * torque_nm**2
    expected_k = final_k * (1 - np.exp(-np.arange(1, 3001) / 1000 / time_s))
    assert segment.effective_torque_nm[0] == pytest.approx(torque_nm * (1 - loss * expected_k[:, None]).repeat(9, 1), rel=1e-6)
    hot_k = driver.motor_temperature_rise_k[0]
    assert hot_k == pytest.approx(expected_k[-1])
    run(driver, 0.0, 1000)
    assert driver.motor_temperature_rise_k[0] == pytest.approx(hot_k * np.exp(-1 / time_s))
    driver.reset(start_of(motor_temperature_rise_k=np.full((1, 9), 33.0)))
    assert (driver.motor_temperature_rise_k == 33.0).all()


def test_cogging_follows_the_position():
    amplitude, cycles = 0.02, 10.0
    segment = run(rig(WEIGHTLESS | {"cogging.amplitude_nm": amplitude, "cogging.cycles_per_rad": cycles}), 0.1, 400)
    added = segment.effective_torque_nm[0] - segment.applied_torque_nm[0]
    assert added == pytest.approx(amplitude * np.sin(2 * np.pi * cycles * segment.true_joint_position_rad[0]), abs=1e-9)
    assert np.ptp(added) > amplitude


def test_white_noise_has_the_stated_deviation_and_is_held():
    driver = rig(FREE | {"action_noise.white_nm": 0.01, "action_noise.hold_s": 0.02, "stuck_joint.holding_torque_nm": 20.0}, 20)
    noise = run(driver, 0.0, 2000).effective_torque_nm.reshape(20, 100, 20, 9)
    assert (noise == noise[:, :, :1]).all()
    numbers = noise[:, :, 0].ravel()
    assert numbers.std() == pytest.approx(0.01, rel=4 / np.sqrt(2 * numbers.size))
    assert abs(numbers.mean()) < 4 * 0.01 / np.sqrt(numbers.size)


def test_correlated_noise_forgets_within_its_time_constant():
    time_s, robots = 0.05, 400
    values = {"action_noise.correlated_nm": 0.01, "action_noise.time_constant_s": time_s, "stuck_joint.holding_torque_nm": 20.0}
    noise = run(rig(FREE | values, robots), 0.0, 101).effective_torque_nm
    assert noise.std(axis=(0, 2)) == pytest.approx(np.full(101, 0.01), rel=4 / np.sqrt(2 * robots * 9))
    kept = (noise[:, 0] * noise[:, 50]).mean() / (noise[:, 0].std() * noise[:, 50].std())
    assert kept == pytest.approx(np.exp(-0.05 / time_s), abs=4 / np.sqrt(robots * 9))


def test_relative_noise_grows_with_the_torque():
    driver = rig(FREE | {"action_noise.relative": 0.05, "stuck_joint.holding_torque_nm": 20.0}, 50)
    segment = run(driver, np.array([0.0] * 3 + [0.1] * 3 + [0.2] * 3), 200)
    spread = segment.effective_torque_nm.reshape(-1, 3, 3).std(axis=(0, 2))
    assert spread == pytest.approx([0.0, 0.005, 0.01], rel=4 / np.sqrt(2 * 50 * 200 * 3), abs=1e-12)


def test_backlash_lets_the_rotor_turn_freely_through_the_gap():
    gap = 0.02
    driver = rig(FREE | {"backlash.gap_rad": gap})
    forth, back = run(driver, 0.05, 50), run(driver, -0.05, 100)
    play = [segment.joint_position_rad[0] - segment.true_joint_position_rad[0] for segment in (forth, back)]
    assert play[0][-1] == pytest.approx(np.full(9, gap / 2)) and play[1][-1] == pytest.approx(np.full(9, -gap / 2))
    crossing = np.abs(play[1]) < gap / 2 - 1e-9
    inside = crossing[:-1] & crossing[1:]  # with the step of arrival left out, in which the rotor hands over its momentum
    assert crossing.any(axis=0).all() and (back.effective_torque_nm[0][:-1][inside] == 0.0).all()
    assert (back.effective_torque_nm[0, -1] == back.applied_torque_nm[0, -1]).all()
    # beside a joint that does not accelerate a free rotor crosses in sqrt(2 gap J / torque)
    free_s = np.sqrt(2 * gap * 4.5e-6 * c.GEAR_RATIO**2 / 0.05)
    assert crossing.sum(axis=0) == pytest.approx(np.full(9, 1000 * free_s), rel=0.5)


@pytest.mark.parametrize("gap_rad", [1e-6, 0.004, 0.01])
def test_backlash_delays_momentum_and_loses_none(gap_rad: float):
    """What joint and free rotor have together is the motor's impulse, also after the rotor has arrived."""
    armature = 4.5e-6 * c.GEAR_RATIO**2
    values = FREE | {"stuck_joint.holding_torque_nm": np.where(np.arange(9) == 0, 0.0, 20.0)[None]}
    driver = rig(values | {"backlash.gap_rad": gap_rad, "backlash.rotor_inertia_kg_m2": armature})
    segment = run(driver, only(0, 0.05), 40)
    impulse = segment.effective_torque_nm[0, :, 0].sum() * 0.001
    assert impulse == pytest.approx(0.05 * 0.040, rel=0.03)
    nominal = run(rig(values), only(0, 0.05), 40)
    assert segment.true_joint_velocity_rad_s[0, -1, 0] == pytest.approx(nominal.true_joint_velocity_rad_s[0, -1, 0], rel=0.03)


def test_gains_act_on_the_driver():
    driver = rig({"position_gain.factor": 1.5, "safety_damping.factor": 0.5})
    first = go_to(driver, MID_RAD + 0.01, 30)
    error = MID_RAD + 0.01 - first.joint_position_rad[0]
    velocity = first.joint_velocity_rad_s[0]
    damping = c.VELOCITY_GAIN_NM_S_RAD + 0.5 * c.SAFETY_DAMPING_NM_S_RAD
    assert first.applied_torque_nm[0] == pytest.approx(1.5 * c.POSITION_GAIN_NM_RAD * error - damping * velocity, abs=1e-12)
