"""Catalogue and ranges as tables in Markdown: ``python -m sim_backend.effects.tables docs/effects.md`` renews those of a page."""

import re
import sys
from pathlib import Path

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import WIDTHS, Parameter
from sim_backend.effects.ranges import PRESET_NAMES, Distribution, Range, load_ranges

_MARKED = re.compile(r"<!-- table: (\w+) -->\n.*?<!-- end -->", re.DOTALL)


def catalogue_table() -> str:
    """Every parameter: bounds, what means absent, and how many numbers a robot has of it."""
    lines = ["| group | parameter | unit | bounds | absent | per robot | acts on |", "|---|---|---|---|---|---|---|"]
    for effect in CATALOGUE.values():
        for parameter in effect.all_parameters:
            absent = f"{parameter.absent:.4g}" if parameter in effect.parameters else "–"
            bounds = f"{parameter.lower:.4g} … {parameter.upper:.4g}"
            count = f"{WIDTHS[parameter.scope]} ({parameter.scope})" if parameter.width > 1 else "1"
            cells = (effect.group, f"`{effect.key(parameter)}`", parameter.unit or "–", bounds, absent, count, effect.acts)
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def ranges_table(name: str, beyond: str = "nominal") -> str:
    """The rows of a preset with their sources, without those that it has of another preset."""
    others = load_ranges(beyond).rows
    lines = ["| parameter | range | unit | drawn | source or reason | date |", "|---|---|---|---|---|---|"]
    for row in (row for row in load_ranges(name).rows if row not in others):
        unit = row.parameter.unit or "–"
        lines.append(f"| `{row.key}` | {_span(row)} | {unit} | {_drawn(row, row.parameter)} | {row.source} | {row.dated} |")
    return "\n".join(lines)


def presets_table() -> str:
    """The presets, one a row."""
    lines = ["| preset | rows | what it is |", "|---|---|---|"]
    for name in PRESET_NAMES:
        ranges = load_ranges(name)
        lines.append(f"| `{name}` | {len(ranges.rows)} | {ranges.about} |")
    return "\n".join(lines)


def renewed(page: str) -> str:
    """A page whose marked parts are made anew; a part is marked ``<!-- table: NAME -->`` and ``<!-- end -->``."""
    return _MARKED.sub(lambda found: f"<!-- table: {found[1]} -->\n\n{_table(found[1])}\n\n<!-- end -->", page)


def _table(name: str) -> str:
    if name == "catalogue":
        return catalogue_table()
    if name == "images":
        return ranges_table("real-images", beyond="real")
    if name == "measured":
        return ranges_table("real-2", beyond="real")
    return presets_table() if name == "presets" else ranges_table(name)


def _span(row: Range) -> str:
    if row.distribution is Distribution.FIXED:
        return f"{row.low:.4g}"
    if row.distribution is Distribution.GAUSSIAN:
        return f"{(row.low + row.high) / 2:.4g} ± {(row.high - row.low) / 2:.4g}"
    return f"{row.low:.4g} {'or' if row.distribution is Distribution.EITHER else '…'} {row.high:.4g}"


def _drawn(row: Range, parameter: Parameter) -> str:
    each = f", each {parameter.scope if parameter.scope != 'vector' else 'axis'}" if row.each else ""
    return f"{row.distribution}, per {row.per}{each}"


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(renewed(path.read_text(encoding="utf-8")), encoding="utf-8")
