"""How long the server takes for its verdict on an upload: ``python -m tests.benchmarks.verdict_times --out FILE``.

A real services process gets policies of 5 MB, each for the first time, one after the other, the three formats in turns. Measured
is the wall time from PUT to answer, and the CPU time of the services and the child that they started for it, which does not
depend on what else the machine does.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from tests.hostile.valid import MANIFEST, VALID, sized
from tests.integration.farm_process import services

SIZE_BYTES = 5_000_000
LIMIT_S = {"safetensors": 2.0, "onnx": 2.0, "zip": 6.0}
"""Of the 95th percentile on a machine that does nothing else."""


def cpu_s(pid: int) -> float:
    """CPU time of a process and of those of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def verdict(farm, kind: str, seed: int) -> tuple[float, float]:
    """Wall and CPU time of one upload that is taken."""
    content = sized(kind, SIZE_BYTES, seed)
    before_s, began_s = cpu_s(farm.process.pid), time.perf_counter()
    answer = farm.upload(content, MANIFEST, filename=f"p.{kind}")
    wall_s = time.perf_counter() - began_s
    assert answer.status_code == 201, answer.text
    return wall_s, cpu_s(farm.process.pid) - before_s


def summary(times: list[tuple[float, float]], limit_s: float) -> dict:
    """Percentiles in s, and all that was measured."""
    wall_s, spent_s = zip(*times, strict=True)
    found = {"limit_s": limit_s, "uploads": len(times)}
    for name, each in (("wall", wall_s), ("cpu", spent_s)):
        found |= {f"{name}_median_s": round(median(each), 3), f"{name}_p95_s": round(float(np.quantile(each, 0.95)), 3)}
    return found | {"wall_s": [round(each, 3) for each in wall_s], "cpu_s": [round(each, 3) for each in spent_s]}


def main() -> int:
    """Writes the result; ends with 1 where a 95th percentile is above its limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uploads", type=int, default=40, help="of each format")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    document: dict[str, Any] = {"format": "trifarm-verdict-times/1", "weights_bytes": SIZE_BYTES, "cores": os.cpu_count()}
    document["load_before"] = round(os.getloadavg()[0], 2)
    times: dict[str, list[tuple[float, float]]] = {kind: [] for kind in VALID}
    with tempfile.TemporaryDirectory(prefix="trifarm-verdicts-") as name, services(Path(name) / "farm") as farm:
        for seed in range(given.uploads):
            for kind, taken in times.items():
                taken.append(verdict(farm, kind, seed))
    document["load_after"] = round(os.getloadavg()[0], 2)
    document["formats"] = {kind: summary(taken, LIMIT_S[kind]) for kind, taken in times.items()}
    given.out.write_text(json.dumps(document, indent=2) + "\n")
    for kind, found in document["formats"].items():
        print(f"{kind}: wall p95 {found['wall_p95_s']} s (limit {found['limit_s']:g} s), CPU p95 {found['cpu_p95_s']} s")
    return int(any(found["wall_p95_s"] > found["limit_s"] for found in document["formats"].values()))


if __name__ == "__main__":
    sys.exit(main())
