"""Slides are studied as if they were hinges with an arm of a decimetre, and their causes told in newtons and metres again.

What a study takes to be slow, small or near an end is said in radians, and how large a cause may be in N m. Counted in metres a
slide of a laboratory is slow and stiff, and its friction by speed beyond what is asked for. In decimetres it is like a hinge.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.joint_effects import TURNS_OF_MOTORS
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import ARM_M
from sim_backend.reality_gap.verdict import Cause, EffectJudged, HeldOut, Verdict

_AS_OF_SLIDE: Mapping[str, tuple[str, int]] = {
    "rad": ("m", 1),
    "rad/s": ("m/s", 1),
    "1/rad": ("1/m", -1),
    "N m": ("N", -1),
    "N m s/rad": ("N s/m", -2),
    "N m/rad": ("N/m", -2),
    "kg m^2": ("kg", -2),
    "K/(N m)^2": ("K/N^2", 2),
}
"""By the unit of a joint's parameter: its unit at a slide, and the power of the arm that a value is multiplied by."""


@dataclass(frozen=True)
class Slides:
    """Which of k joints slide.

    Attributes:
        names: of the joints.
        slide: which of them slide, shape (k,).
    """

    names: tuple[str, ...]
    slide: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, names: Sequence[str]) -> "Slides":
        """Those of a model's joints that were recorded."""
        is_slide = [int(model.jnt_type[model.joint(name).id]) == int(mujoco.mjtJoint.mjJNT_SLIDE) for name in names]
        return cls(tuple(names), np.array(is_slide, bool))

    @property
    def arm_m(self) -> np.ndarray:
        """Shape (k,); 1 for hinges, which stay as they are."""
        return np.where(self.slide, ARM_M, 1.0)

    def model_as_hinges(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """A copy whose slides move by an arm for each unit of their coordinate: the same motion, in other units."""
        copy = mujoco.MjModel.__copy__(model)
        for name, arm in zip(self.names, self.arm_m, strict=True):
            joint = copy.joint(name).id
            q, dof = int(copy.jnt_qposadr[joint]), int(copy.jnt_dofadr[joint])
            copy.jnt_axis[joint] *= arm
            copy.jnt_range[joint] /= arm
            copy.qpos0[q] /= arm
            copy.qpos_spring[q] /= arm
            copy.jnt_stiffness[joint] *= arm**2
            copy.dof_damping[dof] *= arm**2
            copy.dof_armature[dof] *= arm**2
            copy.dof_frictionloss[dof] *= arm
            pulls = (copy.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT)) & (copy.wrap_objid == joint)
            copy.wrap_prm[pulls] *= arm
        # Of bodies that hang on nothing else MuJoCo takes the mass itself for the inertia.
        copy.body_simple[:], copy.dof_simplenum[:] = 0, 0
        mujoco.mj_setConst(copy, mujoco.MjData(copy))
        return copy

    def as_hinges(self, recording: Recording) -> Recording:
        """A recording of these joints in the units of :meth:`model_as_hinges`."""
        joints, arm = recording.joints, self.arm_m
        assert joints is not None
        lengths = ("position_rad", "velocity_rad_s", "position_target_rad", "encoder_step_rad")
        forces = ("commanded_torque_nm", "measured_torque_nm", "desired_torque_nm")
        changed = {name: own / arm for name in lengths if (own := getattr(joints, name)) is not None}
        changed |= {name: own * arm for name in forces if (own := getattr(joints, name)) is not None}
        feedback = None if joints.feedback is None else _feedback_as_hinges(joints.feedback, arm)
        return replace(recording, joints=replace(joints, **changed, feedback=feedback))

    def values_as_hinges(self, nominal: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Values by parameter, those of joints in the units of :meth:`model_as_hinges`."""
        return {key: value / self._by(key) if PARAMETERS[key].scope is Scope.JOINT else value for key, value in nominal.items()}

    def in_metres(self, verdict: Verdict) -> Verdict:
        """A verdict on the joints as hinges with what it says of slides in N and m, and the rest explained."""
        if not self.slide.any():
            return verdict
        causes, extended = tuple(map(self._cause, verdict.causes)), tuple(map(self._cause, verdict.extended))
        held_out = None if verdict.held_out is None else self._held_out(verdict.held_out)
        return replace(verdict, causes=causes, extended=extended, held_out=held_out, effects=self._effects(verdict))

    def _by(self, key: str) -> np.ndarray:
        """What values of a joint's parameter are multiplied by to be told of slides, shape (k,)."""
        power = 0 if key in TURNS_OF_MOTORS else _AS_OF_SLIDE.get(PARAMETERS[key].unit, ("", 0))[1]
        return self.arm_m**power

    def _cause(self, cause: Cause) -> Cause:
        slides = self.slide[[self.names.index(cause.where)]] if cause.where in self.names else self.slide
        key = f"{cause.effect}.{cause.parameter}"
        if not slides.all() or key in TURNS_OF_MOTORS or cause.unit not in _AS_OF_SLIDE:
            return cause
        unit, power = _AS_OF_SLIDE[cause.unit]
        low, high = cause.interval_90
        return replace(cause, value=cause.value * ARM_M**power, unit=unit, interval_90=(low * ARM_M**power, high * ARM_M**power))

    def _held_out(self, told: HeldOut) -> HeldOut:
        own = f"{told.metric}; {ARM_M:g} m of a slide count as 1 rad, {1 / ARM_M:g} N as 1 N m, here and in the plots"
        return replace(told, metric=own)

    def _effects(self, verdict: Verdict) -> tuple[EffectJudged, ...]:
        if not self.slide.all():
            return verdict.effects
        told = []
        for each in verdict.effects:
            unit, power = _AS_OF_SLIDE.get(each.unit, (each.unit, 0))
            above = None if each.above is None else each.above * ARM_M**power
            told.append(replace(each, above=above, unit=unit))
        return tuple(told)


def told_distance(distance_rad: float, *, is_slide: bool, digits: int = 2) -> str:
    """How far a joint went, to some digits: mrad of a hinge, mm of a slide that is counted as one."""
    size = 1e3 * distance_rad * (ARM_M if is_slide else 1.0)
    return f"{float(f'{size:.{digits}g}'):g} {'mm' if is_slide else 'mrad'}"


def told_range(low_rad: float, high_rad: float, *, is_slide: bool) -> str:
    """From one position to another: rad of a hinge, m of a slide that is counted as one."""
    arm = ARM_M if is_slide else 1.0
    return f"{low_rad * arm:.3g} to {high_rad * arm:.3g} {'m' if is_slide else 'rad'}"


def told_torque(torque_nm: float, *, is_slide: bool) -> str:
    """A torque to two digits: N m of a hinge, N of a slide that is counted as one."""
    return f"{torque_nm / ARM_M:.2g} N" if is_slide else f"{torque_nm:.2g} N m"


def told_speed(speed_rad_s: float, *, is_slide: bool) -> str:
    """A speed: rad/s of a hinge, m/s of a slide that is counted as one."""
    return f"{speed_rad_s * ARM_M:.2g} m/s" if is_slide else f"{speed_rad_s:.2g} rad/s"


def _feedback_as_hinges(law: Feedback, arm: np.ndarray) -> Feedback:
    return Feedback(
        law.target_rad / arm,
        law.stiffness_nm_rad * arm**2,
        law.damping_nm_s_rad * arm**2,
        law.limit_nm * arm,
        law.back_emf_nm_s_rad * arm**2,
        law.desired_nm * arm,
        law.on_board,
    )
