"""Compiled trees go where MuJoCo's models go."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.chain import is_plain
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Forward, Windows

STEP_S, SAMPLES, MANY = 0.004, 100, 6
NAMES = ("slide", "yaw", "bend", "other", "wrist")
ARM = """<mujoco><option gravity="0.4 -0.3 -9.7" {option}/><worldbody>
  <geom type="plane" size="1 1 1" pos="0 0 -2"/>
  <body pos="0.1 0.2 0.3" euler="20 10 0"><joint name="slide" type="slide" axis="1 0.2 0" pos="0.1 0 0" damping="0.4"/>
    <geom type="box" size="0.1 0.05 0.02" mass="0.8" pos="0.02 0.01 0"/>
    <body pos="0 0.1 0.1" euler="0 40 10">
      <joint name="yaw" axis="0 0 1" pos="0.02 0 0" ref="0.3" stiffness="0.2" springref="0.5"/>
      <joint name="bend" axis="0 1 0.3" armature="0.002" frictionloss="0.02"/>
      <geom type="capsule" size="0.02 0.1" mass="0.5" pos="0.05 0 0.1" euler="0 30 0"/>
      <body pos="0.1 0 0.1"><geom type="sphere" size="0.03" mass="0.2" pos="0 0.02 0"/>
        <body pos="0 0 0.1"><joint name="unseen" axis="0 1 0"/><geom type="sphere" size="0.02" mass="0.1" pos="0.03 0 0"/>
          <body pos="0.05 0 0"><joint name="wrist" axis="1 0 0"/>
            <geom type="box" size="0.02 0.04 0.01" mass="0.2" pos="0 0.03 0"/>
    </body></body></body></body></body>
  <body pos="0.5 0 0"><joint name="other" axis="0 1 0"/><geom type="capsule" size="0.02 0.1" mass="0.3" pos="0 0 -0.1"/></body>
