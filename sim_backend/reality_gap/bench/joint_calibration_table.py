"""The tables that studies of a TriFinger read, of the lines of healthy sessions that ``joint_calibration`` measured.

``python -m sim_backend.reality_gap.bench.joint_calibration_table --tolerances A --healthy B --elsewhere C --alone D`` writes
``knowledge/healthy_joints.json``, which has tolerances and gates, and the detection limits of what is fitted
(``knowledge/detection_limits.json``). With ``--tolerances`` alone it writes these, which all other sessions are measured with.
Without it they stay, and only what healthy sessions gain is renewed, after the tool has changed.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.bench.counting import whole_lines
from sim_backend.reality_gap.knowledge.healthy import LIMITS_FILE, SESSIONS_FILE
from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS

LEAST_GATE, GATE_FACTOR, GATE_MARGIN = 3.0, 1.1, 1.5
"""Of few sessions: a margin of 1.5 nats makes what one in 200 reaches for each of some 20 effects a matter of 2 % for all."""
TAIL, REACHED_BY = 10, 1e-3
"""Of many: an effect's largest gains have an exponential tail. What one session in a thousand reaches is the same 2 % for all."""
ALONE_RULE = (10.0, 2.0, 5.0)
"""Where one excitation tells little, gains have heavy tails: by the usual rule 5 of 48 fresh robots were blamed (seed 42)."""


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Make the tables of healthy sessions.")
    parser.add_argument("--tolerances", type=Path, help="lines of standard sessions, measured with --without-tolerances")
    parser.add_argument("--healthy", type=Path, help="lines of standard sessions, measured with the tolerances that are kept")
    parser.add_argument("--elsewhere", type=Path, help="lines of sessions under other excitations")
    parser.add_argument("--alone", type=Path, help="lines of sessions under one excitation alone")
    parser.add_argument("--sessions-file", type=Path, default=SESSIONS_FILE, help="what is renewed (%(default)s)")
    parser.add_argument("--limits-file", type=Path, default=LIMITS_FILE, help="what is renewed (%(default)s)")
    options = parser.parse_args(arguments)
    paths = (options.tolerances, options.healthy, options.elsewhere, options.alone)
    tolerances, healthy, elsewhere, alone = ([] if path is None else whole_lines(path) for path in paths)
    if not (tolerances or healthy or elsewhere or alone):
        parser.error("there is nothing to make a table of: give lines of healthy sessions")
    table = json.loads(options.sessions_file.read_text(encoding="utf-8"))
    if tolerances:
        table |= {"tolerances": tolerances_of(tolerances), "sessions": [len(tolerances), table["sessions"][1]]}
    table = summarise_again(table, healthy) if healthy else table
    table = summarise_elsewhere(table, elsewhere) if elsewhere else table
    table = summarise_alone(table, alone) if alone else table
    options.sessions_file.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    if healthy:
        limits = json.loads(options.limits_file.read_text(encoding="utf-8"))
        limits |= {"sessions": len(healthy), "seed": healthy[0]["seed"], "limits": limits["limits"] | detection_limits(healthy)}
        options.limits_file.write_text(json.dumps(limits, indent=1) + "\n", encoding="utf-8")
    print(f"{options.sessions_file} written" + (f", and {options.limits_file}" if healthy else ""))
    return 0


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


def tolerances_of(tolerance_lines: Sequence[dict]) -> dict[str, list[float]]:
    """What healthy sessions seem to have of effects that healthy robots lack, by parameter, one number for each shape."""
    tolerances: dict[str, list[float]] = defaultdict(list)
    for label in sorted(tolerance_lines[0]["values"], key=_in_order):
        rows = [np.ravel(v) for line in tolerance_lines for v in line["values"].get(label, [])]
        spread = float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
        tolerances[label.partition("|")[0]].append(spread)
    return dict(tolerances)


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
