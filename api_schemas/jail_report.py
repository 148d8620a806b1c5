"""How closed a jail is, as robots, reports and the status tell it."""

from collections.abc import Iterable

from api_schemas.schema import Schema
from jail.level import Jail, JailLevel, Layer


class JailReport(Schema):
    """A jail's level and the layers that are active in it."""

    level: JailLevel
    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, jail: Jail) -> "JailReport":
        """What is told of a jail."""
        return cls(level=jail.level, layers=jail.layers)

    def __str__(self) -> str:
        return str(Jail(self.layers))


def weakest(jails: Iterable[JailReport | None]) -> JailReport | None:
    """The most open of several jails, None if there is none among them."""
    known = [jail for jail in jails if jail is not None]
    return min(known, key=lambda jail: (list(JailLevel).index(jail.level), len(jail.layers)), default=None)
