"""What policies that are trained here may see: the farm's ready-made layouts."""

from api_schemas.policy import LAYOUTS, PolicyManifest


def layout_of(name: str) -> PolicyManifest:
    """A layout by its name.

    Raises:
        ValueError: there is none of this name.
    """
    if name not in LAYOUTS:
        raise ValueError(f"unknown layout {name!r}; choose from {', '.join(LAYOUTS)}")
    return LAYOUTS[name]
