"""Contrasts of an experiment, judged from what is kept: where their two sides are read, and what is noted beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, median
from typing import Any

from api_schemas.physics import NOMINAL
from experiments.design import Cell, Contrast, Demonstrations, Experiment, Measure, robots_in_words
from experiments.farm_trials import by_goal, robot_by_goal
from experiments.judging import (
    Arrival,
    Chance,
    Difference,
    Observed,
    Verdict,
    arrival,
    hidden_effect,
    hidden_success,
    observed,
    paired_goals,
    paired_success,
    times_fewer,
    verdict,
)
from experiments.result_files import Key
from experiments.store import Store
from experiments.trainer import manifest_of
from sim_backend.tasks import TASKS
from sim_backend.training import reference_policies

SMALLER = "smaller than of interest"
Runs = Mapping[str, Sequence[tuple[int, Mapping[str, Any]]]]
"""Of each cell the finished trainings, with their seeds."""


@dataclass(frozen=True)
class Judged:
    """A contrast with what was found; ``observed`` of paired trials alone, where no floor or ceiling hides the effect."""

    contrast: Contrast
    found: Difference | None
    verdict: Verdict
    note: str = ""
    observed: Observed | None = None


@dataclass(frozen=True)
class _Sides:
    """What was found, why it may be hidden, what is to be said beside it, and what the trials show beside their difference."""

    found: Difference | None
    hidden: str = ""
    notes: tuple[str, ...] = ()
    observed: Observed | None = None


def judge(contrast: Contrast, experiment: Experiment, store: Store, runs: Runs) -> Judged:
    """Read both sides of a contrast and judge it; it waits for all runs of both."""
    first, other = experiment.cell(contrast.first), experiment.cell(contrast.other)
    match contrast.measure:
        case Measure.SUCCESS:
            sides = _success(contrast, experiment, store, first, other)
        case Measure.SAMPLES_TO:
            sides = _samples(experiment, first, other, runs)
        case Measure.GOALS:
            sides = _goals(contrast, experiment, store, first, other)
        case Measure.KNOWN:
            sides = _hidden_state(contrast, experiment, store, other)
    said = verdict(contrast, sides.found, sides.hidden)
    notes = [sides.hidden, *sides.notes] if sides.hidden else list(sides.notes)
    if sides.found is not None:
        if said in (Verdict.REPRODUCED, Verdict.FOUND) and not contrast.loss and sides.found.high < contrast.interest:
            notes.append(SMALLER)
        begun = [cell.training.start for cell in (first, other) if cell.training is not None]
        if any(start is not None and not start.of_each_seed for start in begun):
            notes.append(_continued(len(other.seeds)))
    if contrast.repeats:
        notes.append(f"repeats {contrast.repeats}, not counted again")
    if contrast.known_from:
        notes.insert(0, f"known from {contrast.known_from}")
    return Judged(contrast, sides.found, said, "; ".join(notes), None if sides.hidden else sides.observed)


def _continued(runs: int) -> str:
    return "both continue one training" if runs == 1 else f"{runs} continuations of one training"


@dataclass(frozen=True)
class Tried:
    """Of each run of a cell whether each goal was reached, and on which robot; ``robots`` is None where they are all alike."""

    reached: list[dict[int, bool]]
    robots: list[dict[int, str]] | None


def of_farm(cell: Cell, physics: str, experiment: Experiment, store: Store) -> Tried:
    """A cell's runs on one farm, of those whose blocks are all there."""
    assert experiment.trials is not None
    found = (store.trials(Key(cell.name, seed, physics)) for seed in cell.seeds)
    whole = [kept for kept in found if kept is not None and len(kept["blocks"]) == experiment.trials.blocks]
    return Tried(list(map(by_goal, whole)), None if physics == NOMINAL else list(map(robot_by_goal, whole)))


def _success(contrast: Contrast, experiment: Experiment, store: Store, first: Cell, other: Cell) -> _Sides:
    before, after = (of_farm(cell, contrast.farm, experiment, store) for cell in (first, other))
    if len(before.reached) < len(first.seeds) or len(after.reached) < len(other.seeds):
        return _Sides(None)
    robots = None if before.robots is None or after.robots is None else (before.robots, after.robots)
    if (found := paired_success(before.reached, after.reached, robots)) is None:
        return _Sides(None)
    moved = 0 if robots is None else sum(a[goal] != b[goal] for a, b in zip(*robots, strict=True) for goal in a.keys() & b.keys())
    notes = (f"{moved} of {found.n} pairs on two robots",) if moved else ()
    hidden = hidden_success(contrast, found, before.reached, after.reached)
    return _Sides(found, hidden, notes, observed(before.reached, after.reached))


