"""``trifarm layouts``: the ready-made manifests, what each shows and how many numbers that are."""

from typing import Annotated

import typer

from api_schemas.observation import OBSERVATION_SIZES, sizes_of
from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json
from client_cli.policies.policy_files import layout_named
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import print_document, print_line, print_table


def layouts(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="One of them, number by number; all if absent.")] = None,
    *,
    fields: Annotated[bool, typer.Option("--fields", help="List the fields that a manifest may name, instead.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List ready-made layouts: names for --layout, with the fields that each shows and how many numbers they are."""
    if fields:
        _print_fields(as_json=as_json)
    elif name is None:
        _print_all(as_json=as_json)
    else:
        _print_one(name, as_json=as_json)


def _print_fields(*, as_json: bool) -> None:
    if as_json:
        print_document({"fields": dict(OBSERVATION_SIZES)})
    else:
        print_table(("numbers", "field"), ((size, field) for field, size in OBSERVATION_SIZES.items()))


def _print_all(*, as_json: bool) -> None:
    if as_json:
        rows = {name: {"numbers": each.observation_size, "observation": list(each.observation)} for name, each in LAYOUTS.items()}
        print_document({"layouts": rows})
        return
    rows = ((name, each.observation_size, ", ".join([*each.observation, *_images(each)])) for name, each in LAYOUTS.items())
    print_table(("layout", "numbers", "fields in order"), rows)


def _images(layout: PolicyManifest) -> list[str]:
    """What is seen beside the observation, if there is anything."""
    return [] if layout.images is None else [f"images {' x '.join(map(str, layout.images.shape))} uint8"]


def _print_one(name: str, *, as_json: bool) -> None:
    layout = layout_named(name)
    if as_json:
        print_line(canonical_json(layout))
        return
    at, rows = 0, []
    for field, size in zip(layout.observation, sizes_of(layout.observation), strict=True):
        rows.append((f"{at}–{at + size - 1}" if size > 1 else at, size, field))
        at += size
    seen = [("", "", text) for text in _images(layout)]
    print_table(("at", "numbers", "field"), [*rows, ("sum", at, ""), *seen])
