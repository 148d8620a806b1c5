"""The extended model as plain MJCF: MuJoCo alone moves as the driver does, and says what it cannot."""

import json
from dataclasses import asdict

import mujoco
import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.estimate import DataFile, Estimate, Interval, Provenance
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.model.mjcf import extend_mjcf, mjcf_text, robot_mjcf, write_mjcf
from sim_backend.reality_gap.model.native_laws import REASONS, reason
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger import constants as c
from tests.unit.sim_backend.effects.rig import MID_RAD, SimulatedDriver, present, start_of

STEPS = 400
EXACT_RAD = 1e-9
BY_JOINT = np.arange(9)[None]


def torques(steps=STEPS) -> np.ndarray:
    """Smooth swings with steps on top, of shape (steps, 9), N m; fingers run into their limits and into each other."""
    rng, time_s = np.random.default_rng(3), np.arange(steps)[:, None] * 1e-3
    swing = 0.12 * np.sin(2 * np.pi * (1 + rng.random(9)) * time_s + 6 * rng.random(9))
    return swing + 0.02 * rng.standard_normal((steps // 10, 9)).repeat(10, axis=0)


def with_driver(physics, torque_nm) -> np.ndarray:
    driver = SimulatedDriver(safety=False, physics=physics)
    driver.reset(start_of())
    return driver.advance_torques(torque_nm[None].copy()).joint_position_rad[0]


def with_mujoco_alone(path, torque_nm, offset_rad) -> np.ndarray:
    """Plain steps of the model as loaded from its file; its controls are not touched by a callback."""
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.nuserdata == 0
    data = mujoco.MjData(model)
    data.qpos[:9], data.qpos[9:] = MID_RAD + offset_rad, [0.0, 0.0, 0.0325, 1.0, 0.0, 0.0, 0.0]
    position = np.empty((len(torque_nm), 9))
    for row, torque in zip(position, torque_nm, strict=True):
        row[:] = data.qpos[:9]
        data.ctrl[:] = torque
        mujoco.mj_step(model, data)
    return position


def apart_rad(values, tmp_path, torque_nm) -> tuple[float, list[str]]:
    physics = Physics.of(1, values)
    spec, missing = robot_mjcf(physics)
    path = tmp_path / "extended.xml"
    path.write_text(mjcf_text(spec))
    offset = physics.value("encoder_offset.offset_rad")[0]
    expected = with_driver(physics, torque_nm)
    assert np.ptp(expected, axis=0).max() > 0.3
    return float(np.abs(with_mujoco_alone(path, torque_nm, offset) - expected).max()), missing


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({}, id="nominal"),
        pytest.param({"coulomb_friction.torque_nm": 0.03123456789}, id="coulomb"),
        pytest.param({"viscous_friction.damping_nm_s_rad": 0.01234567891}, id="viscous"),
        pytest.param({"action_delay.delay_s": 0.003}, id="delay"),
        pytest.param({"action_delay.delay_s": 0.001 + 0.0026 * BY_JOINT}, id="delays between steps"),
        pytest.param({"torque_constant.error": 0.05 * (BY_JOINT - 4)}, id="torque constant"),
        pytest.param({"torque_saturation.limit_nm": 0.07, "torque_constant.error": -0.1}, id="saturation before constant"),
        pytest.param(
            {"cogging.amplitude_nm": 0.01, "cogging.phase_rad": 0.3, "encoder_offset.offset_rad": 0.02}, id="cogging and encoder"
        ),
        pytest.param(
            {
                "encoder_offset.offset_rad": 0.005 * (BY_JOINT - 4),
                "joint_stiffness.stiffness_nm_rad": 0.0212345,
                "joint_stiffness.reference_rad": 0.3,
                "joint_limits.upper_rad": -0.2,
            },
            id="encoder, springs and limits",
        ),
        pytest.param(
            {
                "link_mass.factor": 1.0712345678,
                "rotor_inertia.armature_kg_m2": 4.3e-4 / 1.1,
                "table_tilt.roll_rad": 0.0123,
                "gravity.offset_m_s2": [[0.0, 0.1, 0.2]],
            },
            id="body",
        ),
        pytest.param({"stuck_joint.holding_torque_nm": 5.0 * (BY_JOINT == 2), "coulomb_friction.torque_nm": 0.02}, id="stuck"),
    ],
)
def test_mujoco_alone_moves_as_the_driver_does(values, tmp_path):
    apart, missing = apart_rad(values, tmp_path, torques())
    assert missing == []
    assert apart < EXACT_RAD


