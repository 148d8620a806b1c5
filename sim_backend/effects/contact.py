"""Effects on the cube and on contacts; all but the random pushes are MuJoCo's own and applied to the specification."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_robot
from sim_backend.trifinger import constants as c

if TYPE_CHECKING:
    from mujoco import MjSpec

_MUJOCO_CONTACT_S = 0.02


def fingertip_friction(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Friction of fingers against the cube: the explicit contact pairs."""
    for pair in spec.pairs:
        pair.friction[:2] = float(values["coefficient"])


def table_friction(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Friction of the cube against table and wall; the cube's own value counts there."""
    spec.geom("cube").friction[0] = float(values["coefficient"])


def finger_table_friction(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Friction of fingers against table, wall and each other."""
    for finger in c.FINGER_NAMES:
        for link in ("tip", "lower", "middle"):
            spec.geom(f"{finger}_{link}").friction[0] = float(values["coefficient"])


def cube_mass(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Scale mass and inertia of the cube."""
    body, factor = spec.body("cube"), float(values["factor"])
    body.mass, body.inertia = body.mass * factor, np.asarray(body.inertia) * factor


def cube_size(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Scale the cube's width at the same mass."""
    body, factor = spec.body("cube"), float(values["factor"])
    body.inertia = np.asarray(body.inertia) * factor**2
    for geom in body.geoms:
        geom.size, geom.pos = np.asarray(geom.size) * factor, np.asarray(geom.pos) * factor
        if geom.meshname:
            mesh = spec.mesh(geom.meshname)
            mesh.scale = np.asarray(mesh.scale) * factor


def contact_stiffness(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Time constant and damping ratio of the cube's contacts."""
    solref = [float(values["time_constant_s"]), float(values["damping_ratio"])]
    spec.geom("cube").solref = solref
    for pair in spec.pairs:
        pair.solref = solref


@numba.njit(inline="always")
def push_force_n(std_n: float, probability: float, chance: float, normal: float) -> float:
    """Force on the cube in one direction: for a while, by chance."""
    return std_n * normal if chance < probability else 0.0


def _effect(
    name: str,
    about: str,
    source: str,
    apply: Callable[..., Any],
    *parameters: Parameter,
    acts: Acts = Acts.MODEL,
    shape: Sequence[Parameter] = (),
) -> Effect:
    return Effect(name, Group.CONTACT, about, source, acts, parameters, apply, tuple(shape))


_DACTYL = "Dactyl (arXiv 1808.00177), table of randomisations"

EFFECTS = (
    _effect(
        "fingertip_friction",
        "fingers grip the cube more or less",
        "simulators disagree on it by 10 x (trifinger_simulation 0.1, IsaacGymEnvs 1.0); no measured value was found",
        fingertip_friction,
        per_robot("coefficient", "", 0.05, 3.0, c.CUBE_FRICTION, "of fingers against the cube"),
    ),
    _effect(
        "table_friction",
        "the cube slides on table and wall more or less easily",
        "IsaacGymEnvs Trifinger.yaml randomises the table's friction; ContactNets (arXiv 2009.11193) measured 0.18 for a cube",
        table_friction,
        per_robot("coefficient", "", 0.05, 3.0, c.CUBE_FRICTION, "of the cube against table and wall"),
    ),
    _effect(
        "finger_table_friction",
        "fingers slide on table and wall more or less easily",
        "IsaacGymEnvs Trifinger.yaml: robot 1.0, table 0.1, averaged",
        finger_table_friction,
        per_robot("coefficient", "", c.TABLE_FRICTION, 3.0, c.FINGER_FRICTION, "of fingers against table, wall and each other"),
    ),
    _effect(
        "cube_mass",
        "the cube is heavier or lighter",
        f"{_DACTYL}; trifinger_simulation has 94 g, IsaacGymEnvs 80 g",
        cube_mass,
        per_robot("factor", "", 0.2, 3.0, 1.0, "of mass and inertia"),
    ),
    _effect(
        "cube_size",
        "the cube is larger or smaller at the same mass",
        f"{_DACTYL}; trifinger_object_tracking takes 65.2 mm, the cube's model 65 mm",
        cube_size,
        per_robot("factor", "", 0.8, 1.25, 1.0, "of the width"),
    ),
    _effect(
        "contact_stiffness",
        "contacts of the cube are softer or stiffer",
        "MuJoCo solref; soft fingertips",
        contact_stiffness,
        per_robot("time_constant_s", "s", 0.003, 0.2, _MUJOCO_CONTACT_S, "of the contact"),
        shape=(per_robot("damping_ratio", "", 0.2, 2.0, 1.0, "of the contact"),),
    ),
    _effect(
        "cube_pushes",
        "forces push the cube by chance",
        f"{_DACTYL}: random forces on the object",
        push_force_n,
        per_robot("force_n", "N", 0.0, 5.0, 0.0, "standard deviation in each direction"),
        acts=Acts.CONTROL,
        shape=(
            per_robot("probability", "", 0.0, 1.0, 0.1, "that a push begins at each duration's begin"),
            per_robot("duration_s", "s", 0.001, 1.0, 0.1, "of a push"),
        ),
    ),
)
