"""``python -m sim_backend.effects [NAME] [--json]``: the catalogue with bounds, units and sources."""

import argparse
import json
import sys
from typing import Any

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Effect, Group, Parameter


def document(effect: Effect) -> dict[str, Any]:
    """An effect as plain values."""
    return {
        "name": effect.name,
        "group": effect.group.value,
        "about": effect.about,
        "source": effect.source,
        "acts": effect.acts.value,
        "applied_by": f"{effect.apply.__module__}.{effect.apply.__name__}",
        "parameters": [_parameter(effect, parameter) for parameter in effect.all_parameters],
    }


def _parameter(effect: Effect, parameter: Parameter) -> dict[str, Any]:
    return {
        "key": effect.key(parameter),
        "unit": parameter.unit,
        "lower": parameter.lower,
        "upper": parameter.upper,
        "absent": parameter.absent,
        "scope": parameter.scope.value,
        "decides_presence": parameter in effect.parameters,
        "about": parameter.about,
    }


def text(effects: list[Effect]) -> str:
    """The catalogue for people, by group."""
    lines = []
    for group in Group:
        found = [effect for effect in effects if effect.group is group]
        if found:
            lines += [f"{group.value} ({len(found)})", *(line for effect in found for line in _lines(effect)), ""]
    return "\n".join(lines).rstrip()


def _lines(effect: Effect) -> list[str]:
    lines = [f"  {effect.name}: {effect.about}"]
    for parameter in effect.all_parameters:
        says = "absent" if parameter in effect.parameters else "default"
        bounds = f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}".rstrip()
        values = f"{bounds}, {says} {parameter.absent:g}, {parameter.scope.value}"
        lines.append(f"    {parameter.name:<22} {values}: {parameter.about}")
    return [*lines, f"    source: {effect.source}"]


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="trifarm effects", description="The effects that robots may have.")
    parser.add_argument("name", nargs="?", choices=list(CATALOGUE), metavar="NAME", help="only this effect")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    effects = [CATALOGUE[options.name]] if options.name else list(CATALOGUE.values())
    print(json.dumps({"effects": [document(effect) for effect in effects]}) if options.json else text(effects))
    return 0


if __name__ == "__main__":
    sys.exit(main())
