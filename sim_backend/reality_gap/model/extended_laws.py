"""What motors and gears of an extended model do that MJCF cannot say, for any MuJoCo program: this file needs nothing else.

``trifarm gap study`` writes it beside ``extended-model.xml``, with the values in ``extended-laws.json``::

    import mujoco
    from extended_laws import Laws

    model = mujoco.MjModel.from_xml_path("extended-model.xml")
    data = mujoco.MjData(model)
    laws = Laws(model, "extended-laws.json")
    while data.time < 10.0:
        laws.apply(model, data, {"shoulder": 0.2})  # torques that are sent to the motors, N m
        mujoco.mj_step(model, data)

``apply`` takes the place of the model's actuators at the joints that it knows: torques go to ``qfrc_applied``, and friction that
depends on speed, direction or load moves the bound of MuJoCo's friction constraint, so that the solver decides what sticks.
Whoever computes torques of a position controller multiplies its stiffness by ``laws.position_gain("shoulder")``, and whoever
computes them from a motor's voltage the torque that its own voltage takes by ``laws.own_voltage("shoulder")``. Of joints whose
controller runs beside the motor (``on_board`` of the file), as a servo's does, targets or voltages are late and not torques:
compute them from what was asked for ``laws.delay_s("shoulder")`` ago, which is 0 for all others.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

EFFECTS = (
    "action_delay",
    "torque_saturation",
    "thermal_derating",
    "torque_constant",
    "load_friction",
    "stribeck_friction",
    "directional_friction",
    "position_gain",
)
"""That have a law here."""
SOLREF, SOLIMP = (0.004, 1.0), (0.999, 0.9999, 0.001, 0.5, 2.0)
"""Of friction constraints: stiff, so that what sticks does not creep."""
DIRECTION_RAD_S = 0.02
"""Within this speed friction blends from one direction's to the other's."""
_LEAST_NM = 1e-9
_STAYS = "_cogging"
"""Actuators of such names have no input; they are part of the extended model."""


class Laws:
    """The laws of some joints, with what they remember of one simulation. Another simulation needs others, and its own model.

    Args:
        model: compiled from ``extended-model.xml`` for these laws alone: its friction constraints are set in every step.
        values: the file, or its content: by joint, by "effect.parameter".
        joints: more joints to drive, without any such law.
        on_board: more joints whose torques are those of now, since it is their targets that are late.

    Raises:
        KeyError: the model has no joint of a name.
    """

    def __init__(
        self,
        model: Any,
        values: str | Path | Mapping[str, Mapping[str, float]],
        joints: Sequence[str] = (),
        on_board: Sequence[str] = (),
    ) -> None:
        written = {"joints": values} if isinstance(values, Mapping) else json.loads(Path(values).read_text())
        known: dict[str, Mapping[str, float]] = {name: {} for name in joints} | dict(written["joints"])
        on_board = [*on_board, *written.get("on_board", [])]
        if strangers := [name for name in on_board if name not in known]:
            raise KeyError(f"{strangers[0]} is on board, and no joint of these laws")
        self._joints = {name: _Joint(model, name, own, on_board=name in on_board) for name, own in known.items()}

    def apply(self, model: Any, data: Any, sent_nm: Mapping[str, float]) -> None:
        """Set what acts in the next step.

        Args:
            model: as given; bounds of friction are written to its ``dof_frictionloss``.
            data: of the simulation, before ``mj_step``; ``qfrc_applied`` is written at the joints' degrees of freedom.
            sent_nm: torque that is sent to each motor now, N m; 0 for joints that are not named.
        """
        step_s = float(model.opt.timestep)
        for name, joint in self._joints.items():
            dof, arrived_nm = joint.dof, joint.arrived(sent_nm.get(name, 0.0), step_s)
            torque, bound = joint.step(arrived_nm, float(data.qvel[dof]), float(data.qfrc_bias[dof]), step_s)
            data.qfrc_applied[dof] = torque
            model.dof_frictionloss[dof] = max(_LEAST_NM, bound)

    def position_gain(self, joint: str) -> float:
        """What the stiffness of a joint's position controller is to be multiplied by: 1 where it is as its owner says."""
        return self._joints[joint].position_gain

    def delay_s(self, joint: str) -> float:
        """How late a joint's targets are, s; 0 where its torques are late instead."""
        return self._joints[joint].delay_s

    def own_voltage(self, joint: str) -> float:
        """What the voltage that a joint's motor makes itself is to be multiplied by, where torque is computed from a voltage."""
        return self._joints[joint].own_voltage


class _Joint:
    def __init__(self, model: Any, name: str, values: Mapping[str, float], *, on_board: bool) -> None:
        joint = model.joint(name)
        self.dof = int(joint.dofadr[0])
        self._v = dict(values)
        self.position_gain = self._v.get("position_gain.factor", 1.0)
        self.own_voltage = 1.0 + self._v.get("torque_constant.error", 0.0)
        late_s = self._v.get("action_delay.delay_s", 0.0)
        self.delay_s, self._torque_late_s = (late_s, 0.0) if on_board else (0.0, late_s)
        self._constant_nm = float(model.dof_frictionloss[self.dof])
        model.dof_solref[self.dof], model.dof_solimp[self.dof] = SOLREF, SOLIMP
        model.dof_frictionloss[self.dof] = max(self._constant_nm, _LEAST_NM)
        for i in range(model.nu):
            actuator = model.actuator(i)
            if int(model.actuator_trnid[i, 0]) == joint.id and not actuator.name.endswith(_STAYS):
                model.actuator_gainprm[i], model.actuator_biasprm[i] = 0.0, 0.0
        self._sent: list[float] = []
        self._rise_k = 0.0

    def arrived(self, sent_nm: float, step_s: float) -> float:
        """What was sent a delay ago, between steps as on a line."""
        late = self._torque_late_s / step_s
        whole = math.floor(late + 1e-9)
        share = late - whole if late - whole > 1e-6 else 0.0
        self._sent = [*self._sent, sent_nm][-whole - 2 :]
        newer, older = (self._sent[max(0, len(self._sent) - 1 - whole - more)] for more in (0, 1))
        return newer + share * (older - newer)

    def step(self, arrived_nm: float, velocity: float, load_nm: float, step_s: float) -> tuple[float, float]:
        """Torque at the joint and bound of its friction, N m."""
        v = self._v.get
        torque = _clipped(arrived_nm, v("torque_saturation.limit_nm", math.inf))
        if v("thermal_derating.loss_per_k", 0.0):
            heated = v("thermal_derating.rise_k_nm2", 0.0) * torque * torque
            self._rise_k += (1.0 - math.exp(-step_s / v("thermal_derating.time_constant_s", 1.0))) * (heated - self._rise_k)
        torque *= 1.0 + v("torque_constant.error", 0.0)
        torque *= max(0.0, 1.0 - v("thermal_derating.loss_per_k", 0.0) * self._rise_k)
        bound = self._constant_nm + v("load_friction.coefficient", 0.0) * abs(torque)
        bound += v("load_friction.external_coefficient", 0.0) * abs(load_nm)
        ratio = abs(velocity) / v("stribeck_friction.speed_rad_s", 1.0)
        bound += v("stribeck_friction.extra_nm", 0.0) * math.exp(-(ratio ** v("stribeck_friction.exponent", 2.0)))
        bound += v("directional_friction.difference_nm", 0.0) * math.tanh(velocity / DIRECTION_RAD_S)
        return torque, bound


def _clipped(torque_nm: float, limit_nm: float) -> float:
    return min(max(torque_nm, -limit_nm), limit_nm)
