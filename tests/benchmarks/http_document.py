"""Two HTTP documents (``/openapi.json``) side by side: which paths, parameters, answers and schemas differ.

``python -m tests.benchmarks.http_document OLD.json NEW.json`` prints a line for each difference and exits 1 if there is one.
Versions are left out; so are titles, descriptions and summaries of anything unless ``--words`` asks for them.
``python -m tests.benchmarks.same_bits record`` keeps a farm's document.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

WORDS = {"title", "description", "summary"}
METHODS = {"get", "put", "post", "delete", "head", "patch", "options"}
SHOWN = 100


def differences(old: dict[str, Any], new: dict[str, Any], *, words: bool = False) -> Iterator[str]:
    """A line for each path, parameter, body, answer or field of a schema that differs."""
    yield from _compared("", _by_name(_shortened(old, words=words)), _by_name(_shortened(new, words=words)))


def _shortened(document: dict[str, Any], *, words: bool) -> dict[str, Any]:
    kept = {key: value for key, value in document.items() if key != "info"}
    return kept if words else _without_words(kept)


def _without_words(value: Any, *, names: bool = False) -> Any:
    """``names``: the keys are names that somebody chose, such as a field called ``title``."""
    if isinstance(value, list):
        return [_without_words(each) for each in value]
    if not isinstance(value, dict):
        return value
    chosen = {"properties", "schemas", "paths", "responses"}
    return {key: _without_words(each, names=key in chosen) for key, each in value.items() if names or key not in WORDS}


def _by_name(value: Any) -> Any:
    """Lists of parameters, of names and of choices as mappings: their order says nothing."""
    if isinstance(value, dict):
        return {key: _by_name(each) for key, each in value.items()}
    if not isinstance(value, list):
        return value
    if all(isinstance(each, dict) and {"name", "in"} <= each.keys() for each in value):
        return {f"{each['in']} parameter {each['name']}": _by_name(each) for each in value}
    if all(isinstance(each, str) for each in value):
        return {each: True for each in value}
    return {json.dumps(each, sort_keys=True): True for each in value} if value else {}


def _compared(where: str, old: Any, new: Any) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            place = f"{where} {key}".strip()
            if key not in new:
                yield f"- {place}{_shown(old[key])}"
            elif key not in old:
                yield f"+ {place}{_shown(new[key])}"
            else:
                yield from _compared(place, old[key], new[key])
    elif old != new:
        yield f"! {where}: {json.dumps(old)[:SHOWN]} -> {json.dumps(new)[:SHOWN]}"


def _shown(value: Any) -> str:
    return "" if value is True else f": {json.dumps(value, sort_keys=True)[:SHOWN]}"


def counted(document: dict[str, Any]) -> str:
    """How much a document holds."""
    operations = sum(method in METHODS for path in document["paths"].values() for method in path)
    return f"{len(document['paths'])} paths, {operations} operations, {len(document['components']['schemas'])} schemas"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--words", action="store_true", help="titles, descriptions and summaries too")
    asked = parser.parse_args()
    old, new = (json.loads(path.read_text()) for path in (asked.old, asked.new))
    found = list(differences(old, new, words=asked.words))
    print(f"old: {counted(old)}", f"new: {counted(new)}", *found, "", sep="\n")
    print(f"{len(found)} differences" if found else "the same document")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