</worldbody>{more}</mujoco>"""
MODELS = {
    "as it is": {},
    "other bodies": {"link_mass.factor": 1.1, "link.inertia_share": 0.05, "link.centre_x_m": 0.004, "link.centre_z_m": -0.006},
    "dry friction": {"coulomb_friction.torque_nm": 0.05},
    "friction by load and speed": {
        "coulomb_friction.torque_nm": 0.02,
        "load_friction.coefficient": 0.1,
        "stribeck_friction.extra_nm": 0.02,
        "stribeck_friction.speed_rad_s": 0.3,
    },
    "springs, dampers and rotors": {
        "joint_stiffness.stiffness_nm_rad": 0.1,
        "joint_stiffness.reference_rad": 0.4,
        "viscous_friction.damping_nm_s_rad": 0.05,
        "rotor_inertia.armature_kg_m2": 0.01,
    },
    "late, off, weak and rippled": {
        "position_gain.factor": 0.7,
        "action_delay.delay_s": 0.0051,
        "encoder_offset.offset_rad": 0.05,
        "torque_constant.error": -0.1,
        "cogging.amplitude_nm": 0.02,
        "cogging.cycles_per_rad": 3.0,
    },
    "a supply that sags": {"supply_sag.loss_per_nm": 0.4},
}


def windows(rng: np.random.Generator, feedback: Feedback | None) -> Windows:
    joints = len(NAMES)
    sent = 0.03 * np.cumsum(rng.normal(size=(MANY, SAMPLES, joints)), axis=1)
    begin, speed = 0.4 * rng.normal(size=(MANY, joints)), rng.normal(size=(MANY, joints))
    return Windows(STEP_S, np.zeros_like(sent), begin, speed, sent, feedback, np.zeros(MANY, int))


def went(forward: Forward, seen: Windows, states: list[JointState]) -> np.ndarray:
    which = np.arange(MANY) % len(states)
    return forward.positions(seen, seen.begin_rad, seen.begin_rad_s, states, which)


@pytest.mark.parametrize("drive", ["torques", "controller", "controller on board"])
@pytest.mark.parametrize("changed", MODELS)
def test_a_tree_goes_where_mujoco_goes(changed: str, drive: str):
    plant = Plant(mujoco.MjModel.from_xml_string(ARM.format(option="", more="")), NAMES)
    joints, shape = plant.joints, (MANY, SAMPLES, plant.joints)
    law = [np.full(shape, value) for value in (0.3, 5.0, 0.2, 2.0, 0.01, 0.1, float(drive == "controller on board"))]
    law[0] += 0.2 * np.sin(0.3 * np.arange(SAMPLES))[:, None]
    for each in law:
        each[..., 2] = np.nan  # nobody knows what drives this one
    feedback = None if drive == "torques" else Feedback(*law)
    seen = windows(np.random.default_rng(3), feedback)
    own = {key: value.copy() for key, value in plant.own_values.items()}
    states = [JointState(joints, own), JointState(joints, own | {key: np.full(joints, v) for key, v in MODELS[changed].items()})]
    chain, general = Forward(plant, STEP_S), Forward(plant, STEP_S)
    general._chain = None
    quick, slow = went(chain, seen, states), went(general, seen, states)
    assert chain._chain is not None and np.abs(slow[:, -1] - seen.begin_rad).max() > 0.1
    assert np.abs(quick - slow).max() < 3e-3 * np.abs(slow - seen.begin_rad[:, None]).max()
    if changed in {"other bodies", "springs, dampers and rotors"}:  # joints with dry friction stick a little softer in MuJoCo
        free = [0, 1, 3, 4]
        assert np.abs(quick - slow)[:, :, free].max() < 1e-3


def test_what_a_change_does_not_reach_is_simulated_once(monkeypatch: pytest.MonkeyPatch):
    plant = Plant(mujoco.MjModel.from_xml_string(ARM.format(option="", more="")), NAMES)
    seen, forward = windows(np.random.default_rng(6), None), Forward(plant, STEP_S)
    heavier = np.ones(plant.joints)
    heavier[NAMES.index("other")] = 1.2
    states = [JointState(plant.joints), JointState(plant.joints, {"link_mass.factor": heavier})]
    which, over = np.repeat([0, 1], MANY), np.tile(np.arange(MANY), 2)
    chain, simulated = forward._chain, list[tuple[int, int]]()
    assert chain is not None
    real = chain._simulated

    def counted(tree, drives, of_models, begins, window, which):
        simulated.append((len(tree.order), len(window)))
        return real(tree, drives, of_models, begins, window, which)

    monkeypatch.setattr(chain, "_simulated", counted)
    begins = seen.begin_rad[over], seen.begin_rad_s[over]
    apart = forward.positions(seen, *begins, states, which, over)
    assert sorted(simulated) == [(1, 2 * MANY), (len(NAMES) - 1, MANY)]
    chain._trees = [chain._whole]
    together = forward.positions(seen, *begins, states, which, over)
    assert np.abs(apart - together).max() < 1e-9
    assert np.abs(apart[MANY:] - apart[:MANY]).max(axis=(0, 1)).nonzero()[0].tolist() == [NAMES.index("other")]


def test_joints_that_friction_holds_stay():
    plant = Plant(mujoco.MjModel.from_xml_string(ARM.format(option="", more="")), NAMES)
    held = {"coulomb_friction.torque_nm": np.full(plant.joints, 50.0)}
    seen = windows(np.random.default_rng(4), None)
    rests = replace(seen, begin_rad_s=np.zeros_like(seen.begin_rad_s))
    found = went(Forward(plant, STEP_S), rests, [JointState(plant.joints, held)])
    assert np.abs(found - rests.begin_rad[:, None]).max() < 1e-9


@pytest.mark.parametrize("pushed_nm", [0.1, -0.2, 0.6])
def test_a_bearing_gives_until_it_slips_and_creeps_until_then(pushed_nm: float):
    """Pushed with less than its friction a joint moves by that share of what it gives, and creeps by that share of its speed."""
    friction_nm, give_rad, creep_rad_s, samples = 0.5, 2e-3, 0.01, 500
    arm = """<mujoco><worldbody><body><joint name="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody></mujoco>"""
    plant = Plant(mujoco.MjModel.from_xml_string(arm), ("hinge",))
    rests, sent = np.zeros((1, 1)), np.full((1, samples, 1), pushed_nm)
    seen = Windows(STEP_S, np.zeros_like(sent), rests, rests, sent, None, np.zeros(1, int))
    law = {
        "coulomb_friction.torque_nm": friction_nm,
        "viscous_friction.damping_nm_s_rad": 0.02,
        "bearing.give_rad": give_rad,
        "bearing.creep_rad_s": creep_rad_s,
    }
    states = [JointState(1, {key: np.array([value]) for key, value in law.items()})]
    (went_rad,) = Forward(plant, STEP_S).positions(seen, rests, rests, states, np.zeros(1, int))[:, :, 0]
    share, last_s = pushed_nm / friction_nm, 0.5 * STEP_S * samples
    creeps = (went_rad[-1] - went_rad[samples // 2 - 1]) / last_s
    if abs(share) > 1.0:
        assert creeps == pytest.approx((pushed_nm - friction_nm) / 0.02, rel=0.01), "it slips, and only its damper is left"
        return
    assert creeps == pytest.approx(share * creep_rad_s, rel=0.05)
    assert went_rad[-1] - creeps * STEP_S * samples == pytest.approx(share * give_rad, rel=0.1)


@pytest.mark.parametrize(
    ("option", "more"),
    [
        ('viscosity="0.1"', ""),
        ("", '<tendon><fixed stiffness="1"><joint joint="yaw" coef="1"/></fixed></tendon>'),
        ('integrator="Euler"><flag spring="disable"/></option><option', ""),
    ],
    ids=["air", "tendon", "no springs"],
)
def test_what_a_tree_lacks_runs_in_mujoco(option: str, more: str):
    model = mujoco.MjModel.from_xml_string(ARM.format(option=option, more=more))
    assert not is_plain(model) and Forward(Plant(model, NAMES), STEP_S)._chain is None


def test_what_diverges_is_not_a_number():
    plant = Plant(mujoco.MjModel.from_xml_string(ARM.format(option="", more="")), NAMES)
    seen = windows(np.random.default_rng(5), None)
    wild = replace(seen, sent_nm=np.full_like(seen.sent_nm, 1e9))
    assert np.isnan(went(Forward(plant, STEP_S), wild, [JointState(plant.joints)])[:, -1]).all()