def test_a_delay_below_a_step_is_a_lag_of_the_same_mean(tmp_path):
    torque = torques(100)
    apart, missing = apart_rad({"action_delay.delay_s": 0.0004}, tmp_path, torque)
    without = np.abs(
        with_driver(Physics.nominal(), torque) - with_driver(Physics.of(1, {"action_delay.delay_s": 0.0004}), torque)
    )
    assert missing == [
        "action_delay: a delay of 0.4 ms is shorter than a step, written as a first-order lag of the same mean delay"
    ]
    assert apart < 0.1 * without.max()


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=list(CATALOGUE))
def test_every_effect_is_in_the_model_or_listed_with_a_reason(effect):
    nominal = robot_mjcf(Physics.nominal())[0].to_xml()
    spec, missing = robot_mjcf(Physics.of(1, present(effect)))
    text = mjcf_text(spec)
    if effect.acts is Acts.MODEL:
        assert missing == []
        assert text != mjcf_text(robot_mjcf(Physics.nominal())[0])
    elif reason(effect.name):
        assert [line.partition(":")[0] for line in missing] == [effect.name]
        assert missing[0] in text
    else:
        assert spec.to_xml() != nominal
    assert not (effect.name in REASONS and effect.acts is Acts.MODEL)
    mujoco.MjModel.from_xml_string(text)


FOREIGN = """<mujoco><option timestep="0.002"/>
<worldbody><geom name="floor" type="plane" size="1 1 .1" pos="0 0 -1"/>
<body name="arm"><joint name="a" axis="0 1 0" damping="0.5"/><geom name="rod" type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/>
<body name="fore" pos="0 0 -.3"><joint name="b" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass="0.3"/>
</body></body><body name="block"><freejoint/><geom name="block" type="box" size=".05 .05 .05"/></body></worldbody>
<actuator><position name="servo" joint="a" kp="20" kv="1"/><motor name="motor" joint="b"/></actuator></mujoco>"""


def cause(effect, parameter, where, value):
    return Cause(effect, parameter, where, value, "", (value, value))


