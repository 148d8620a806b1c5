"""A job's trials at a glance: small pictures grouped by why they failed, and where on the arena's floor goals are reached."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from api_schemas.goal import ARENA_RADIUS_M
from api_schemas.trial import Fault, Glimpse, Outcome, OutcomeKind
from services.database.rows import AnyRow

MOST_TILES = 120
POSE_NUMBERS = 7
SUCCEEDED = "succeeded"
WORDS = {
    "at_wall": "at the wall",
    "finger_off": "a finger away from its goal",
    "held_off": "held beside the goal",
    "late": "on its way at the end",
    "left": "left its goal",
    "saturated": "at the torque limit",
    "still": "lies still",
    "tracker_lost": "tracker lost it",
    "tracker_off": "tracker was off",
    "untouched": "not touched",
    "wrong_angle": "turned away",
}
"""What a kind of failure is called where its word alone would not be understood."""


@dataclass(frozen=True)
class Tile:
    """A trial's small picture, which leads to the moment that decided it."""

    trial_id: str
    ordinal: int
    robot: str
    succeeded: bool
    sentence: str
    address: str


@dataclass(frozen=True)
class Group:
    """Trials that ended for one kind of reason."""

    word: str
    tiles: tuple[Tile, ...]
    left_out: int


@dataclass(frozen=True)
class Spot:
    """A goal on the floor, in percent of the arena's width; y counts from the top."""

    x: float
    y: float
    height_mm: float
    tile: Tile


def grouped(ended: Sequence[tuple[AnyRow, Outcome]]) -> list[Group]:
    """Pictures of trials that ended: each kind of failure, the most frequent first, then successes."""
    of: dict[str, list[Tile]] = defaultdict(list)
    for row, outcome in ended:
        of[_word(outcome)].append(_tile(row, outcome))
    words = sorted(of, key=lambda word: (word == SUCCEEDED, -len(of[word]), word))
    groups, room = [], MOST_TILES
    for word in words:
        shown = of[word][:room]
        groups.append(Group(word, tuple(shown), len(of[word]) - len(shown)))
        room -= len(shown)
    return groups


def _word(outcome: Outcome) -> str:
    if outcome.kind == OutcomeKind.SUCCEEDED:
        return SUCCEEDED
    if outcome.fault == Fault.POLICY:
        return f"policy error: {outcome.kind.replace('_', ' ')}"
    kind = str(outcome.kind if outcome.failure is None else outcome.failure.kind)
    return WORDS.get(kind, kind.replace("_", " "))


def _tile(row: AnyRow, outcome: Outcome) -> Tile:
    cause = outcome.failure
    succeeded = outcome.kind == OutcomeKind.SUCCEEDED
    at = "" if cause is None or cause.at_s is None else f"?t={cause.at_s:.2f}"
    sentence = outcome.reason if cause is None else cause.sentence
    return Tile(row.trial_id, row.ordinal, row.robot or "", succeeded, sentence, f"/trials/{row.trial_id}{at}")


def spots(ended: Sequence[tuple[AnyRow, Outcome]]) -> list[Spot]:
    """Where goals lay that were an object's pose, seen from above with x to the right, and whether each was reached."""
    found = []
    for row, outcome in ended:
        goal = None if outcome.glimpse is None else outcome.glimpse.goal
        if goal is None or len(goal) != POSE_NUMBERS:
            continue
        x, y = (50 * (1 + each / ARENA_RADIUS_M) for each in goal[:2])
        found.append(Spot(x, 100 - y, 1e3 * goal[2], _tile(row, outcome)))
    return found


def glimpses(ended: Sequence[tuple[AnyRow, Outcome]]) -> dict[str, Glimpse]:
    """What the small pictures are drawn from, by trial."""
    return {row.trial_id: outcome.glimpse for row, outcome in ended if outcome.glimpse is not None}
