"""What an experiment is, as data: cells, budgets fixed before anything runs, trials, and the contrasts that are judged."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

BUILTIN = "builtin:"
FARM_SEED = 9001
"""Of every experiment's farm, so that all meet the same robots."""
START_SEEDS = 500_000_000
"""From here on the seeds of starts of single runs. A run that had its start's seed would practise its goals once more where
robots are nominal, for which nothing else is drawn. Resuming, which adds 1,000,003 each time, leads to none of them."""


def robots_in_words(*physics: str) -> str:
    """Robots of these physics as pages and figures call them; nobody may take the preset ``real`` for measured hardware."""
    return f"{' and '.join('varied' if each == 'real' else each for each in physics)} simulated robots"


@dataclass(frozen=True)
class Demonstrations:
    """Successful trials of a shipped policy, recorded with the same seeds for every run."""

    policy: str
    task: str
    count: int
    physics: str = "nominal"
    noise: float = 0.3


@dataclass(frozen=True)
class Start:
    """A training that the runs of several cells go on from, its critic included.

    It is made once, of one seed, or with ``of_each_seed`` once for each seed of the runs, which then share nothing. It is trained
    on ``threads``, as many on every machine: sums of another number of threads are rounded otherwise, and make another training.
    """

    name: str
    recipe: Mapping[str, Any]
    samples_per_s: float
    of_each_seed: bool = False
    seed: int = 1
    threads: int = 2

    def of(self, seed: int) -> "Start":
        """That which a run of this seed goes on from; it practises other goals than any run (:data:`START_SEEDS`)."""
        if not self.of_each_seed:
            return self
        return replace(self, name=f"{self.name}-seed{seed}", seed=START_SEEDS + seed, of_each_seed=False)

    @property
    def seconds(self) -> float:
        """On one thread."""
        return self.recipe["samples"] / self.samples_per_s


@dataclass(frozen=True)
class Training:
    """How the policy of a cell comes about.

    ``recipe`` is a training recipe without its seed; its physics may be ``real`` without some effects (``without``, their
    names). ``samples_per_s`` is what one thread does beside another run on two cores, evaluations included. With a ``start``
    it goes on from there.
    """

    recipe: Mapping[str, Any]
    samples_per_s: float
    without: tuple[str, ...] = ()
    demonstrations: Demonstrations | None = None
    start: Start | None = None

    @property
    def samples(self) -> int:
        """Of one run."""
        return self.recipe["samples"]

    @property
    def seconds(self) -> float:
        """Of one run on one thread."""
        return self.samples / self.samples_per_s


@dataclass(frozen=True)
class Look:
    """How a curve is drawn: the index of its colour, and whether dashed."""

    colour: int
    dashed: bool = False


@dataclass(frozen=True)
class Cell:
    """One condition: runs of a training, one for each seed, or a policy that is there already.

    ``runs_of`` names the experiment whose runs these are, so that none is made twice; the cell has the same name there unless
    ``runs_of_cell`` says another. ``label`` is what figures call it, a line break where it may be broken; ``look`` how its curve
    is drawn, if it shares a colour with others.
    """

    name: str
    about: str
    seeds: tuple[int, ...] = (1,)
    training: Training | None = None
    policy: str | None = None
    task: str | None = None  # of its trials, if not the experiment's
    object: str = "cube"
    object_scale: float = 1.0
    runs_of: str | None = None
    runs_of_cell: str | None = None
    label: str = ""
    look: Look | None = None

    @property
    def shown_as(self) -> str:
        """For figures."""
        return self.label or self.name.replace("-", " ")

    @property
    def is_builtin(self) -> bool:
        """Whether the policy comes with the farm and has no weights."""
        return self.policy is not None and self.policy.startswith(BUILTIN)


@dataclass(frozen=True)
class Farm:
    """The farm that an experiment starts: its robots' physics are drawn from ``seed``."""

    physics: str
    seed: int = FARM_SEED
    robots: int = 4


