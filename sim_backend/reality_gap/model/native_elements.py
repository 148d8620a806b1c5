"""MuJoCo's own elements that an effect needs, each written to a joint, body or geom of any specification.

A function here changes what its arguments name and returns what MuJoCo cannot say of it, or None.
"""

import math

import mujoco
import numpy as np

from sim_backend.effects.friction import SOLIMP, SOLREF

_JOINT_TRANSMISSIONS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_PASSIVE = int(mujoco.mjtCtrlInput.mjINPUT_NONE)
_LINEAR = 1  # interpolation of an actuator's history
_WHOLE_STEP = 1e-6  # a delay is a whole number of steps if it misses it by less, in steps

PLAY_SUFFIX = "_gear_play"
"""What the names of joints end in that are the play of another."""


def actuators_of(spec: mujoco.MjSpec, joint: str) -> list:
    """The actuators that take controls and act on a joint."""
    return [a for a in spec.actuators if a.target == joint and a.trntype in _JOINT_TRANSMISSIONS and a.ctrlspec != _PASSIVE]


def in_units(joint: mujoco.MjsJoint, position: float) -> float:
    """A position of a joint, rad or m, in the units of its specification: degrees for hinges unless its compiler says other."""
    is_turned = joint.type == mujoco.mjtJoint.mjJNT_HINGE and joint.compiler.degree
    return math.degrees(position) if is_turned else position


def add_spring(joint: mujoco.MjsJoint, stiffness_nm_rad: float, reference_rad: float) -> None:
    """A spring of the joint beside the one that it has: the two of them are one, whose rest lies between theirs."""
    own, added = joint.stiffness[0], stiffness_nm_rad
    rest = own * joint.springref + added * in_units(joint, reference_rad)
    joint.stiffness[0] = own + added
    joint.springref = rest / (own + added) if own + added > 0.0 else joint.springref


def add_play(joint: mujoco.MjsJoint, gap_rad: float, rotor_inertia_kg_m2: float) -> str | None:
    """A second joint of the same body and axis, as wide as the play: the first one is then the rotor, where its encoder sits.

    Where the joint has no ``armature``, which is the rotor's inertia, it gets one.
    """
    body = joint.parent
    if len(body.joints) > 1:
        return f"its body has other joints, too, so that {joint.name} cannot have a rotor of its own"
    joint.armature = joint.armature or rotor_inertia_kg_m2
    half = in_units(joint, 0.5 * gap_rad)
    body.add_joint(
        name=f"{joint.name}{PLAY_SUFFIX}",
        type=joint.type,
        axis=joint.axis,
        pos=joint.pos,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[-half, half],
        solref_limit=SOLREF,
        solimp_limit=SOLIMP,
    )
    return None


def delay_action(spec: mujoco.MjSpec, joint: str, delay_s: float) -> str | None:
    """``delay`` with linear interpolation: a fraction of a step acts as the mean over the step, as the catalogue has it.

    MuJoCo reads its history before it writes to it, so that a delay below one step cannot be had; it becomes a first-order
    lag of the same mean delay.
    """
    step_s: float = spec.option.timestep
    steps, driving = delay_s / step_s, actuators_of(spec, joint)
    if not driving:
        return f"no actuator drives {joint}"
    steps = float(round(steps)) if abs(steps - round(steps)) < _WHOLE_STEP else steps
    if 0.0 < steps < 1.0:
        if any(actuator.dyntype != mujoco.mjtDyn.mjDYN_NONE for actuator in driving):
            return f"a delay of {delay_s * 1e3:g} ms is shorter than a step"
        for actuator in driving:
            actuator.dyntype, actuator.actearly = mujoco.mjtDyn.mjDYN_FILTEREXACT, True
            actuator.dynprm[0] = step_s / math.log((1.0 + steps) / steps)
        return f"a delay of {delay_s * 1e3:g} ms is shorter than a step, written as a first-order lag of the same mean delay"
    for actuator in driving if steps > 0.0 else ():
        actuator.delay, actuator.nsample, actuator.interp = steps * step_s, math.floor(steps) + 2, _LINEAR
    return None


def scale_torque(spec: mujoco.MjSpec, joint: str, error: float) -> str | None:
    """Gain, bias and limit of force times 1 + ``error``."""
    driving = actuators_of(spec, joint)
    for actuator in driving:
        if not _is_linear(actuator):
            return f"actuator {actuator.name} of {joint} has no linear law"
    for actuator in driving:
        for name in ("gainprm", "biasprm", "forcerange"):
            values = np.array(getattr(actuator, name))
            values[:3] *= 1.0 + error
            setattr(actuator, name, values)
    return None if driving else f"no actuator drives {joint}"


