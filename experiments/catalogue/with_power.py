"""Earlier experiments asked again so that they can decide: more trainings, and farms of more robots."""

from dataclasses import replace

from experiments.catalogue.robots import ABLATION, GROUPS, START, practised
from experiments.design import Cell, Experiment, Farm, FarmTrials

SEEDS = (1, 2, 3, 4)
ROBOTS = 16
_BEGUN = replace(START, of_each_seed=True)


def _cell(name: str, about: str, label: str, physics: str = "real", without: tuple[str, ...] = ()) -> Cell:
    return Cell(name, about, SEEDS, practised(physics, without, _BEGUN), label=label)


ABLATION_AGAIN = Experiment(
    letter="e2",
    name="ablation-again",
    title="Which differences it takes, four trainings a cell",
    question=ABLATION.question,
    claims=ABLATION.claims,
    limits="Every seed begins with a training of its own, 4 million samples on nominal robots, from which all its cells go on: "
    "a contrast compares what the last 1.2 million samples made of the same four beginnings, so that the intervals hold for "
    "trainings of other seeds. A policy that had been trained on varied robots from the first sample on may gain more or less. "
    "The groups are ours and are not cut as the paper's: of its effects that the simulator does not model, backlash and noise of "
    "the action are among our joints, and lost reports of the tracker are in our sensing. The farm's robots come from the same "
    "ranges as the training's (other seeds), which no real laboratory could know. Trainings, trials, interest and rule were "
    "written down on 27 November 2026, before the first of these trainings.",
    cells=(
        _cell("all", "robots of `real`", "all"),
        *(
            _cell(f"without-{group}", f"robots of `real`, but for their {group}", f"all but\n{group}", without=effects)
            for group, effects in GROUPS.items()
        ),
        _cell("none", "nominal robots", "none", physics="nominal"),
    ),
    contrasts=tuple(replace(contrast, repeats="") for contrast in ABLATION.contrasts),
    trials=FarmTrials("push", farms=(Farm("real", robots=ROBOTS),), seed=36_000, blocks=32, block=5),
    again=ABLATION.name,
)
