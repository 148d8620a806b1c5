"""Numbers of an MJCF text with all of their digits.

MuJoCo writes six digits. Each attribute that it wrote is replaced by the compiled model's numbers if these are the same to
that precision, so that nothing can change but digits.
"""

from collections.abc import Mapping
from xml.etree import ElementTree

import mujoco
import numpy as np

_WRITTEN = 1e-5
"""Relative difference below which six digits mean the same number."""
_NUMBERS_OF_OPTION = frozenset(
    name for name in dir(mujoco.MjOption) if isinstance(getattr(mujoco.MjOption(), name), float | np.ndarray)
)
_NOTHING = 1e-12
"""In proportion to the largest number of an attribute."""


def exact_numbers(text: str, model: mujoco.MjModel) -> str:
    """An MJCF text whose elements with names have the numbers of ``model``, which was compiled from the same specification."""
    root = ElementTree.fromstring(text)  # noqa: S314 - written by MuJoCo a moment ago
    option = root.find("option")
    if option is not None:
        _refine(option, {name: getattr(model.opt, name) for name in option.attrib if name in _NUMBERS_OF_OPTION})
    for element in root.iter("body"):
        name = element.get("name")
        if name and (index := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)) >= 0:
            _refine(element, {"pos": model.body_pos[index], "quat": model.body_quat[index]})
            inertial = element.find("inertial")
            if inertial is not None:
                _refine(inertial, _inertial(model, index))
    for tag, kind, numbers in _KINDS:
        for element in root.iter(tag):
            name = element.get("name")
            if name and (index := mujoco.mj_name2id(model, kind, name)) >= 0:
                _refine(element, numbers(model, index))
    for element in root.iter("text"):  # MuJoCo writes some as character data, which it reads only if marked as such
        if element.text and element.text.strip():
            element.set("data", element.text)
            element.text = None
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _refine(element: ElementTree.Element, exact: Mapping[str, np.ndarray | float]) -> None:
    for name, value in exact.items():
        written, numbers = element.get(name), np.atleast_1d(np.asarray(value, dtype=float))
        if written is None:
            continue
        before = np.array(written.split(), dtype=float)
        numbers = numbers[: len(before)]
        nothing = _NOTHING * np.abs(before).max(initial=0.0)  # rounding that MuJoCo writes as 0
        if len(numbers) == len(before) and np.allclose(before, numbers, rtol=_WRITTEN, atol=nothing):
            element.set(name, " ".join(repr(float(number)) for number in numbers))


def _inertial(model: mujoco.MjModel, index: int) -> dict:
    return {
        "pos": model.body_ipos[index],
        "quat": model.body_iquat[index],
        "mass": model.body_mass[index],
        "diaginertia": model.body_inertia[index],
    }


def _joint(model: mujoco.MjModel, index: int) -> dict:
    dof, position = model.jnt_dofadr[index], model.jnt_qposadr[index]
    return {
        "pos": model.jnt_pos[index],
        "axis": model.jnt_axis[index],
        "range": model.jnt_range[index],
        "ref": model.qpos0[position],
        "springref": model.qpos_spring[position],
        "stiffness": model.jnt_stiffness[index],
        "frictionloss": model.dof_frictionloss[dof],
        "damping": model.dof_damping[dof],
        "armature": model.dof_armature[dof],
        "solimpfriction": model.dof_solimp[dof],
        "solreffriction": model.dof_solref[dof],
    }


def _geom(model: mujoco.MjModel, index: int) -> dict:
    return {
        "size": model.geom_size[index],
        "pos": model.geom_pos[index],
        "quat": model.geom_quat[index],
        "friction": model.geom_friction[index],
        "solref": model.geom_solref[index],
    }


def _pair(model: mujoco.MjModel, index: int) -> dict:
    return {"friction": model.pair_friction[index], "solref": model.pair_solref[index]}


def _actuator(model: mujoco.MjModel, index: int) -> dict:
    return {
        "gainprm": model.actuator_gainprm[index],
        "biasprm": model.actuator_biasprm[index],
        "forcerange": model.actuator_forcerange[index],
        "delay": model.actuator_delay[index],
        "dynprm": model.actuator_dynprm[index],
    }


_KINDS = (
    ("joint", mujoco.mjtObj.mjOBJ_JOINT, _joint),
    ("geom", mujoco.mjtObj.mjOBJ_GEOM, _geom),
    ("pair", mujoco.mjtObj.mjOBJ_PAIR, _pair),
    ("general", mujoco.mjtObj.mjOBJ_ACTUATOR, _actuator),
)