def _is_linear(actuator: mujoco.MjsActuator) -> bool:
    gains = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE)
    return actuator.gaintype in gains and actuator.biastype in (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)


def saturate_torque(spec: mujoco.MjSpec, joint: str, limit_nm: float) -> str | None:
    """``forcerange`` of the actuators, each with a gear of one; to be set before the torque is scaled."""
    driving = actuators_of(spec, joint)
    if any(actuator.gear[0] != 1.0 for actuator in driving):
        return f"an actuator of {joint} has a gear, so that its force is not the joint's torque"
    for actuator in driving:
        actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit_nm, limit_nm]
    return None if driving else f"no actuator drives {joint}"


def add_cogging(spec: mujoco.MjSpec, joint: str, amplitude_nm: float, cycles_per_rad: float, phase_rad: float) -> None:
    """A ``dcmotor`` without input and electricity, of which only the cogging is left; its poles need not be whole."""
    motor = spec.add_actuator(name=f"{joint}_cogging", target=joint)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    cogging = [amplitude_nm, 2.0 * math.pi * cycles_per_rad, phase_rad]
    motor.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, cogging=cogging, ctrlspec=_PASSIVE)


def offset_encoder(spec: mujoco.MjSpec, joint: str, offset_rad: float) -> None:
    """``ref``: the joint's position in the model is then what its encoder reports, and everything at the joint moves along.

    To be done after cogging, limits and stiffness.
    """
    found = spec.joint(joint)
    offset = in_units(found, offset_rad)
    found.ref, found.springref = found.ref + offset, found.springref + offset
    if found.range[0] < found.range[1]:
        found.range = np.asarray(found.range) + offset
    for actuator in spec.actuators:
        if actuator.target == joint and actuator.ctrlspec == _PASSIVE:
            values = np.array(actuator.biasprm)
            values[2] -= values[1] * offset_rad
            actuator.biasprm = values


def add_noise(spec: mujoco.MjSpec, joint: str, position_rad: float, velocity_rad_s: float, torque_nm: float) -> str:
    """Sensors that state their noise; MuJoCo keeps the number and adds nothing."""
    for kind, std in (("JOINTPOS", position_rad), ("JOINTVEL", velocity_rad_s), ("JOINTACTFRC", torque_nm)):
        sensor = spec.add_sensor(name=f"{joint}_{kind.lower()}", type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"))
        sensor.objtype, sensor.objname, sensor.noise = mujoco.mjtObj.mjOBJ_JOINT, joint, std
    return "sensors state the noise, but MuJoCo does not add it"


def scale_mass(body: mujoco.MjsBody, factor: float) -> None:
    """Mass and inertia of one body."""
    if body.explicitinertial:
        body.mass, body.inertia = body.mass * factor, np.asarray(body.inertia) * factor
        body.fullinertia = np.asarray(body.fullinertia) * factor
        return
    for geom in body.geoms:
        if math.isnan(geom.mass):
            geom.density = geom.density * factor
        else:
            geom.mass = geom.mass * factor


def set_friction(spec: mujoco.MjSpec, geoms: list, coefficient: float) -> None:
    """Sliding friction of geoms in all of their contacts: theirs comes first, or MuJoCo would take the larger of two."""
    _come_first(spec, geoms)
    for geom in geoms:
        geom.friction[0] = coefficient
    for pair in _pairs_of(spec, geoms):
        pair.friction[:2] = coefficient


def set_contact(spec: mujoco.MjSpec, geoms: list, time_constant_s: float, damping_ratio: float) -> None:
    """``solref`` of geoms in all of their contacts."""
    _come_first(spec, geoms)
    for thing in (*geoms, *_pairs_of(spec, geoms)):
        thing.solref = [time_constant_s, damping_ratio]


def _come_first(spec: mujoco.MjSpec, geoms: list) -> None:
    own = {geom.id for geom in geoms}
    others = max((geom.priority for geom in spec.geoms if geom.id not in own), default=-1)
    for geom in geoms:
        geom.priority = max(geom.priority, others + 1)


def _pairs_of(spec: mujoco.MjSpec, geoms: list) -> list:
    names = {geom.name for geom in geoms} - {""}
    return [pair for pair in spec.pairs if pair.geomname1 in names or pair.geomname2 in names]
