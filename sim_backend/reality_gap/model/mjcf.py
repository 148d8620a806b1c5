"""The extended model as plain MJCF of everything that MuJoCo has natively, and a list of what it has not.

The text loads with ``mujoco.MjModel.from_xml_path`` and nothing of this project: the laws are those of ``native_laws.py``, and
what is missing stands in it, too, as ``<custom><text name="not_expressed">``.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.driver.robot_model import robot_spec
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts, Effect
from sim_backend.effects.estimate import Estimate
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.model import native_laws as laws
from sim_backend.reality_gap.model.exact_mjcf import exact_numbers
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape


def robot_mjcf(
    physics: Physics, *, shape: Shape = CUBE, physics_step_s: float = c.PHYSICS_STEP_S
) -> tuple[mujoco.MjSpec, list[str]]:
    """Specification of a TriFinger with its effects, and sentences that say which of them it does not have, and why.

    Its controls are applied torques, N m, in the order of ``constants.JOINT_NAMES``; the safety pipeline is not in it.

    Args:
        physics: effects of one robot (n = 1).
        shape: the object in the arena.
        physics_step_s: integration step, s; delays hold for this one.

    Raises:
        ValueError: an effect of the catalogue has neither a law nor a reason.
    """
    spec, missing = robot_spec(physics, shape=shape, physics_step_s=physics_step_s), []
    for name, effect in _in_order(name for name in CATALOGUE if physics.has(name)):
        if effect.acts is Acts.MODEL:
            continue
        values = {p.name: physics.value(effect.key(p))[0] for p in effect.all_parameters}
        why, absent = laws.reason(name), effect.parameters[0].absent
        if why is None and name not in laws.LAWS:
            raise ValueError(f"effect {name} has neither a law here nor a reason in native_laws.REASONS")
        if why is None:
            first = np.broadcast_to(values[effect.parameters[0].name], 9)
            own = [{key: float(np.broadcast_to(value, 9)[j]) for key, value in values.items()} for j in range(9)]
            found = (
                laws.LAWS[name](spec, c.JOINT_NAMES[j], own[j])
                for j in range(9)
                if first[j] != absent or any(own[j][p.name] != p.absent for p in effect.parameters)
            )
            why = "; ".join(dict.fromkeys(filter(None, found)))
        if why:
            missing.append(f"{name}: {why}")
    _state(spec, missing)
    return spec, missing


def extend_mjcf(spec: mujoco.MjSpec, causes: Iterable[Cause]) -> tuple[mujoco.MjSpec, list[str]]:
    """Any MuJoCo model with the causes that a study accepted, and sentences that say which of them it does not have, and why.

    Values replace those of the model where the catalogue's parameter is absolute (friction, damping, inertia), a spring is put
    beside the model's own, and a factor, an error or an offset multiplies or adds.

    Args:
        spec: the model; it is not changed.
        causes: ``where`` names a joint, or a body for its mass; ``all joints`` are all hinges and slides; for friction and
            stiffness of contacts it names a geom or a body with geoms, for gravity ``x``, ``y`` or ``z``.

    Raises:
        ValueError: the model has nothing of the name that a cause gives as its place.
    """
    extended, missing = spec.copy(), []
    by_place: dict[tuple[str, str], dict[str, float]] = {}
    for cause in causes:
        by_place.setdefault((cause.effect, cause.where), {})[cause.parameter] = cause.value
    for name, effect in _in_order({name: None for name, _ in by_place}):
        for (_, where), given in filter(lambda entry: entry[0][0] == name, by_place.items()):
            values = {p.name: p.absent for p in effect.all_parameters} | given
            why = laws.reason(name)
            if why is None and name not in laws.LAWS:
                why = "it is defined for a TriFinger only"
            if why is None:
                places = laws.joints_of(extended) if where == "all joints" else [where]
                why = "; ".join(dict.fromkeys(filter(None, (laws.LAWS[name](extended, place, values) for place in places))))
            if why:
                missing.append(f"{name} at {where}: {why}")
    _state(extended, missing)
    return extended, missing


def write_mjcf(spec: mujoco.MjSpec, path: Path, estimate: Estimate | None = None) -> None:
    """Write a specification as MJCF; what ``estimate`` says of its values becomes ``<custom><text name="provenance">``, JSON."""
    written = spec.copy()
    if estimate is not None:
        written.add_text(name="provenance", data=json.dumps(asdict(estimate)))
    path.write_text(mjcf_text(written), encoding="utf-8")


def mjcf_text(spec: mujoco.MjSpec) -> str:
    """A specification as MJCF; numbers of joints, bodies, geoms and actuators keep all of their digits (MuJoCo writes six)."""
    copy = spec.copy()
    model = copy.compile()
    return exact_numbers(copy.to_xml(), model)


def _in_order(names: Iterable[str]) -> list[tuple[str, Effect]]:
    """Effects by name, in the order in which their laws must be written: limits before gains, then encoders, then joints."""
    return sorted(((name, CATALOGUE[name]) for name in names), key=lambda entry: laws.ORDER.get(entry[0], 0))


def _state(spec: mujoco.MjSpec, missing: list[str]) -> None:
    if missing:
        spec.add_text(name="not_expressed", data=" | ".join(missing))
