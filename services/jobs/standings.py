"""Entries of a leaderboard, policies and recipes, and which of them can be told apart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from api_schemas.anytime import is_decided, rate_sequence
from api_schemas.letters import letters_where, pair_chance
from api_schemas.recipe import Counts, seeds_interval
from api_schemas.success_rate import wilson
from services.database.rows import AnyRow
from services.jobs.outcomes import SUCCEEDED

MOST_COMPARED = 26
"""Entries that get letters, the best ones."""


@dataclass
class Entry:
    """What has one place on a board: a policy, or a recipe with the pooled rows of its policies."""

    rows: Sequence[AnyRow]
    recipe: str | None = None
    of_seeds: Sequence[Counts] = field(init=False)
    """Successes and trials of each policy."""
    successes: int = field(init=False)
    trials: int = field(init=False)
    judged: bool = field(init=False)
    """Whether a question may have ended one of the jobs."""

    def __post_init__(self) -> None:
        self.of_seeds = [(row.successes, row.trials) for row in self.rows]
        self.successes = sum(successes for successes, _ in self.of_seeds)
        self.trials = sum(trials for _, trials in self.of_seeds)
        self.judged = any(row.judged for row in self.rows)

    @property
    def rate(self) -> float:
        """Of a recipe the mean of its seeds' rates."""
        return sum(successes / trials for successes, trials in self.of_seeds) / len(self.rows)

    def interval(self, level: float, *, at_every_look: bool = False) -> tuple[float, float]:
        """Of the rate; a recipe's is one over its seeds."""
        by_sequence = self.judged or at_every_look
        if self.recipe is not None:
            return seeds_interval(self.of_seeds, level, at_every_look=by_sequence)
        return (rate_sequence if by_sequence else wilson)(self.successes, self.trials, level)


def entries(rows: Sequence[AnyRow]) -> list[Entry]:
    """Policies and recipes, from rows that are pooled by policy, recipe and the recipe's owner.

    A recipe of one policy is that policy: nothing is known of its other seeds.
    """
    recipes: dict[tuple[str, str], list[AnyRow]] = {}
    policies: dict[str, list[AnyRow]] = {}
    for row in rows:
        if row.recipe is not None:
            recipes.setdefault((row.recipe_owner, row.recipe), []).append(row)
    found = [Entry(of_it, recipe) for (_, recipe), of_it in recipes.items() if len(of_it) > 1]
    alone = {id(of_it[0]) for of_it in recipes.values() if len(of_it) == 1}
    for row in rows:
        if row.recipe is None or id(row) in alone:
            policies.setdefault(row.policy, []).append(row)
    return found + [Entry([_pooled(of_it)]) for of_it in policies.values()]


@dataclass(frozen=True)
class _Pooled:
    """Rows of one policy, as one."""

    policy: str
    name: str
    owner: str
    jobs: int
    trials: int
    successes: int
    judged: int
    last: str


def _pooled(rows: Sequence[AnyRow]) -> AnyRow:
    if len(rows) == 1:
        return rows[0]
    sums = {name: sum(getattr(row, name) for row in rows) for name in ("jobs", "trials", "successes", "judged")}
    last = max(row.last for row in rows)
    return _Pooled(policy=rows[0].policy, name=rows[0].name, owner=rows[0].owner, last=last, **sums)  # pyrefly: ignore[bad-return]


@dataclass
class Tried:
    """How a policy's counted trials ended, by the seed of their job, in the order in which the jobs ended."""

    by_seed: dict[int, str] = field(default_factory=dict)

    def add(self, seed: int, outcomes: str) -> None:
        """One more job."""
        self.by_seed[seed] = self.by_seed.get(seed, "") + outcomes


def pairs_of(one: Tried, other: Tried) -> tuple[int, int]:
    """On how many pairs of trials only the one, and only the other succeeded.

    Goals that both have tried are paired with each other, all other trials in the order in which jobs ended: pairs never
    change, and two equal policies gain and lose alike, so that evidence of them holds at every look.
    """
    common = one.by_seed.keys() & other.by_seed.keys()
    pairs = [pair for seed in common for pair in zip(one.by_seed[seed], other.by_seed[seed], strict=False)]
    rest = ["".join(told for seed, told in each.by_seed.items() if seed not in common) for each in (one, other)]
    pairs += zip(*rest, strict=False)
    return sum(a == SUCCEEDED != b for a, b in pairs), sum(b == SUCCEEDED != a for a, b in pairs)


def letters_of(ranked: Sequence[Entry], tried: Mapping[str, Tried]) -> list[str | None]:
    """Letters of the best entries; the chance of any false pair among all entries is ``letters.CHANCE`` at most.

    Two policies are told apart by the evidence of their pairs; a recipe from another entry where intervals at the pair's chance
    have nothing in common, since the trials of its policies are not alike.
    """
    chance, shown = pair_chance(len(ranked)), ranked[:MOST_COMPARED]
    if len(shown) < 2:
        return [None] * len(ranked)
    wide = {at: each.interval(1 - chance / 2, at_every_look=True) for at, each in enumerate(shown)}

    def differ(one: int, other: int) -> bool:
        if shown[one].recipe is None and shown[other].recipe is None:
            policies = [tried.get(shown[at].rows[0].policy, Tried()) for at in (one, other)]
            return is_decided(*pairs_of(*policies), chance)
        return wide[one][0] > wide[other][1] or wide[other][0] > wide[one][1]

    return [*letters_where(len(shown), differ), *[None] * (len(ranked) - len(shown))]
