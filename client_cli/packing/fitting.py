"""Whether a network takes what a manifest gives, and which ready-made layout would fit it if not."""

from collections.abc import Sequence

from api_schemas.policy import LAYOUTS, PolicyManifest
from client_cli.terminal.errors import UsageProblem


def layouts_of_width(takes: int) -> tuple[str, ...]:
    """The ready-made layouts that give so many numbers."""
    return tuple(name for name, layout in LAYOUTS.items() if layout.network_inputs == takes and layout.images is None)


def misfit(file: str, takes: Sequence[int], manifest: PolicyManifest) -> UsageProblem:
    """The error for a network that takes another number of inputs than the manifest gives.

    Args:
        file: what holds the network.
        takes: the numbers of inputs that it can be run on; several where it cuts what it takes from a longer observation.
        manifest: what was stated.
    """
    fitting = layouts_of_width(min(takes))
    width = f"{min(takes)} numbers" if len(takes) == 1 else f"{min(takes)} numbers or more"
    said = f"{file} takes {width}, {manifest.name} gives {manifest.network_inputs}"
    if fitting:
        return UsageProblem(f"{said}; {_advice(fitting)}")
    return UsageProblem(
        f"{said}; no ready-made layout fits ('trifarm layouts' lists them with their fields): write the fields that it was "
        "trained on into a manifest, in their order, and give --manifest FILE"
    )


def reads_begin(file: str, reads: int, manifest: PolicyManifest) -> UsageProblem:
    """The error for a network that runs on what the manifest gives, and reads no more of it than another ready-made layout has.

    Args:
        file: what holds the network.
        reads: how many numbers it reads, the width of a ready-made layout.
        manifest: what was stated.
    """
    said = f"{file} reads only the first {reads} of the {manifest.network_inputs} numbers of {manifest.name}"
    return UsageProblem(f"{said}; {_advice(layouts_of_width(reads))}")


def _advice(fitting: Sequence[str]) -> str:
    fits = "; ".join(f"{name} gives {LAYOUTS[name].network_inputs}" for name in fitting)
    return f"{fits}: give --layout {fitting[0]}" + (", or another of them" if fitting[1:] else "")
