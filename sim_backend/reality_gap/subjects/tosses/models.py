"""Models of the object under other values: the effects of the catalogue, applied to any free body instead of the farm's cube."""

from collections.abc import Mapping

import mujoco
import numpy as np

from sim_backend.effects.body import gravity, table_tilt
from sim_backend.reality_gap.subjects.tosses.geometry import ObjectGeometry

FRICTION, MASS, SIZE = "table_friction.coefficient", "cube_mass.factor", "cube_size.factor"
TIME_CONSTANT, DAMPING = "contact_stiffness.time_constant_s", "contact_stiffness.damping_ratio"
GRAVITY, ROLL, PITCH = "gravity.offset_m_s2", "table_tilt.roll_rad", "table_tilt.pitch_rad"
SCALE, HEIGHT = "tracking_scale.factor_error", "tracking_offset.position_m"
"""Of the camera: how it sees lengths and heights."""
BODY_KEYS = (FRICTION, MASS, SIZE, TIME_CONSTANT, DAMPING, GRAVITY, ROLL, PITCH)
_SOLREF = (0.02, 1.0)  # MuJoCo's defaults, where the model gives stiffness and damping instead


def nominal_values(geometry: ObjectGeometry) -> dict[str, float]:
    """Values of the parameters that the model itself has."""
    model, own = geometry.model, list(geometry.geoms)
    pairs = _pairs(model, geometry)
    solref = model.pair_solref[pairs[0]] if len(pairs) else model.geom_solref[own[0]]
    if solref[0] <= 0.0:
        solref = np.array(_SOLREF)
    values = {MASS: 1.0, SIZE: 1.0, GRAVITY: 0.0, ROLL: 0.0, PITCH: 0.0}
    friction = model.pair_friction[pairs[0], 0] if len(pairs) else _contact_friction(geometry)
    return values | {FRICTION: float(friction), TIME_CONSTANT: float(solref[0]), DAMPING: float(solref[1])}


def compiled(spec: mujoco.MjSpec, geometry: ObjectGeometry, values: Mapping[str, float], step_s: float) -> mujoco.MjModel:
    """The model with other values; what is not among them stays as the model has it.

    Args:
        spec: of the nominal model; not changed.
        geometry: of its object.
        values: by catalogue key; ``gravity.offset_m_s2`` is added along nominal gravity's upward direction.
        step_s: of the integration, s.
    """
    spec = spec.copy()
    spec.option.timestep = step_s
    if values.get(GRAVITY):
        gravity(spec, {"offset_m_s2": values[GRAVITY] * upward(geometry.model)})
    if values.get(ROLL) or values.get(PITCH):
        table_tilt(spec, {"roll_rad": values.get(ROLL, 0.0), "pitch_rad": values.get(PITCH, 0.0)})
    size = values.get(SIZE, 1.0)
    if size != 1.0:
        _resize(spec, geometry.body, size)
    model = spec.compile()
    _set_inertia(model, geometry, values.get(MASS, 1.0), size)
    _set_contacts(model, geometry, values)
    return model


def upward(model: mujoco.MjModel) -> np.ndarray:
    """Unit vector against gravity, shape (3,); along z in a model without gravity."""
    size = np.linalg.norm(model.opt.gravity)
    return -model.opt.gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])


def _resize(spec: mujoco.MjSpec, name: str, factor: float) -> None:
    root = spec.body(name)
    for body in (root, *root.find_all("body")):
        if body is not root:
            body.pos = np.asarray(body.pos) * factor
        for geom in body.geoms:
            geom.size, geom.pos = np.asarray(geom.size) * factor, np.asarray(geom.pos) * factor
            geom.fromto = np.asarray(geom.fromto) * factor
            if geom.meshname:
                mesh = spec.mesh(geom.meshname)
                mesh.scale = np.asarray(mesh.scale) * factor


def _set_inertia(model: mujoco.MjModel, geometry: ObjectGeometry, mass: float, size: float) -> None:
    """Mass as nominal times its factor; inertia follows mass and width."""
    if mass == 1.0 and size == 1.0:
        return
    nominal, root = geometry.model, geometry.model.geom_bodyid[geometry.geoms[0]]
    for body in np.flatnonzero(nominal.body_rootid == nominal.body_rootid[root]):
        model.body_mass[body] = nominal.body_mass[body] * mass
        model.body_inertia[body] = nominal.body_inertia[body] * mass * size**2
        model.body_ipos[body] = nominal.body_ipos[body] * size
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _set_contacts(model: mujoco.MjModel, geometry: ObjectGeometry, values: Mapping[str, float]) -> None:
    """The same numbers on both sides of each contact, so that no rule of mixing can change them."""
    sides, pairs = [*geometry.geoms, *geometry.surroundings], _pairs(model, geometry)
    if FRICTION in values:
        model.geom_friction[sides, 0] = values[FRICTION]
        model.pair_friction[pairs, :2] = values[FRICTION]
    if TIME_CONSTANT in values:
        solref = values[TIME_CONSTANT], values.get(DAMPING, 1.0)
        model.geom_solref[sides] = solref
        model.pair_solref[pairs] = solref


def _pairs(model: mujoco.MjModel, geometry: ObjectGeometry) -> np.ndarray:
    own = np.isin(model.pair_geom1, geometry.geoms) | np.isin(model.pair_geom2, geometry.geoms)
    return np.flatnonzero(own)


def _contact_friction(geometry: ObjectGeometry) -> float:
    """Of a contact without an explicit pair: of the geom with the higher priority, else the larger of both."""
    model, own, other = geometry.model, geometry.geoms[0], geometry.surroundings[0]
    difference = int(model.geom_priority[own]) - int(model.geom_priority[other])
    if difference:
        return float(model.geom_friction[own if difference > 0 else other, 0])
    return float(max(model.geom_friction[own, 0], model.geom_friction[other, 0]))
