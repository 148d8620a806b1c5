"""What healthy sessions look like: ``python -m sim_backend.reality_gap.bench.joint_calibration --sessions N --seed S --lines F``.

Stage A measures what a healthy session seems to have of effects that healthy robots do not have (the tolerances), stage B, with
these, the largest gain of each session (the null) and how far estimates scatter (the detection limits). Both go on where they
stopped: one line of JSON for each session.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.bench.counting import whole_lines
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, IN_THE_AIR, healthy_physics, simulated_recordings
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
LEAST_GATE, GATE_FACTOR, GATE_MARGIN = 3.0, 1.1, 1.5
"""Of few sessions: a margin of 1.5 nats makes what one in 200 reaches for each of some 20 effects a matter of 2 % for all."""
TAIL, REACHED_BY = 10, 1e-3
"""Of many: an effect's largest gains have an exponential tail. What one session in a thousand reaches is the same 2 % for all."""
ALONE_RULE = (10.0, 2.0, 5.0)
"""Where one excitation tells little, gains have heavy tails: by the usual rule 5 of 48 fresh robots were blamed (seed 42)."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Measure healthy sessions.")
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--lines", type=Path, required=True, help="one line of JSON for each session")
    parser.add_argument(
        "--excitation", default="standard", choices=(*IN_THE_AIR, EVERYTHING), help="what each session is seen by"
    )
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
            for found in workers.map(groups, (options.seed, options.excitation)):
                file.writelines(json.dumps(line) + "\n" for line in found)
                file.flush()
    except (OSError, WorkersError) as error:
        return refused(error, as_json=False)
    return 0


class _Measure:
    """What a worker does: the lines of some sessions by their numbers, of a seed and an excitation."""

    def __init__(self) -> None:
        self._model = compile_scene()

    def __call__(self, numbers: Sequence[int], of: tuple[int, str]) -> list[dict]:
        seed, excitation = of
        seeds = [int(np.random.SeedSequence([seed, n]).generate_state(1)[0]) for n in numbers]
        physics = Physics.stack([healthy_physics(each) for each in seeds])
        recordings = simulated_recordings(physics, seeds, excitation)
        shown = [{"number": number, "seed": seed, "excitation": excitation} for number in numbers]
        return [line | _measured(self._model, seen) for line, seen in zip(shown, recordings, strict=True)]


def _measured(model: mujoco.MjModel, recordings: Sequence[Recording]) -> dict:
    study = study_joints(model, recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings), gate=_NO_GATE)
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


def gates(null_lines: list[dict], rule: tuple[float, float, float] = (LEAST_GATE, GATE_FACTOR, GATE_MARGIN)) -> dict[str, float]:
    """Gain that a cause of each effect must have: beyond the largest of all healthy sessions by a margin, and not too little.

    Args:
        null_lines: of healthy sessions.
        rule: the least gate, nats; what the largest gain is multiplied by; and the margin beyond that, nats.
    """
    effects = dict.fromkeys(effect for line in null_lines for effect in line["gain_by_effect"])
    largest = {effect: max(line["gain_by_effect"].get(effect, 0.0) for line in null_lines) for effect in effects}
    least, factor, margin = rule
    return {effect: max(least, factor * gain + margin) for effect, gain in largest.items()}


def tail_gates(null_lines: Sequence[dict]) -> dict[str, float]:
    """Gain that a cause of each effect must have: what one healthy session in a thousand reaches, and not too little.

    Args:
        null_lines: of healthy sessions; of so few that they have no tail, :func:`gates` are given.
    """
    if len(null_lines) <= TAIL:
        return gates(list(null_lines))
    effects = dict.fromkeys(effect for line in null_lines for effect in line["gain_by_effect"])
    found = {}
    for effect in effects:
        gains = np.sort([line["gain_by_effect"].get(effect, 0.0) for line in null_lines])[::-1]
        usual = float(np.mean(gains[:TAIL] - gains[TAIL]))
        found[effect] = max(LEAST_GATE, float(gains[TAIL]) + usual * float(np.log(TAIL / (REACHED_BY * len(gains)))))
    return found


def summarise(tolerance_lines: list[dict], null_lines: list[dict]) -> dict:
    """The calibration file's content from the lines of both stages."""
    tolerances: dict[str, list[float]] = defaultdict(list)
    for label in sorted(tolerance_lines[0]["values"], key=_in_order):
        rows = [np.ravel(v) for line in tolerance_lines for v in line["values"].get(label, [])]
        spread = float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
        tolerances[label.partition("|")[0]].append(spread)
    return {
        "tolerances": dict(tolerances),
        "largest_gains": [line["gain"] for line in null_lines],
        "gates": tail_gates(null_lines),
        "largest_noise_ratio": [line["noise_ratio"] for line in null_lines],
        "seeds": sorted({line["seed"] for line in (*tolerance_lines, *null_lines)}),
        "sessions": [len(tolerance_lines), len(null_lines)],
    }


