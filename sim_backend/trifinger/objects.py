"""The objects that a trial may be tried with: the cube in other sizes, a cuboid, a sphere and an octagonal prism.

Allshire et al. (arXiv 2108.09779) tried cubes of 0.6 and 1.2 times the size, a sphere and a cuboid with a policy trained on the
cube; Dactyl (arXiv 1808.00177) tried an octagonal prism. Neither gives dimensions, so that those here are of our choice: each
object fits between the fingers as the cube does. All have the cube's density and the inertia of a solid, as the cube has.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim_backend.trifinger import constants as c

MIN_SCALE, MAX_SCALE = 0.6, 1.2  # Allshire et al., the sizes shown on s2r2-ig.github.io
DENSITY_KG_M3 = c.CUBE_MASS_KG / c.CUBE_WIDTH_M**3
CUBOID_SIZE_M = (0.050, 0.065, 0.090)
"""One side narrower and one longer than the cube's, at 1.07 times its volume; the challenge's cuboid of 2 x 2 x 8 cm (RRC 2020,
phase 3) lies too low for a policy that grasps a cube at half its height."""
ROLLING_FRICTION_M = 2e-3
"""Of the sphere: the half width of the flats that a ball with structure for grasping stands on. On a level table it lies still;
on one askew by 0.2 degrees it creeps by less than 1 mm/s, because MuJoCo's rolling friction is soft."""
_OCTAGON_AREA = 2 * (2**0.5 - 1)  # over the square of the width across flats
_OCTAGON_INERTIA = 0.5 * (1 + np.tan(np.pi / 8) ** 2 / 3)  # polar second moment over area and square of the inner radius


class Kind(StrEnum):
    """The geometry of an object."""

    BOX = "box"
    SPHERE = "sphere"
    OCTAGONAL_PRISM = "octagonal_prism"


@dataclass(frozen=True)
class Shape:
    """An object.

    ``size_m`` holds the extents along its own x, y, z; ``inertia_kg_m2`` those about them; ``rest_height_m`` is the height of
    the centre above the table when its z axis points up (other faces: :func:`resting_height_m`).
    """

    name: str
    kind: Kind
    size_m: tuple[float, float, float]
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    rest_height_m: float


def shape_of(name: str, scale: float = 1.0) -> Shape:
    """The object of a name in a size.

    Args:
        name: one of ``OBJECT_NAMES``.
        scale: of every length, 0.6 to 1.2; mass follows with the third power and inertia with the fifth.

    Raises:
        ValueError: an unknown name or a scale out of bounds.
    """
    if name not in _SHAPES:
        raise ValueError(f"unknown object {name!r}; choose from {', '.join(OBJECT_NAMES)}")
    if not MIN_SCALE <= scale <= MAX_SCALE:
        raise ValueError(f"the scale of the object is {scale:g}; it must be between {MIN_SCALE:g} and {MAX_SCALE:g}")
    shape = _SHAPES[name]
    x, y, z = (scale * length for length in shape.size_m)
    ixx, iyy, izz = (scale**5 * inertia for inertia in shape.inertia_kg_m2)
    return Shape(name, shape.kind, (x, y, z), scale**3 * shape.mass_kg, (ixx, iyy, izz), scale * shape.rest_height_m)


def resting_height_m(shape: Shape, quat_wxyz: np.ndarray) -> np.ndarray:
    """Height of the centre of an object that touches the table in an orientation.

    Args:
        shape: the object.
        quat_wxyz: orientations, shape (..., 4).

    Returns:
        Shape (...), m.
    """
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz, dtype=float), -1, 0)
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)  # world's z, seen by the object
    if shape.kind is Kind.SPHERE:
        return np.full(up.shape[:-1], shape.rest_height_m)
    return (up @ corners_m(shape).T).max(axis=-1)


def corners_m(shape: Shape) -> np.ndarray:
    """Corners in the object's own frame: shape (8, 3) for a box, (16, 3) for the prism, m. A sphere has none."""
    half = np.array(shape.size_m) / 2
    signs = np.array([-1.0, 1.0])
    if shape.kind is Kind.BOX:
        return np.array([(i, j, k) for i in signs for j in signs for k in signs]) * half
    if shape.kind is Kind.SPHERE:
        raise ValueError("a sphere has no corners")
    angles = np.pi / 8 + np.arange(8) * np.pi / 4  # flat sides face along x and y
    octagon = np.stack([np.cos(angles), np.sin(angles)], axis=1) / np.cos(np.pi / 8)
    return np.array([[*point, sign] for sign in signs for point in octagon]) * half


def _box(name: str, size_m: tuple[float, float, float]) -> Shape:
    x, y, z = size_m
    mass = DENSITY_KG_M3 * x * y * z
    inertia = (mass / 12 * (y * y + z * z), mass / 12 * (x * x + z * z), mass / 12 * (x * x + y * y))
    return Shape(name, Kind.BOX, size_m, mass, inertia, z / 2)


def _sphere(name: str, diameter_m: float) -> Shape:
    mass = DENSITY_KG_M3 * np.pi / 6 * diameter_m**3
    inertia = mass * diameter_m**2 / 10
    return Shape(name, Kind.SPHERE, (diameter_m, diameter_m, diameter_m), mass, (inertia, inertia, inertia), diameter_m / 2)


def _octagonal_prism(name: str, width_m: float, height_m: float) -> Shape:
    """Upright: the octagons are its top and bottom; ``width_m`` is across flats."""
    mass = DENSITY_KG_M3 * _OCTAGON_AREA * width_m**2 * height_m
    about_axis = mass * _OCTAGON_INERTIA * (width_m / 2) ** 2
    across = about_axis / 2 + mass * height_m**2 / 12
    return Shape(name, Kind.OCTAGONAL_PRISM, (width_m, width_m, height_m), mass, (across, across, about_axis), height_m / 2)


_WIDTH, _INERTIA = c.CUBE_WIDTH_M, c.CUBE_INERTIA_KG_M2
CUBE = Shape("cube", Kind.BOX, (_WIDTH, _WIDTH, _WIDTH), c.CUBE_MASS_KG, (_INERTIA, _INERTIA, _INERTIA), c.CUBE_REST_HEIGHT_M)
_SHAPES = {
    shape.name: shape
    for shape in (
        CUBE,
        _box("cuboid", CUBOID_SIZE_M),
        _sphere("sphere", c.CUBE_WIDTH_M),
        _octagonal_prism("octagonal_prism", c.CUBE_WIDTH_M, c.CUBE_WIDTH_M),
    )
}
OBJECT_NAMES = tuple(_SHAPES)
