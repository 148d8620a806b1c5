"""What an effect is: a named physical deviation with bounded parameters, a value that means absent, and what applies it."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Scope(StrEnum):
    """What a parameter has a value for; ``WIDTHS`` gives how many values that are per robot."""

    GLOBAL = "global"
    JOINT = "joint"
    CAMERA = "camera"
    VECTOR = "vector"
    FACE = "face"


WIDTHS: dict[Scope, int] = {Scope.GLOBAL: 1, Scope.JOINT: 9, Scope.CAMERA: 3, Scope.VECTOR: 3, Scope.FACE: 6}


class Group(StrEnum):
    """What part of the robot an effect belongs to."""

    ACTUATION = "actuation"
    BODY = "body"
    CONTACT = "contact"
    SENSING = "sensing"
    TRACKING = "tracking"
    IMAGES = "images"
    FAULT = "fault"


class Acts(StrEnum):
    """Where an effect is applied."""

    MODEL = "model"  # once, to the MjSpec before it is compiled: MuJoCo has it
    CONTROL = "control"  # every millisecond, in the compiled control callback
    TRACKER = "tracker"  # every camera frame
    CALIBRATION = "calibration"  # where a camera stands and how it is made, once; only where images are rendered
    APPEARANCE = "appearance"  # once, to the MjSpec that is rendered; only there
    IMAGE = "image"  # every rendered image


LOOKS = frozenset({Acts.CALIBRATION, Acts.APPEARANCE, Acts.IMAGE})
"""Acts that change what images look like and nothing else: no motion and no pose of the formula."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, or one for each joint, camera or axis; bounds and absent value in SI units."""

    name: str
    unit: str
    lower: float
    upper: float
    absent: float
    scope: Scope
    about: str

    @property
    def width(self) -> int:
        """How many values it has per robot."""
        return WIDTHS[self.scope]


def per_robot(name: str, unit: str, lower: float, upper: float, absent: float, about: str) -> Parameter:
    """A parameter with one value per robot."""
    return Parameter(name, unit, lower, upper, absent, Scope.GLOBAL, about)


def per_joint(name: str, unit: str, lower: float, upper: float, absent: float, about: str) -> Parameter:
    """A parameter with a value for each joint."""
    return Parameter(name, unit, lower, upper, absent, Scope.JOINT, about)


def per_camera(name: str, unit: str, lower: float, upper: float, absent: float, about: str) -> Parameter:
    """A parameter with a value for each camera."""
    return Parameter(name, unit, lower, upper, absent, Scope.CAMERA, about)


def per_face(name: str, unit: str, lower: float, upper: float, absent: float, about: str) -> Parameter:
    """A parameter with a value for each face of the cube, in the order of ``constants.CUBE_FACE_COLOURS``."""
    return Parameter(name, unit, lower, upper, absent, Scope.FACE, about)


def per_axis(name: str, unit: str, lower: float, upper: float, absent: float, about: str) -> Parameter:
    """A parameter with a value for each axis of the world."""
    return Parameter(name, unit, lower, upper, absent, Scope.VECTOR, about)


@dataclass(frozen=True)
class Effect:
    """One named physical deviation from the nominal robot.

    An effect is absent when its first parameters have their absent values; ``shape_parameters`` (a time constant, a phase)
    only say how it looks when it is there. ``apply`` is the function that applies it: for ``Acts.MODEL`` it takes the MjSpec
    and one robot's values by parameter name, for ``Acts.CONTROL`` it is a compiled function that the control callback
    calls by name (``sim_backend.driver.control_step``), most of them for each joint, for ``Acts.TRACKER`` a function over n
    robots that the tracker calls. Those in ``LOOKS`` are called by ``sim_backend.vision`` with one robot's values by parameter
    name: for ``Acts.CALIBRATION`` with a camera's pose or lens, for ``Acts.APPEARANCE`` with the MjSpec that is rendered, for
    ``Acts.IMAGE`` with images.
    """

    name: str
    group: Group
    about: str
    source: str
    acts: Acts
    parameters: tuple[Parameter, ...]
    apply: Callable[..., Any]
    shape_parameters: tuple[Parameter, ...] = ()

    @property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """First those whose absent value means that the effect is absent, then those of its shape."""
        return (*self.parameters, *self.shape_parameters)

    def key(self, parameter: Parameter) -> str:
        """``effect.parameter``."""
        return f"{self.name}.{parameter.name}"
