"""What healthy sessions look like: ``python -m sim_backend.reality_gap.bench.joint_calibration --sessions N --seed S --lines F``.

Stage A (``--without-tolerances``) measures what a healthy session seems to have of effects that healthy robots do not have: the
tolerances. Stage B measures, with these, the largest gain of each session and how far estimates scatter. Both go on where they
stopped: one line of JSON for each session. ``joint_calibration_table`` makes the files that a study reads of such lines.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.bench.counting import whole_lines
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, IN_THE_AIR, healthy_physics, simulated_recordings
from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.torques.look import Look
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import patterns
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import strongest_left
from sim_backend.refusal import refused
from sim_backend.trifinger.scene import compile_scene
from sim_backend.workers.pool import WorkersError, open_workers

_NO_GATE = 1e18
_TOGETHER = 6


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Measure healthy sessions.")
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--lines", type=Path, required=True, help="one line of JSON for each session")
    parser.add_argument(
        "--excitation", default="standard", choices=(*IN_THE_AIR, EVERYTHING), help="what each session is seen by"
    )
    parser.add_argument("--without-tolerances", action="store_true", help="stage A: nothing is known of healthy sessions yet")
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    options = parser.parse_args(arguments)
    kept = whole_lines(options.lines)
    done = {line["number"] for line in kept}
    todo = [number for number in range(options.sessions) if number not in done]
    groups = [todo[first : first + _TOGETHER] for first in range(0, len(todo), _TOGETHER)]
    try:
        options.lines.write_text("".join(json.dumps(line) + "\n" for line in kept))
        with open_workers(_Measure, options.processes, options.cluster) as workers, options.lines.open("a") as file:
            for found in workers.map(groups, (options.seed, options.excitation, options.without_tolerances)):
                file.writelines(json.dumps(line) + "\n" for line in found)
                file.flush()
    except (OSError, WorkersError) as error:
        return refused(error, as_json=False)
    return 0


class _Measure:
    """What a worker does: the lines of some sessions by their numbers, of a seed and an excitation."""

    def __init__(self) -> None:
        self._model = compile_scene()

    def __call__(self, numbers: Sequence[int], of: tuple[int, str, bool]) -> list[dict]:
        seed, excitation, knows_nothing = of
        seeds = [int(np.random.SeedSequence([seed, n]).generate_state(1)[0]) for n in numbers]
        physics = Physics.stack([healthy_physics(each) for each in seeds])
        recordings = simulated_recordings(physics, seeds, excitation)
        shown = [{"number": number, "seed": seed, "excitation": excitation} for number in numbers]
        robots = [KnownTriFinger(NO_SESSIONS) if knows_nothing else KnownTriFinger.seen_in(seen) for seen in recordings]
        each = zip(shown, recordings, robots, strict=True)
        return [line | _measured(self._model, seen, robot) for line, seen, robot in each]


def _measured(model: mujoco.MjModel, recordings: Sequence[Recording], robot: KnownTriFinger) -> dict:
    study = study_joints(model, recordings, lambda *_: None, robot=robot, gate=_NO_GATE)
    look, values = study.fit.first, defaultdict(list)
    for candidate in look.candidates:
        terms = [look.catalogue.terms[i] for i in candidate.hypothesis.terms]
        if candidate.hypothesis.where.startswith("all") or candidate.hypothesis.is_part:
            continue
        label = terms[0].key + "".join(f"|{key}={value:g}" for key, value in terms[0].shape) + f"|{terms[0].probe:.6g}"
        if terms[0].key in NUMBERS and NUMBERS[terms[0].key].begins_at_load:
            label = terms[0].key
        values[label].append([float(v) for v in candidate.values])
    best = look.best
    return {
        "gain": best.gain if best is not None else 0.0,
        "name": list(best.hypothesis.name) if best is not None else [],
        "gain_by_effect": _gain_by_effect(look),
        "left": strongest_left(study, patterns(study.problem.episodes, look, study.start.size)),
        "noise_ratio": float(look.noise_ratio.max()),
        "findings": [f.effect for f in study.findings],
        "values": values,
    }


def _gain_by_effect(look: Look) -> dict[str, float]:
    gains: dict[str, float] = {}
    for candidate in look.candidates:
        if candidate.allowed:
            effect = candidate.hypothesis.effect
            gains[effect] = max(gains.get(effect, -1e9), candidate.gain)
    return gains


if __name__ == "__main__":
    raise SystemExit(main())
