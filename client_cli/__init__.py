"""The command line of trifarm, and ``Farm`` for programs: strangers to services and robots, with HTTP between them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from client_cli.farm_sdk import Farm, FarmJob, FarmTrial

__all__ = ["Farm", "FarmJob", "FarmTrial"]


def __getattr__(name: str) -> object:
    # Loaded at its first use: the children of other commands import this package and need no HTTP.
    if name in __all__:
        from client_cli import farm_sdk

        return getattr(farm_sdk, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
