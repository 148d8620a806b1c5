"""The laws that lie beside an extended model do what the tool's own rollouts do, and need nothing of this project."""

import json
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.model import extended_laws
from sim_backend.reality_gap.model.extended_laws import Laws
from sim_backend.reality_gap.model.files import LAWS, NATIVE, write_models
from sim_backend.reality_gap.model.mjcf import extend_mjcf
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.replay import simulated
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.forward import LONGEST_IN_LOOP_S, Forward, Windows
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

ARM = """
<mujoco><compiler angle="radian"/><worldbody>
 <body><joint name="shoulder" axis="0 1 0" armature="0.002" damping="0.01" frictionloss="0.03"/>
  <inertial pos="0 0 -0.1" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
  <body pos="0 0 -0.2"><joint name="elbow" axis="0 1 0" armature="0.001"/>
   <inertial pos="0 0 -0.1" mass="0.2" diaginertia="5e-4 5e-4 5e-4"/></body></body>
</worldbody><actuator><motor name="own" joint="shoulder"/></actuator></mujoco>
"""
STEP_S, SAMPLES = 0.004, 250
NAMES = ("shoulder", "elbow")
LAWS_OF_JOINTS = {
    "nothing": {},
    "load friction": {"load_friction.coefficient": 0.3, "load_friction.external_coefficient": 0.2},
    "stribeck": {"stribeck_friction.extra_nm": 0.05, "stribeck_friction.speed_rad_s": 0.3},
    "stribeck without a flat top": {
        "stribeck_friction.extra_nm": 0.1,
        "stribeck_friction.speed_rad_s": 0.3,
        "stribeck_friction.exponent": 1.0,
    },
    "direction": {"directional_friction.difference_nm": 0.02},
    "delay": {"action_delay.delay_s": 0.007},
    "saturation": {"torque_saturation.limit_nm": 0.3},
    "torque constant": {"torque_constant.error": -0.2},
    "heat": {"thermal_derating.loss_per_k": 0.02, "thermal_derating.rise_k_nm2": 900.0, "thermal_derating.time_constant_s": 2.0},
    "gain of the controller": {"position_gain.factor": 0.6},
}


def both_ways(values, native, laws, begin_rad=0.0, on_board=0.0, targets_behind=0):
    """Where a controller turns the arm: by the tool's own rollouts, and by a model with laws beside it; shape (s, 2) each."""
    at = STEP_S * np.arange(SAMPLES)
    target = begin_rad + np.stack([0.8 * np.sin(4.0 * at), 0.5 * np.sin(7.0 * at)], axis=1)
    target = np.vstack([np.repeat(target[:1], targets_behind, axis=0), target])[:SAMPLES]
    shape = np.ones((SAMPLES, 2))
    feedback = Feedback(target, 3.0 * shape, 0.02 * shape, np.inf * shape, 0.0 * shape, 0.0 * shape, on_board * shape)
    plant = Plant(mujoco.MjModel.from_xml_string(ARM), NAMES)
    own = plant.own_values | {"torque_saturation.limit_nm": np.full(2, 1e9)}
    state = JointState(2, own | {key: np.broadcast_to(value, 2).astype(float) for key, value in values.items()})
    begin, rest, none = np.full((1, 2), begin_rad), np.zeros((1, 2)), np.zeros((1, SAMPLES, 2))
    windows = Windows(STEP_S, none, begin, rest, none, Feedback.stacked([feedback]), np.zeros(1, int))
    forward = Forward(plant, STEP_S, longest_step_s=LONGEST_IN_LOOP_S)
    expected = forward.positions(windows, begin, rest, [state], np.zeros(1, int))[0]
    joints = JointSignals(NAMES, target, commanded_torque_nm=np.zeros_like(target), feedback=feedback)
    recording = Recording("made", "here", STEP_S, at, joints)
    return expected, simulated(recording, slice(0, SAMPLES), begin[0], rest[0], native, laws)


def test_where_a_controller_runs_beside_its_motor_targets_are_late_and_not_torques():
    model, late = mujoco.MjModel.from_xml_string(ARM), {"action_delay.delay_s": 8 * STEP_S}
    expected, found = both_ways(late, model, dict.fromkeys(NAMES, late), on_board=1.0)
    shifted = both_ways({}, model, {}, targets_behind=8)[0]
    of_torques = both_ways(late, model, dict.fromkeys(NAMES, late))[0]
    np.testing.assert_allclose(expected, shifted, atol=1e-9)
    assert np.abs(found - expected).max() < 3e-3 * np.abs(expected).max()
    assert np.abs(of_torques - expected).max() > 2e-2 * np.abs(expected).max()


@pytest.mark.parametrize("law", LAWS_OF_JOINTS)
def test_both_go_the_same_way(law):
    model = mujoco.MjModel.from_xml_string(ARM)
    expected, found = both_ways(LAWS_OF_JOINTS[law], model, dict.fromkeys(NAMES, LAWS_OF_JOINTS[law]))
    assert np.abs(expected).max() > 0.2
    assert np.abs(found - expected).max() < 3e-3 * np.abs(expected).max()
    if law != "nothing":
        without = both_ways(LAWS_OF_JOINTS[law], model, {})[1]
        assert np.abs(without - expected).max() > 1e-2 * np.abs(expected).max()