@dataclass(frozen=True)
class FarmTrials:
    """Trials through the farm's API: every cell meets the same goals and robots, in blocks that take turns.

    ``blocks`` times ``block`` trials for each run of each cell on each farm; block k has the job seed ``seed + k``.
    """

    task: str
    farms: tuple[Farm, ...] = (Farm("real"),)
    blocks: int = 4
    block: int = 10
    seed: int = 31_000
    trial_s: float = 0.6  # on two cores, measured with push on a farm that differs

    @property
    def trials(self) -> int:
        """Of one run on one farm."""
        return self.blocks * self.block


@dataclass(frozen=True)
class ManyGoals:
    """Goal after goal in simulation, until one is not reached in time, the object is dropped, or all are reached."""

    physics: tuple[str, ...] = ("nominal", "real")
    trials: int = 20
    goals: int = 50
    limit_s: float = 80.0
    first_seed: int = 50_000_000
    physics_step_s: float = 0.001


@dataclass(frozen=True)
class HiddenState:
    """What a memory knows of its robot: ridge regression on robots that it was not fitted to."""

    cells: tuple[str, ...]
    parameters: tuple[str, ...] = ("fingertip_friction.coefficient", "table_friction.coefficient", "cube_size.factor")
    robots: int = 600
    at_s: tuple[float, ...] = (1.0, 5.0)
    first_seed: int = 60_000_000


class Measure(StrEnum):
    """What a contrast compares."""

    SUCCESS = "success"  # of paired farm trials, as a fraction
    SAMPLES_TO = "samples to a rate"  # log2 of how many times fewer samples
    GOALS = "goals in a row"
    KNOWN = "held-out R2"  # of hidden state and observation together, above that of the observation of the same instant


UNITS = {
    Measure.SUCCESS: "success rate",
    Measure.SAMPLES_TO: "log2 of samples, first over other",
    Measure.GOALS: "goals",
    Measure.KNOWN: "R2",
}


@dataclass(frozen=True)
class Contrast:
    """A difference that is judged: ``other`` minus ``first``; the papers lead to expect it above 0, by ``interest`` at least.

    ``farm`` is the physics of the trials, ``first_farm`` that of the first one's if it is another. With ``loss`` no gain is
    expected but that less than ``interest`` is lost. For :attr:`Measure.KNOWN` ``first`` and ``other`` are the same cell and
    ``parameter`` says what is predicted. ``ours`` is a question that no paper answers: it is found or not, and nothing is
    reproduced. ``repeats`` names the contrast of another experiment whose policies these are, so that it is not counted twice,
    and ``known_from`` an earlier experiment whose results gave the answer away when this was written down.
    """

    name: str
    measure: Measure
    first: str
    other: str
    interest: float
    farm: str = "real"
    first_farm: str | None = None
    parameter: str = ""
    loss: bool = False
    ours: bool = False
    repeats: str = ""
    known_from: str = ""

    @property
    def of_first(self) -> str:
        """Physics of the first one's trials."""
        return self.first_farm or self.farm


@dataclass(frozen=True)
class Claim:
    """What a paper says, and where; its ``figure``, if it gives one, and the contrasts and cells of ours that answer it."""

    text: str
    source: str
    figure: str = ""
    answers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Experiment:
    """All of it; ``limits`` says what is not as in the papers.

    ``again`` names an earlier experiment that asked the same with less power: once all of this one is there it counts, and the
    earlier one no more, whose page stays. ``since`` is what was changed before its first trial that counts, or said of it later,
    each with its date.
    """

    letter: str
    name: str
    title: str
    question: str
    claims: tuple[Claim, ...]
    limits: str
    cells: tuple[Cell, ...]
    contrasts: tuple[Contrast, ...]
    trials: FarmTrials | None = None
    many_goals: ManyGoals | None = None
    hidden: HiddenState | None = None
    curves: bool = False
    reaches: float = 0.8
    quick: bool = field(default=False)
    again: str = ""
    since: tuple[str, ...] = ()

    def cell(self, name: str) -> Cell:
        """A cell by its name.

        Raises:
            ValueError: there is none.
        """
        for cell in self.cells:
            if cell.name == name:
                return cell
        raise ValueError(f"experiment {self.name} has no cell {name!r}; choose from {', '.join(c.name for c in self.cells)}")
