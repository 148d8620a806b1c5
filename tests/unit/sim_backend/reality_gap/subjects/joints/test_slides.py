"""Slides counted like hinges: the same motion in other units, and causes told in newtons and metres."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.slides import Slides, told_distance, told_range, told_speed, told_torque
from sim_backend.reality_gap.verdict import Cause, EffectJudged, HeldOut, Told, Verdict, VerdictKind

CART_POLE = """<mujoco><option timestep="0.001"/><worldbody><body>
  <joint name="cart" type="slide" axis="0.6 0.8 0" armature="2" damping="3" stiffness="5" springref="0.1" frictionloss="1"
    range="-1 2" limited="true"/><geom type="box" size=".1 .1 .1" mass="4"/>
  <body pos="0 0 .1"><joint name="pole" axis="0 1 0" damping="0.01"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 .4" size=".02" mass="1"/></body></body></worldbody>
  <tendon><fixed name="rope" stiffness="7"><joint joint="cart" coef="2"/></fixed></tendon></mujoco>"""
SLIDE = """<mujoco><option timestep="0.001"/><worldbody><body><joint name="slide" type="slide" axis="1 0 0"/>
  <geom type="box" size=".1 .1 .05" mass="95" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


def cart_pole() -> tuple[mujoco.MjModel, Slides]:
    model = mujoco.MjModel.from_xml_string(CART_POLE)
    return model, Slides.of(model, ("pole", "cart"))


@pytest.mark.parametrize(("xml", "names"), [(CART_POLE, ("pole", "cart")), (SLIDE, ("slide",))])
def test_the_model_moves_alike_in_other_units(xml, names):
    model = mujoco.MjModel.from_xml_string(xml)
    slides = Slides.of(model, names)
    counted = slides.model_as_hinges(model)
    of = [model.jnt_dofadr[model.joint(name).id] for name in names]
    motion = np.array([[0.7, 0.3], [1.2, 0.5], [-2.0, 0.9]])[:, -len(names) :]
    torque, went = [], []
    for each, arm in ((model, np.ones(len(names))), (counted, slides.arm_m)):
        data = mujoco.MjData(each)
        data.qpos[of], data.qvel[of], data.qacc[of] = motion / arm
        mujoco.mj_inverse(each, data)
        torque.append(data.qfrc_inverse[of] / arm)
        data = mujoco.MjData(each)
        data.qpos[of], data.qvel[of] = motion[:2] / arm
        for _ in range(300):
            data.qfrc_applied[of] = np.array([0.2, 3.0])[-len(names) :] * arm
            mujoco.mj_step(each, data)
        went.append(data.qpos[of] * arm)
    assert torque[1] == pytest.approx(torque[0], rel=1e-9)
    assert went[1] == pytest.approx(went[0], rel=1e-6)
    assert counted.jnt_range == pytest.approx(model.jnt_range / np.where(slides.slide, 0.1, 1.0)[np.argsort(of)][:, None])


def test_a_recording_and_its_controller_are_counted_alike():
    _, slides = cart_pole()
    rng = np.random.default_rng(3)
    position, velocity, target = rng.standard_normal((3, 5, 2))
    gains = [np.full((5, 2), each) for each in (30.0, 2.0, 8.0, 0.1, 0.5, 1.0)]
    law = Feedback(target, *gains)
    joints = JointSignals(
        ("pole", "cart"), position, velocity, commanded_torque_nm=law.torque_nm(position, velocity), feedback=law
    )
    counted = slides.as_hinges(Recording("run", "run.csv", 0.01, np.arange(5) * 0.01, joints)).joints
    assert counted is not None and counted.feedback is not None and counted.velocity_rad_s is not None
    assert counted.position_rad[:, 0] == pytest.approx(position[:, 0])
    assert counted.position_rad[:, 1] == pytest.approx(10.0 * position[:, 1])
    assert counted.measured_torque_nm is None
    again = counted.feedback.torque_nm(counted.position_rad, counted.velocity_rad_s)
    assert counted.commanded_torque_nm == pytest.approx(again)
    assert again == pytest.approx(law.torque_nm(position, velocity) * [1.0, 0.1])


def told(*causes: Cause) -> Verdict:
    held_out = HeldOut("error", "rad", 2.0, 1.0, 0.1, 0.5, (0.4, 0.6), 100)
    seen = EffectJudged("coulomb_friction", Told.EXCLUDED, 0.2, "N m")
    return Verdict(VerdictKind.NAMED, "", causes=causes, extended=causes, held_out=held_out, effects=(seen,))


def test_causes_of_slides_are_told_in_newtons_and_metres():
    model, slides = cart_pole()
    pole = Cause("coulomb_friction", "torque_nm", "pole", 0.5, "N m", (0.4, 0.6))
    cart = replace(pole, where="cart", value=2.0, interval_90=(1.5, 2.5))
    damping = Cause("viscous_friction", "damping_nm_s_rad", "cart", 2.0, "N m s/rad", (1.0, 3.0))
    verdict = slides.in_metres(told(pole, cart, damping))
    assert verdict.causes == verdict.extended
    assert verdict.causes[0] == pole
    assert verdict.causes[1] == replace(cart, value=20.0, unit="N", interval_90=(15.0, 25.0))
    assert (verdict.causes[2].value, verdict.causes[2].unit) == (pytest.approx(200.0), "N s/m")
    assert verdict.effects[0].unit == "N m"  # of both kinds
    assert verdict.held_out is not None and "0.1 m of a slide count as 1 rad" in verdict.held_out.metric
    alone = Slides.of(model, ("cart",)).in_metres(told(replace(cart, where="all joints")))
    assert (alone.causes[0].value, alone.causes[0].unit) == (pytest.approx(20.0), "N")
    assert (alone.effects[0].above, alone.effects[0].unit) == (pytest.approx(2.0), "N")


def test_hinges_stay_as_they_are():
    model, _ = cart_pole()
    hinge = told(Cause("coulomb_friction", "torque_nm", "pole", 0.5, "N m", (0.4, 0.6)))
    assert Slides.of(model, ("pole",)).in_metres(hinge) is hinge


def test_values_to_start_from_are_counted_alike():
    _, slides = cart_pole()
    nominal = {"viscous_friction.damping_nm_s_rad": np.array([0.01, 200.0]), "gravity.offset_m_s2": np.array([0.0, 0.0, 0.1])}
    counted = slides.values_as_hinges(nominal)
    assert counted["viscous_friction.damping_nm_s_rad"] == pytest.approx([0.01, 2.0])
    assert counted["gravity.offset_m_s2"] == pytest.approx([0.0, 0.0, 0.1])
    cogging = slides.values_as_hinges({"cogging.phase_rad": np.array([1.0, 1.0])})
    assert cogging["cogging.phase_rad"] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    ("distance_rad", "is_slide", "said"), [(0.1432, False, "140 mrad"), (0.1432, True, "14 mm"), (0.00169, True, "0.17 mm")]
)
def test_distances_are_told_in_the_units_of_their_joint(distance_rad, is_slide, said):
    assert told_distance(distance_rad, is_slide=is_slide) == said


def test_torques_speeds_and_ranges_are_told_in_the_units_of_their_joint():
    assert [told_torque(0.0213, is_slide=each) for each in (False, True)] == ["0.021 N m", "0.21 N"]
    assert [told_speed(0.3, is_slide=each) for each in (False, True)] == ["0.3 rad/s", "0.03 m/s"]
    assert [told_range(-1.5, 2.0, is_slide=each) for each in (False, True)] == ["-1.5 to 2 rad", "-0.15 to 0.2 m"]