def summarise_again(calibration: dict, lines: list[dict]) -> dict:
    """The calibration with what healthy sessions gain now, after the tool has changed; what they seem to have stays."""
    own = tail_gates(lines)
    others = {name: calibration[name] for name in ("elsewhere", "alone")}
    raised = {"elsewhere": _raised(others["elsewhere"], own), "alone": {k: _raised(v, own) for k, v in others["alone"].items()}}
    again = {
        "largest_gains": [line["gain"] for line in lines],
        "gates": own,
        "largest_noise_ratio": [line["noise_ratio"] for line in lines],
        "seeds": sorted({*calibration["seeds"], *(line["seed"] for line in lines)}),
        "sessions": [calibration["sessions"][0], len(lines)],
    }
    return {**calibration, **again, **raised}


def _raised(sessions: dict, own: dict[str, float]) -> dict:
    """Sessions of other excitations, whose gates are those of the standard one at least."""
    before = sessions["gates"]
    return {**sessions, "gates": {effect: max(before.get(effect, 0.0), own.get(effect, 0.0)) for effect in {**before, **own}}}


def summarise_elsewhere(calibration: dict, lines: list[dict]) -> dict:
    """The calibration with what healthy sessions gain under other excitations than the standard one, from the lines of these."""
    own = gates(lines)
    effects = {**calibration["gates"], **own}
    kept = {effect: max(calibration["gates"].get(effect, 0.0), own.get(effect, 0.0)) for effect in effects}
    seen = [line["excitation"] for line in lines]
    elsewhere = {
        "largest_gains": [line["gain"] for line in lines],
        "gates": kept,
        "seeds": sorted({line["seed"] for line in lines}),
        "sessions": {excitation: seen.count(excitation) for excitation in dict.fromkeys(seen)},
    }
    return {**calibration, "elsewhere": elsewhere}


def summarise_alone(calibration: dict, lines: list[dict]) -> dict:
    """The calibration with what healthy sessions gain that saw one excitation alone, for each of those in the lines."""
    alone = dict(calibration.get("alone", {}))
    for excitation in dict.fromkeys(line["excitation"] for line in lines):
        mine = [line for line in lines if line["excitation"] == excitation]
        own = gates(mine, ALONE_RULE)
        alone[excitation] = {
            "largest_gains": [line["gain"] for line in mine],
            "gates": {effect: max(gate, own.get(effect, 0.0)) for effect, gate in {**own, **calibration["gates"]}.items()},
            "left_nats": ALONE_RULE[1] * max(line["left"] for line in mine) + ALONE_RULE[2],
            "seeds": sorted({line["seed"] for line in mine}),
            "sessions": len(mine),
        }
    return {**calibration, "alone": alone}


def _in_order(label: str) -> tuple[str, list[float]]:
    """Key first, then the numbers of shape and probe, as families are ordered."""
    key, *numbers = label.split("|")
    return key, [float(number.rpartition("=")[2]) for number in numbers]


def detection_limits(null_lines: list[dict]) -> dict[str, float]:
    """The deviation that a test told of effect and place finds at level 1 % in half of the sessions, by parameter.

    That of a loss through heat is told for the temperature that the catalogue's motors reach.
    """
    limits: dict[str, float] = {}
    for label in null_lines[0]["values"]:
        rows = [np.hypot.reduce(np.atleast_1d(v)) for line in null_lines for v in line["values"].get(label, [])]
        key = label.partition("|")[0]
        limits[key] = max(limits.get(key, 0.0), float(np.quantile(np.abs(rows), 0.99)))
    for key, number in NUMBERS.items():
        if number.product_with is not None and key in limits:
            other, fitted = number.product_with
            limits[key] *= fitted / PARAMETERS[other].absent
    return limits


if __name__ == "__main__":
    raise SystemExit(main())