def _goals(contrast: Contrast, experiment: Experiment, store: Store, first: Cell, other: Cell) -> _Sides:
    assert experiment.many_goals is not None
    keys = (Key(first.name, first.seeds[0], contrast.of_first), Key(other.name, other.seeds[0], contrast.farm))
    kept = [found for key in keys if (found := store.measured(key)) is not None]
    if len(kept) < len(keys):
        return _Sides(None)
    before, after = (each["reached"] for each in kept)
    found, most = paired_goals(before, after), experiment.many_goals.goals
    hidden = hidden_effect(contrast, found, median(before), median(after), most)
    sides = zip(keys, (before, after), strict=True)
    ended = [f"{reached.count(most)} of {len(reached)} trials on {robots_in_words(key.physics)}" for key, reached in sides]
    return _Sides(found, hidden, (f"all {most} goals: {', '.join(ended)}",) if most in (*before, *after) else ())


def demonstrated_periods(shown: Demonstrations | None) -> int:
    """Control periods of demonstrations: each is a whole trial of its task, at the rate of the policy that shows it."""
    if shown is None:
        return 0
    manifest = manifest_of(reference_policies.folder() / f"{shown.policy}.safetensors")
    return shown.count * (TASKS[shown.task].steps // manifest.period_steps)


def arrivals(cell: Cell, experiment: Experiment, runs: Runs) -> list[tuple[int, Arrival]]:
    """When each finished run of a cell first reached the experiment's rate, with its seed; demonstrated periods count."""
    if cell.training is None:
        return []
    before, budget = demonstrated_periods(cell.training.demonstrations), cell.training.samples
    return [(seed, arrival(run["evaluations"], experiment.reaches, budget, before)) for seed, run in runs.get(cell.name, ())]


def _samples(experiment: Experiment, first: Cell, other: Cell, runs: Runs) -> _Sides:
    sides, late = [], []
    for cell in (first, other):
        arrived = [each for _, each in arrivals(cell, experiment, runs)]
        if len(arrived) < len(cell.seeds):
            return _Sides(None)
        sides.append(arrived)
        if never := sum(each.by is None for each in arrived):
            late.append(f"{never} of {len(arrived)} runs of {cell.name} never arrived")
        if cloned := sum(each.before_practice for each in arrived):
            late.append(f"{cloned} of {len(arrived)} runs of {cell.name} were there before any PPO, by cloning alone")
    if all(each.before_practice for side in sides for each in side):
        late.append("a constant of the design: only numbers of demonstrations are compared")
    return _Sides(times_fewer(*sides), notes=tuple(late))


def known_by_parameter(experiment: Experiment, store: Store) -> dict[str, list[dict[str, Any]]]:
    """What memories know, by parameter; one entry for each run and instant."""
    found: dict[str, list[dict[str, Any]]] = {}
    for cell in experiment.cells:
        for seed in cell.seeds if experiment.hidden is not None and cell.name in experiment.hidden.cells else ():
            if (measured := store.measured(Key(cell.name, seed, "real"))) is None:
                continue
            for parameter, asked in measured["parameters"].items():
                found.setdefault(parameter, []).extend({"seed": seed} | each for each in asked)
    return found


def _hidden_state(contrast: Contrast, experiment: Experiment, store: Store, cell: Cell) -> _Sides:
    """At the last instant; over several runs the lowest and highest bound, since all drive the same robots."""
    known = known_by_parameter(experiment, store).get(contrast.parameter, ())
    entries = [each for each in known if each["seed"] in cell.seeds]
    if len({each["seed"] for each in entries}) < len(cell.seeds):
        return _Sides(None)
    last = max(each["at_s"] for each in entries)
    of_runs = [each for each in entries if each["at_s"] == last]
    low, high = min(each["low"] for each in of_runs), max(each["high"] for each in of_runs)
    estimate, over = mean(each["difference"] for each in of_runs), (Chance.ROBOTS, Chance.ROBOTS)
    found = Difference(estimate, low, high, of_runs[0]["robots"], len(of_runs), widest=over)
    notes = [f"after {last:g} s"]
    if all("told_by_state" in each for each in of_runs):
        told = mean(each["told_by_state"] for each in of_runs)
        notes.append(f"whether above the mean told rightly of {told:.0%} of the robots")
    return _Sides(found, notes=tuple(notes))
