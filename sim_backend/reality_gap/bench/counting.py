"""Lines of results on disk, and shares of them."""

import json
from pathlib import Path

from api_schemas.success_rate import wilson


def whole_lines(path: Path) -> list[dict]:
    """What the lines of a file hold; one that a kill has cut off does not count."""
    found = []
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def share(k: int, n: int) -> dict:
    """``k`` of ``n`` as a rate with its 90 % Wilson interval; both None for none of none."""
    if n == 0:
        return {"k": 0, "n": 0, "rate": None, "interval_90": None}
    return {"k": k, "n": n, "rate": k / n, "interval_90": list(wilson(k, n, 0.9))}
