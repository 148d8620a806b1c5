"""How closed a jail is: the layers that are active, and the level that they add up to."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum


class JailLevel(StrEnum):
    """How far a child can be trusted with a stranger's data; each level contains those before it."""

    NONE = "none"
    LIMITS = "limits"  # CPU time, memory, files and processes end somewhere; the end of its parent is its own
    FILESYSTEM = "filesystem"  # it sees no file but those that it needs
    FULL = "full"  # no network, no new process, no unusual system call, and not root

    def reaches(self, least: "JailLevel") -> bool:
        """Whether this level is ``least`` or a higher one."""
        levels = tuple(JailLevel)
        return levels.index(self) >= levels.index(least)


class Layer(StrEnum):
    """One wall of the jail."""

    LIMITS = "limits"
    NO_NEW_PRIVILEGES = "no-new-privileges"
    NETWORK_NAMESPACE = "network-namespace"
    LANDLOCK_FILES = "landlock-files"
    LANDLOCK_NETWORK = "landlock-network"
    LANDLOCK_SCOPES = "landlock-scopes"  # no signals and no abstract sockets out of the jail
    UNPRIVILEGED_USER = "unprivileged-user"
    SYSTEM_CALLS = "system-calls"


@dataclass(frozen=True)
class Jail:
    """The layers that are active, in the order of ``Layer``."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, layers: Collection[Layer]) -> "Jail":
        """The jail of these layers."""
        return cls(tuple(layer for layer in Layer if layer in layers))

    @property
    def level(self) -> JailLevel:
        """The highest level all of whose walls stand."""
        level = JailLevel.NONE
        for each, needed in _NEEDED.items():
            if not needed <= set(self.layers):
                break
            level = each
        return level

    def __str__(self) -> str:
        return f"{self.level} ({', '.join(self.layers) or 'no layer'})"


_NEEDED = {
    JailLevel.LIMITS: {Layer.LIMITS, Layer.NO_NEW_PRIVILEGES},
    JailLevel.FILESYSTEM: {Layer.LANDLOCK_FILES},
    JailLevel.FULL: {Layer.SYSTEM_CALLS, Layer.UNPRIVILEGED_USER},
}


def too_open(jail: Jail, least: JailLevel) -> str | None:
    """Why a jail is not closed enough, None when it is."""
    if jail.level.reaches(least):
        return None
    missing = [layer for level, needed in _NEEDED.items() if least.reaches(level) for layer in Layer if layer in needed]
    lacking = ", ".join(layer for layer in missing if layer not in jail.layers)
    return f"the jail here reaches level {jail.level}, but the setting jail_level asks for {least}; missing: {lacking}"
