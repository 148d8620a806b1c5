"""How pushes scatter where a robot differs everywhere and nothing more is wrong with the cube than is known.

    python -m sim_backend.reality_gap.bench.cube_of_many DIR [DIR …]

Each folder holds robots of ``real`` as ``bench.many_causes`` kept them, with the values that were fitted to their joints. Their
pushes are simulated and replayed with these values, and with the cube and the tracker's errors of place as they are: what is left
is what errors of joints, and noise larger than healthy, leave in a session. ``knowledge/cubes_of_many.json`` keeps it, in
standard deviations of healthy sessions: robots other than those that are tested with.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.bench.counting import whole_lines
from sim_backend.reality_gap.bench.cube_sessions import sessions_with_pushes
from sim_backend.reality_gap.bench.many_causes import LINES, is_of_real, robot
from sim_backend.reality_gap.knowledge.cube import PUSHED
from sim_backend.reality_gap.knowledge.healthy import CUBES_OF_MANY_FILE
from sim_backend.reality_gap.knowledge.value_errors import likeliest
from sim_backend.reality_gap.model.files import writable
from sim_backend.reality_gap.model.model import physics_of
from sim_backend.reality_gap.quantiles import Z_90
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration, misfit_of_pushes, scattered
from sim_backend.reality_gap.subjects.cube.hypotheses import Null, whitened, without_worst
from sim_backend.reality_gap.subjects.cube.replay import PushReplay
from sim_backend.reality_gap.subjects.cube.replayed_robot import ReplayedRobot
from sim_backend.reality_gap.subjects.cube.summary import NAMES, PLACED_NAMES, CubeEvidence, CubeSummary, summary_of_evidence
from sim_backend.reality_gap.subjects.cube.tracker import tracker_statistics
from sim_backend.reality_gap.subjects.cube.windows import LEAST_PUSHES, all_push_windows
from sim_backend.reality_gap.verdict import Cause, VerdictKind
from sim_backend.refusal import refused
from sim_backend.workers.pool import WorkersError, open_workers

_COVERED = 0.9
"""Share of robots whose numbers lie within as many standard deviations as of Gaussian ones, ``Z_90``."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="python -m sim_backend.reality_gap.bench.cube_of_many", description=__doc__)
    parser.add_argument("robots", type=Path, nargs="+", metavar="DIR", help="what bench.many_causes kept")
    parser.add_argument("--out", type=Path, default=CUBES_OF_MANY_FILE, help="table to be written; the package's if not given")
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    options = parser.parse_args(arguments)
    asked = [line for folder in options.robots for line in whole_lines(folder / LINES) if is_of_real(line)]
    values = {line["seed"]: line["values"] for line in asked if line["verdict"] == VerdictKind.NAMED}
    if not values:
        parser.error(f"there is no robot with all effects whose joints are named in {', '.join(map(str, options.robots))}")
    found: dict[int, np.ndarray] = {}
    try:
        with open_workers(_Replay, options.processes, options.cluster) as workers:
            for seed, row in zip(sorted(values), workers.map(sorted(values.items())), strict=True):
                found[seed] = row
                print(f"{len(found)} of {len(values)} robots", file=sys.stderr, flush=True)
        seen = {seed: row for seed, row in found.items() if np.isfinite(row).all()}
        table = document(list(seen.values()), list(seen), load_calibration().null)
        options.out.write_text(json.dumps(table, indent=1) + "\n")
    except (OSError, WorkersError) as error:
        return refused(error, as_json=False)
    print(f"wrote {options.out}: {len(seen)} robots; {len(found) - len(seen)} with too few pushes were left out")
    return 0


def document(found: Sequence[np.ndarray], seeds: Sequence[int], healthy: Null) -> dict:
    """Middle and spread of each number over robots, and how far each robot is off by these: plain values for JSON.

    Args:
        found: of each robot, in the order of ``NAMES``, in standard deviations of healthy sessions.
        seeds: of the robots.
        healthy: the scatter of these.
    """
    rows, kept = np.array(found), [NAMES.index(name) for name in PLACED_NAMES]
    middles = np.median(rows, axis=0)
    spreads = np.maximum(np.quantile(np.abs(rows - middles), _COVERED, axis=0) / Z_90, 1.0)
    middle, spread = ({NAMES[k]: round(float(values[k]), 3) for k in kept} for values in (middles, spreads))
    here = scattered(healthy, middle, spread)
    vectors = healthy.mean + rows * np.sqrt(np.diag(healthy.covariance))
    sessions = [whitened(CubeSummary(vector, None, None), here) for vector in vectors]
    misfits = sorted(round(misfit_of_pushes(session, session.vector), 4) for session in sessions)
    return {"robots": list(seeds), "middle": middle, "spread": spread, "misfits": misfits}


class _Replay:
    """What a worker does: the numbers of one robot, as far as they are from healthy ones; NaN with too few pushes."""

    def __call__(self, item: tuple[int, Sequence[Mapping]], _: None = None) -> np.ndarray:
        seed, values = item
        true, null = robot(seed), load_calibration().null
        base = ReplayedRobot.of(physics_of(writable([_cause(row) for row in values])))
        for effect, key in PUSHED.items():
            base = base.with_values(effect, np.ravel(true.value(key)))
        (recordings,) = sessions_with_pushes(true, [seed])
        windows = all_push_windows(base.as_it_was(recordings))
        if len(windows) < LEAST_PUSHES:
            return np.full(len(NAMES), np.nan)
        replayed = PushReplay(base=base).replay(windows)
        evidence = CubeEvidence(tracker_statistics(recordings), tuple(replayed), base.rest_height_m)
        summary = summary_of_evidence(without_worst(evidence, null))
        return (summary.vector - null.mean) / np.sqrt(np.diag(null.covariance))


def _cause(row: Mapping) -> Cause:
    effect, _, parameter = row["key"].partition(".")
    low, high = row["interval_90"]
    value = likeliest(row["key"], row["value"], (low, high), row["nominal"])
    return Cause(effect, parameter, row["where"], value, PARAMETERS[row["key"]].unit, (low, high))


if __name__ == "__main__":
    sys.exit(main())
