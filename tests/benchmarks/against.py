"""How much faster is this checkout than an older one? The same measurements in both, in turns on one core.

    python -m tests.benchmarks.against OLD_CHECKOUT --out FILE.jsonl [--rounds 20] [--parts bare nominal real training]

Parts: ``bare``, physics alone, with the cube on the table and held fingers and over recorded push trials; ``nominal`` and
``real``, the full path of push trials (robot, jailed policy, safety, tracker, 1 kHz log) with these physics; ``training``,
iterations of PPO with the old checkout's recipe. Each round has other trials, which are the same for both; one round measures
old and new, the next one new and old. Each measurement has a process of its own (``in_checkout``), with the interpreter that
runs this. Lines are kept as they come, and kept ones are not measured again; the table has ratios, old over new, of the
processor's time.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median

import numpy as np

from tests.benchmarks.machine import cores, cpu_model

ROOT = Path(__file__).resolve().parent.parent.parent
PROGRAM = Path(__file__).with_name("in_checkout.py")
PARTS = ("bare", "nominal", "real", "training")
COUNT = {"bare": 1, "nominal": 2, "real": 2, "training": 3}
"""Trials a round, or iterations of the training."""
FIRST_SEED = 500
FIGURES = {
    "bare held": "bare step, fingers held",
    "bare push": "bare step, push trials",
    "nominal full": "full path, nominal",
    "real full": "full path, real",
    "training sample": "training, a sample",
}
CLOCKS = ("cpu", "wall")


class MeasurementError(Exception):
    """A checkout gave no figure; the message has the end of what it said."""


def measured(checkout: Path, part: str, core: int, **settings: object) -> dict:
    """What a checkout takes, by a process of its own.

    Raises:
        MeasurementError: the process failed, or did not get its code from this checkout.
    """
    more = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    command = [sys.executable, "-P", str(PROGRAM), "--checkout", str(checkout), "--core", str(core), "--part", part, *more]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    env = os.environ | one_thread | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(command, env=env, cwd="/", capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise MeasurementError(f"{checkout} gave no figure for {part!r}:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def plan(rounds: int, parts: Iterable[str]) -> Iterator[tuple[int, str, str]]:
    """(round, part, side) in the order in which they are measured: old, new, new, old, …"""
    for index in range(rounds):
        for part in parts:
            for side in ("old", "new") if index % 2 == 0 else ("new", "old"):
                yield index, part, side


def spread(rows: Iterable[dict]) -> dict[str, dict]:
    """For each figure, the medians in microseconds and the ratio of the two with the quartiles of the rounds' own ratios.

    Rounds count that have both sides.
    """
    found: dict[str, dict[int, dict[str, dict]]] = {}
    for row in rows:
        for name, took in row["us"].items():
            found.setdefault(f"{row['part']} {name}", {}).setdefault(row["round"], {})[row["side"]] = took
    return {name: summary for name in FIGURES if (summary := _of_figure(found.get(name, {})))}


def _of_figure(rounds: dict[int, dict[str, dict]]) -> dict:
    pairs = [sides for sides in rounds.values() if len(sides) == 2]
    if not pairs:
        return {}
    summary: dict = {"rounds": len(pairs)}
    for clock in CLOCKS:
        old, new = ([sides[side][clock] for sides in pairs] for side in ("old", "new"))
        ratios = np.divide(old, new)
        summary[clock] = {
            "old_us": round(median(old), 2),
            "new_us": round(median(new), 2),
            "ratio": round(median(old) / median(new), 3),
            "quartiles": [round(float(edge), 3) for edge in np.quantile(ratios, [0.25, 0.75])],
        }
    return summary


def table(summary: dict[str, dict]) -> str:
    """One line a figure, by the processor's time and by the clock."""
    lines = [f"{'':24s} {'rounds':>6s} {'old us':>8s} {'new us':>8s} {'ratio':>6s} {'quartiles':>13s}   by the clock"]
    for name, of_figure in summary.items():
        cpu, wall = (of_figure[clock] for clock in CLOCKS)
        low, high = cpu["quartiles"]
        amounts = f"{of_figure['rounds']:6d} {cpu['old_us']:8.2f} {cpu['new_us']:8.2f} {cpu['ratio']:6.2f}"
        lines.append(f"{FIGURES[name]:24s} {amounts} {low:6.2f} {high:6.2f}   {wall['ratio']:.2f}")
    return "\n".join(lines)


def _commit(checkout: Path) -> str:
    """The commit, with a mark when files differ from it."""
    command = ["git", "-c", "safe.directory=*", "-C", str(checkout), "describe", "--always", "--dirty", "--exclude", "*"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _begun(out: Path, settings: dict) -> list[dict]:
    """The rows so far; begins the file with its settings if there is none.

    Raises:
        SystemExit: it is a run with others.
    """
    if not out.exists():
        out.write_text(json.dumps(settings) + "\n")
        return []
    first, *rows = (json.loads(line) for line in out.read_text().splitlines())
    if other := [name for name in settings if first.get(name) != settings[name]]:
        before = ", ".join(f"{name} {first.get(name)}" for name in other)
        raise SystemExit(f"{out} was begun with {before}, which is not so in this run; give another --out")
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Measure, keep, print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.against", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("old", type=Path, help="a checkout of the older commit")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--core", type=int, default=max(os.sched_getaffinity(0)), help="the core that all run on")
    parser.add_argument("--out", type=Path, required=True, help="lines as they come (.jsonl)")
    parser.add_argument("--summary", type=Path, help="also write table and rounds as one JSON document")
    asked = parser.parse_args(arguments)
    old = asked.old.resolve()
    settings = {"old": _commit(old), "new": _commit(ROOT), "cpu": cpu_model(), "cores": cores()}
    rows = _begun(asked.out, settings)
    done = {(row["round"], row["part"], row["side"]) for row in rows}
    recipe = json.dumps(measured(old, "recipe", asked.core)) if "training" in asked.parts else ""
    for index, part, side in plan(asked.rounds, asked.parts):
        if (index, part, side) in done:
            continue
        extra = {"recipe": recipe} if part == "training" else {"seed": FIRST_SEED + COUNT[part] * index}
        us = measured(old if side == "old" else ROOT, part, asked.core, count=COUNT[part], **extra)
        rows.append({"round": index, "part": part, "side": side, "us": us})
        with asked.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    summary = spread(rows)
    print(table(summary))
    if asked.summary:
        asked.summary.write_text(json.dumps(settings | {"ratios": summary, "rounds": rows}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