@pytest.mark.parametrize("begin_rad", [0.6, -0.6])
@pytest.mark.parametrize("joint", range(2), ids=NAMES)
def test_play_is_a_joint_of_its_own(joint, begin_rad):
    gap = np.zeros(2)
    gap[joint] = 0.05
    spec, missing = extend_mjcf(mujoco.MjSpec.from_string(ARM), [cause("backlash", "gap_rad", NAMES[joint], 0.05)])
    expected, found = both_ways({"backlash.gap_rad": gap}, spec.compile(), {}, begin_rad)
    without = both_ways({}, mujoco.MjModel.from_xml_string(ARM), {}, begin_rad)[1]
    assert not missing
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.1 * np.sqrt(np.mean((without - expected) ** 2))


def test_a_rotor_needs_a_body_of_its_own():
    body = '<body><joint name="a"/><joint name="b" axis="1 0 0"/><geom size="0.1"/></body>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    extended, missing = extend_mjcf(spec, [cause("backlash", "gap_rad", "a", 0.05)])
    assert len(extended.joints) == 2
    assert missing == ["backlash at a: its body has other joints, too, so that a cannot have a rotor of its own"]


def test_joints_on_board_are_told_by_the_file_and_have_late_targets(tmp_path):
    model, file = mujoco.MjModel.from_xml_string(ARM), tmp_path / "extended-laws.json"
    late = {name: {"action_delay.delay_s": 0.02} for name in NAMES}
    file.write_text(json.dumps({"joints": late, "on_board": [NAMES[0]]}))
    laws, data = Laws(model, file), mujoco.MjData(model)
    assert [laws.delay_s(name) for name in NAMES] == [0.02, 0.0]
    laws.apply(model, data, dict.fromkeys(NAMES, 0.0))
    laws.apply(model, data, dict.fromkeys(NAMES, 0.5))
    assert data.qfrc_applied[[int(model.joint(name).dofadr[0]) for name in NAMES]].tolist() == [0.5, 0.0]
    with pytest.raises(KeyError, match="sholder"):
        Laws(model, late, on_board=["sholder"])


def test_they_take_the_place_of_the_model_s_own_actuators():
    model = mujoco.MjModel.from_xml_string(ARM)
    data, laws = mujoco.MjData(model), Laws(model, {"shoulder": {"torque_constant.error": 1.0}})
    data.ctrl[0] = 100.0
    laws.apply(model, data, {"shoulder": 0.2})
    mujoco.mj_step(model, data)
    assert data.qfrc_actuator[0] == 0.0 and data.qfrc_applied[0] == pytest.approx(0.4)
    with pytest.raises(KeyError):
        Laws(model, {"wrist": {}})


def cause(effect, parameter, where, value):
    return Cause(effect, parameter, where, value, "", (value, value))


@pytest.mark.parametrize(("actuator", "is_missing"), [("motor", True), ("position", False)])
def test_late_targets_are_the_delay_of_an_actuator_that_has_targets(tmp_path, actuator, is_missing):
    (tmp_path / "arm.xml").write_text(ARM.replace("<motor ", f"<{actuator} "))
    late = cause("action_delay", "delay_s", "shoulder", 0.02)
    verdict = Verdict(verdict=VerdictKind.NAMED, summary="late", causes=(late,))
    write_models(verdict, "made", [], tmp_path, model=tmp_path / "arm.xml", on_board=["shoulder"])
    assert json.loads((tmp_path / LAWS).read_text())["on_board"] == ["shoulder"]
    delays = mujoco.MjModel.from_xml_path(str(tmp_path / NATIVE)).actuator_delay
    missing = tmp_path / "extended-model-missing.txt"
    assert (delays.max() == 0.0) == is_missing == missing.exists()
    assert not is_missing or "its targets are late" in missing.read_text()


def test_what_a_study_writes_runs_without_this_project(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    named = cause("load_friction", "coefficient", "elbow", 0.3)
    extended = (named, cause("viscous_friction", "damping_nm_s_rad", "elbow", 0.02))
    stated = (cause("load_friction", "coefficient", "elbow", 0.1), cause("action_delay", "delay_s", "shoulder", 0.002))
    verdict = Verdict(verdict=VerdictKind.NAMED, summary="friction", causes=(named,), extended=extended)
    written = write_models(verdict, "made", [], tmp_path, model=tmp_path / "arm.xml", stated=stated)
    assert {path.name for path in written} >= {NATIVE, LAWS, "extended_laws.py"}
    laws = json.loads((tmp_path / LAWS).read_text())["joints"]
    assert laws["elbow"]["load_friction.coefficient"] == 0.3 and laws["shoulder"] == {"action_delay.delay_s": 0.002}
    assert mujoco.MjModel.from_xml_path(str(tmp_path / NATIVE)).dof_damping.tolist() == [0.01, 0.02]
    program = extended_laws.__doc__.split("::", 1)[1].split("``apply``")[0]
    program = "\n".join(line[4:] for line in program.splitlines()).replace("10.0", "0.1")
    ran = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport sys\nassert not any('sim_backend' in name for name in sys.modules)"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