def test_any_model_is_extended():
    spec = mujoco.MjSpec.from_string(FOREIGN)
    before = spec.compile()
    extended, missing = extend_mjcf(
        spec,
        [
            cause("coulomb_friction", "torque_nm", "all joints", 0.251),
            cause("viscous_friction", "damping_nm_s_rad", "a", 0.07),
            cause("rotor_inertia", "armature_kg_m2", "b", 1.0 / 30000),
            cause("joint_stiffness", "stiffness_nm_rad", "b", 0.2),
            cause("joint_stiffness", "reference_rad", "b", -0.4),
            cause("link_mass", "factor", "a", 1.1),
            cause("link_mass", "factor", "fore", 0.9),
            cause("gravity", "offset_m_s2", "z", 0.19),
            cause("action_delay", "delay_s", "b", 0.005),
            cause("torque_constant", "error", "a", -0.1),
            cause("torque_constant", "error", "b", 0.2),
            cause("torque_saturation", "limit_nm", "b", 2.0),
            cause("table_friction", "coefficient", "block", 0.18),
            cause("contact_stiffness", "time_constant_s", "block", 0.008),
            cause("encoder_offset", "offset_rad", "b", 0.03),
            cause("fingertip_friction", "coefficient", "block", 0.5),
        ],
    )
    assert sorted(line.partition(":")[0] for line in missing) == ["fingertip_friction at block"]
    model = mujoco.MjModel.from_xml_string(mjcf_text(extended))
    assert model.dof_frictionloss[:2].tolist() == [0.251, 0.251]
    assert model.dof_damping[0] == 0.07
    assert model.dof_armature[1] == 1.0 / 30000
    assert (model.jnt_stiffness[1], model.qpos_spring[1], model.qpos0[1]) == pytest.approx((0.2, -0.4 + 0.03, 0.03), rel=1e-15)
    assert model.body_mass[1:3] == pytest.approx(before.body_mass[1:3] * [1.1, 0.9])
    assert model.opt.gravity[2] == pytest.approx(-9.62)
    assert (model.actuator_delay[1], model.actuator_history[1].tolist()) == (0.005, [4, 1])
    assert model.actuator_gainprm[:, 0] == pytest.approx([18.0, 1.2])
    assert model.actuator_biasprm[0, :3] == pytest.approx([0.0, -18.0, -0.9])
    assert model.actuator_forcerange[1] == pytest.approx([-2.4, 2.4])
    data = mujoco.MjData(model)
    data.qpos[4] = -0.9501  # the block, on the floor
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    assert (data.contact.friction[0][0], data.contact.solref[0][0]) == (0.18, 0.008)
    assert spec.compile().dof_damping[0] == 0.5, "the model that was given has changed"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (cause("coulomb_friction", "torque_nm", "elbow", 0.1), "no hinge or slide 'elbow'; choose from a, b"),
        (cause("link_mass", "factor", "leg", 0.9), "no body or joint 'leg'; its bodies are arm, fore, block"),
        (cause("table_friction", "coefficient", "table", 0.1), "no geom 'table'"),
        (cause("gravity", "offset_m_s2", "up", 0.1), "choose from x, y, z"),
    ],
)
def test_places_that_the_model_does_not_have(wrong, message):
    with pytest.raises(ValueError, match=message):
        extend_mjcf(mujoco.MjSpec.from_string(FOREIGN), [wrong])


def test_texts_with_any_characters_stay():
    spec = mujoco.MjSpec.from_string(FOREIGN)
    spec.add_text(name="note", data='the model\'s "own" <words> & more')
    again = mujoco.MjSpec.from_string(mjcf_text(spec))
    assert again.texts[0].data == 'the model\'s "own" <words> & more'


def test_the_file_says_where_its_values_come_from(tmp_path):
    said = Provenance("robot-1", "2026-11-21T00:00:00+00:00", "trifarm 0.1.0", "named", (DataFile("a 'b'.mcap", "0" * 64),))
    estimate = Estimate(said, (Interval("action_delay.delay_s", "all joints", 0.002, 0.004),))
    spec, _ = robot_mjcf(Physics.of(1, {"action_delay.delay_s": 0.003}))
    write_mjcf(spec, tmp_path / "extended.xml", estimate)
    texts = {text.name: text.data for text in mujoco.MjSpec.from_file(str(tmp_path / "extended.xml")).texts}
    assert json.loads(texts["provenance"]) == json.loads(json.dumps(asdict(estimate)))
    assert not spec.texts, "the specification that was given has changed"


def test_what_acts_on_no_actuator_is_said():
    text = FOREIGN.replace('<motor name="motor" joint="b"/>', "")
    _, missing = extend_mjcf(mujoco.MjSpec.from_string(text), [cause("action_delay", "delay_s", "b", 0.004)])
    assert missing == ["action_delay at b: no actuator drives b"]


def test_the_constants_are_those_of_the_platform():
    spec, _ = robot_mjcf(Physics.nominal())
    assert [actuator.name for actuator in spec.actuators] == list(c.JOINT_NAMES)


def test_a_spring_is_put_beside_the_one_that_the_model_has():
    spec = mujoco.MjSpec.from_string(FOREIGN)
    spec.joint("a").stiffness[0], spec.joint("a").springref = 0.3, 20.0  # degrees
    causes = [cause("joint_stiffness", "stiffness_nm_rad", "a", 0.1), cause("joint_stiffness", "reference_rad", "a", -0.5)]
    model = extend_mjcf(spec, causes)[0].compile()
    assert model.jnt_stiffness[0] == pytest.approx(0.4)
    assert model.qpos_spring[0] == pytest.approx((0.3 * np.radians(20.0) - 0.1 * 0.5) / 0.4)
