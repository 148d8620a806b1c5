"""Causes hidden in the joints of an arm that nobody calibrated for: MuJoCo's own friction, a controller that feeds noise back."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import Verdict, VerdictKind

NAMES = ("shoulder", "elbow", "wrist")
LENGTHS_M, AXES = (0.3, 0.25, 0.2), ("0 1 0", "0 1 0", "1 0 0")
MASSES_KG = (1.0, 0.7, 0.3)
STIFFNESS_NM_RAD, DAMPING_NM_S_RAD = np.array([30.0, 15.0, 4.0]), np.array([2.0, 1.0, 0.2])
PERIODS_S = np.array([[1.7, 0.61], [2.3, 0.47], [1.3, 0.83]])
ENCODER_RAD = 2e-4
STEP_S, SECONDS = 1e-3, 20.0


def arm(joint="", masses=MASSES_KG, gears=(1.0, 1.0, 1.0), limit_nm=50.0, gravity="0 0 -9.81") -> mujoco.MjModel:
    """Three links that hang; ``joint`` are attributes of the elbow, or of all joints with ``*`` before them."""
    bodies = ""
    for j, name in enumerate(NAMES):
        own = joint[1:] if joint.startswith("*") else joint if j == 1 else ""
        bodies += (
            f'<body pos="0 0 {-LENGTHS_M[j - 1] if j else 0}"><joint name="{name}" axis="{AXES[j]}" {own}/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 {-LENGTHS_M[j]}" size=".02" mass="{masses[j]}" contype="0" conaffinity="0"/>'
        )
    motors = "".join(
        f'<motor joint="{name}" gear="{gear}" ctrllimited="true" ctrlrange="{-limit_nm} {limit_nm}"/>'
        for name, gear in zip(NAMES, gears, strict=True)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP_S}" gravity="{gravity}" integrator="implicitfast"/>'
        f"<worldbody>{bodies}{'</body>' * 3}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def recorded(model: mujoco.MjModel, seed: int, delay_steps: int = 0, offset_rad: float = 0.0) -> Recording:
    """One episode: sines are followed, and what the controller sends is recorded."""
    rng, data, steps = np.random.default_rng(seed), mujoco.MjData(model), round(SECONDS / STEP_S)
    position, torque = np.empty((steps, 3)), np.empty((steps, 3))
    phase, sent = rng.uniform(0.0, 2 * np.pi, (3, 2)), [np.zeros(3)] * delay_steps
    targets = 0.5 * np.sin(2 * np.pi * np.arange(steps)[:, None, None] * STEP_S / PERIODS_S + phase).sum(axis=2)
    off, qpos, qvel = ENCODER_RAD * rng.standard_normal((steps, 3)) + np.array([0.0, offset_rad, 0.0]), data.qpos, data.qvel
    for step in range(steps):
        position[step] = qpos + off[step]
        torque[step] = STIFFNESS_NM_RAD * (targets[step] - position[step]) - DAMPING_NM_S_RAD * qvel
        sent.append(torque[step])
        data.ctrl[:] = sent[step]
        mujoco.mj_step(model, data)
    joints = JointSignals(NAMES, position, commanded_torque_nm=torque)
    return Recording(f"run {seed}", "arm.csv", STEP_S, STEP_S * np.arange(steps), joints)


def verdict_of(model: mujoco.MjModel, **how) -> Verdict:
    recordings = [recorded(model, seed, **how) for seed in (1, 2)]
    return judge(study_joints(arm(), recordings, lambda *_: None, robot=UnknownRobot())).verdict


HIDDEN = {
    "coulomb_friction": (dict(model=arm('frictionloss="0.15"')), "torque_nm", 0.15, 0.05),
    "viscous_friction": (dict(model=arm('damping="0.1"')), "damping_nm_s_rad", 0.1, 0.02),
    "rotor_inertia": (dict(model=arm('armature="0.01"')), "armature_kg_m2", 0.01, 0.02),
    "joint_stiffness": (dict(model=arm('stiffness="0.5"')), "stiffness_nm_rad", 0.5, 0.02),
    "link_mass": (dict(model=arm(masses=(1.0, 0.85, 0.3))), "factor", 0.85 / 0.7, 0.02),
    "torque_constant": (dict(model=arm(gears=(1.0, 0.85, 1.0))), "error", -0.15, 0.03),
    "encoder_offset": (dict(model=arm(), offset_rad=0.05), "offset_rad", 0.05, 0.03),
}


WITHOUT_SCALE = ("link_mass", "encoder_offset")


@pytest.mark.parametrize("effect", [pytest.param(e, marks=[pytest.mark.scale] * (e not in WITHOUT_SCALE)) for e in HIDDEN])
def test_a_cause_at_the_elbow_is_named_with_its_value(effect):
    """`test_a_cause_at_the_elbow_is_named_with_its_value` has a body and a sensor without scale,
    `test_its_commands_say_what_the_page_says` a friction.
    """
    how, parameter, value, error = HIDDEN[effect]
    verdict = verdict_of(**how)
    assert verdict.verdict is VerdictKind.NAMED
    assert {(cause.effect, cause.where) for cause in verdict.causes} == {(effect, "elbow")}
    (cause,) = (cause for cause in verdict.causes if cause.parameter == parameter)
    assert cause.value == pytest.approx(value, rel=error)


def test_friction_of_all_joints_is_told_from_damping_beside_it():
    verdict = verdict_of(arm('*frictionloss="0.1" damping="0.05"'))
    assert verdict.verdict is VerdictKind.NAMED
    found = {effect: [c.value for c in verdict.causes if c.effect == effect] for effect in {c.effect for c in verdict.causes}}
    assert set(found) == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"] == pytest.approx([0.1] * 3, rel=0.12)  # MuJoCo blurs it, where it turns round
    assert found["viscous_friction"][:2] == pytest.approx([0.05] * 2, rel=0.05)


def test_a_limit_of_a_motor_far_below_what_was_sent_is_found():
    verdict = verdict_of(arm(limit_nm=1.5))
    assert [(c.effect, c.where) for c in verdict.causes] == [("torque_saturation", "shoulder")]
    low, high = verdict.causes[0].interval_90
    assert verdict.causes[0].value == pytest.approx(1.5, rel=0.01) and 1.2 < low < 1.5 < high < 1.8


def test_a_late_controller_is_late_at_all_joints():
    verdict = verdict_of(arm(), delay_steps=5)
    assert {(c.effect, c.where) for c in verdict.causes} == {("action_delay", name) for name in NAMES}
    assert [c.value for c in verdict.causes] == pytest.approx([0.005] * 3, rel=0.1)


def test_a_tilted_base_is_told_as_gravity():
    verdict = verdict_of(arm(gravity="0.5 0 -9.797"))
    assert {c.effect for c in verdict.causes} <= {"gravity", "table_tilt"}
    assert next(c for c in verdict.causes if c.where == "x").value == pytest.approx(0.5, rel=0.03)


def test_nothing_is_wrong_with_an_arm_whose_masses_are_not_exact():
    assert verdict_of(arm(masses=(1.015, 0.692, 0.303))).verdict is VerdictKind.NOTHING_WRONG


@pytest.mark.scale
def test_nothing_is_wrong_with_the_nominal_arm():
    """`test_nothing_is_wrong_with_an_arm_whose_masses_are_not_exact` asks it of a harder arm."""
    assert verdict_of(arm()).verdict is VerdictKind.NOTHING_WRONG
