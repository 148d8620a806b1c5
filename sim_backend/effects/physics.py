"""The effects that n robots have: checked values by parameter, with a leading axis over the robots."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class Physics:
    """Effects of n robots.

    ``given`` holds the parameters that were given a value, by "effect.parameter", with shape (n,) for global ones and
    (n, 9) or (n, 3) for those with a value per joint, camera or axis. Everything else is absent.

    Example:
        >>> import trifarm
        >>> two = trifarm.Physics.of(2, {"coulomb_friction.torque_nm": 0.05})
        >>> two.value("coulomb_friction.torque_nm").shape
        (2, 9)
    """

    n: int
    given: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def nominal(cls, n: int = 1) -> "Physics":
        """Robots without any effect."""
        return cls(n)

    @classmethod
    def of(cls, n: int, values: Mapping[str, Any]) -> "Physics":
        """Physics from numbers or arrays by "effect.parameter"; one number stands for all joints and all robots.

        Raises:
            ValueError: an unknown name, a shape that does not fit, or a value out of bounds; the message says which.
        """
        return cls(n, {key: _checked(n, key, value) for key, value in values.items()})

    @property
    def is_nominal(self) -> bool:
        """Whether no robot has any effect."""
        return not any(self.has(name) for name in CATALOGUE)

    def has(self, effect: str) -> bool:
        """Whether any of the robots has the effect."""
        return bool(self.having(effect).any())

    def having(self, effect: str) -> np.ndarray:
        """Which of the robots have the effect, shape (n,)."""
        found, having = CATALOGUE[effect], np.zeros(self.n, dtype=bool)
        for key, absent in ((found.key(p), p.absent) for p in found.parameters):
            if key in self.given:
                having |= (self.given[key].reshape(self.n, -1) != absent).any(axis=1)
        return having

    def value(self, key: str) -> np.ndarray:
        """Values of a parameter: shape (n,), or (n, 9) or (n, 3); the absent value where none was given."""
        if key in self.given:
            return self.given[key]
        parameter = _parameter(key)
        return np.full(_shape(self.n, parameter), parameter.absent)

    def row(self, index: int) -> "Physics":
        """One robot's physics."""
        return Physics(1, {key: values[index : index + 1] for key, values in self.given.items()})

    def rows(self, index: np.ndarray) -> "Physics":
        """The physics of some of the robots, in this order."""
        return Physics(len(index), {key: values[index] for key, values in self.given.items()})

    def with_rows(self, index: np.ndarray, rows: "Physics") -> "Physics":
        """The same robots, but those of ``index`` with the physics of ``rows``."""
        merged = {key: self.value(key).copy() for key in dict.fromkeys((*self.given, *rows.given))}
        for key, values in merged.items():
            values[index] = rows.value(key)
        return Physics(self.n, merged)

    @classmethod
    def stack(cls, rows: Sequence["Physics"]) -> "Physics":
        """Several robots' physics as one."""
        keys = dict.fromkeys(key for row in rows for key in row.given)
        return cls(sum(row.n for row in rows), {key: np.concatenate([row.value(key) for row in rows]) for key in keys})

    def changed(self, values: Mapping[str, Any]) -> "Physics":
        """The same physics with other values for some parameters."""
        return Physics(self.n, {**self.given, **Physics.of(self.n, values).given})

    def without(self, effects: Sequence[str]) -> "Physics":
        """The same physics with some effects absent."""
        for name in effects:
            _effect(name)
        return Physics(self.n, {key: values for key, values in self.given.items() if key.partition(".")[0] not in effects})

    def document(self) -> dict[str, dict[str, float | list[float]]]:
        """One robot's physics as plain values: effect, then parameter. Exact: a document read again gives the same bits."""
        assert self.n == 1, "a document holds the physics of one robot"
        document: dict[str, dict[str, float | list[float]]] = {}
        for key, values in self.given.items():
            effect, _, parameter = key.partition(".")
            document.setdefault(effect, {})[parameter] = values[0].tolist()
        return document

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Physics":
        """One robot's physics from what :meth:`document` gave, or from a TOML file of the same form.

        Raises:
            ValueError: as for :meth:`of`.
        """
        values: dict[str, Any] = {}
        for name, parameters in document.items():
            effect = _effect(name)
            if not isinstance(parameters, Mapping):
                raise ValueError(f"effect {name!r} is {parameters!r}; it must be a table of {_names(effect.all_parameters)}")
            values |= {f"{name}.{parameter}": value for parameter, value in parameters.items()}
        return cls.of(1, {key: _row(value) for key, value in values.items()})


def _row(value: Any) -> Any:
    return [value] if isinstance(value, Sequence) and not isinstance(value, str) else value


def _checked(n: int, key: str, value: Any) -> np.ndarray:
    parameter = _parameter(key)
    shape = _shape(n, parameter)
    try:
        array = np.asarray(value, dtype=float)
        if array.ndim == 1 and len(shape) == 2 and len(array) == n > 1:
            if n == shape[1]:
                raise ValueError("one number for each robot, or one for each joint, camera or axis?")
            array = array[:, None]  # one number for each robot
        array = np.broadcast_to(array, shape).copy()
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{key} is {value!r}; it must be a number or of shape {shape} ({parameter.scope} scope): {error}"
        ) from error
    outside = ~((array >= parameter.lower) & (array <= parameter.upper))
    if outside.any():
        limits = f"between {parameter.lower:g} and {parameter.upper:g} {parameter.unit}".rstrip()
        raise ValueError(f"{key} is {array[outside][0]:g}; it must be {limits} ({parameter.absent:g} means absent)")
    return array


def _parameter(key: str) -> Parameter:
    if key not in PARAMETERS:
        effect = _effect(key.partition(".")[0])
        raise ValueError(f"effect {effect.name} has no parameter {key!r}; choose from {_names(effect.all_parameters)}")
    return PARAMETERS[key]


def _effect(name: str) -> Effect:
    if name not in CATALOGUE:
        raise ValueError(f"unknown effect {name!r}; choose from {', '.join(CATALOGUE)}")
    return CATALOGUE[name]


def _names(parameters: Sequence[Parameter]) -> str:
    return ", ".join(parameter.name for parameter in parameters)


def _shape(n: int, parameter: Parameter) -> tuple[int, ...]:
    return (n,) if parameter.width == 1 else (n, parameter.width)
