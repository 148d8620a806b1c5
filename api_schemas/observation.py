"""What a policy may see: fields by name, and terms that take them whole, in part, of earlier, several times, or say a constant.

| term | what it shows |
|---|---|
| ``joint_position_rad`` | the field |
| ``joint_position_rad[0:3]``, ``cube_quat_xyzw[3]`` | numbers 0 to 2 of it; number 3 |
| ``previous_action@2`` | the field as it was two control periods ago |
| ``joint_position_rad@3..0`` | its last four values, the oldest first; ``@0..3`` the newest first |
| ``constant(0, 0.5)`` | these numbers, always |

Before a trial's first value stand copies of it. A field may be named any number of times.
"""

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass

OBSERVATION_SIZES: dict[str, int] = {
    "joint_position_rad": 9,
    "joint_velocity_rad_s": 9,
    "joint_torque_nm": 9,
    "fingertip_position_world_m": 9,
    "cube_position_world_m": 3,
    "cube_quat_wxyz": 4,
    "cube_keypoints_world_m": 24,
    "tracker_confidence": 1,
    "tracker_delay_s": 1,
    "goal_position_world_m": 3,
    "goal_quat_wxyz": 4,
    "goal_keypoints_world_m": 24,
    "goal_fingertip_position_world_m": 9,
    "previous_action": 9,
    "fingertip_velocity_world_m_s": 9,
    "fingertip_force": 3,
    "cube_quat_xyzw": 4,
    "goal_quat_xyzw": 4,
    "robot_id": 1,
}
"""Every observation field a manifest may name, and how many numbers it holds."""

MOST_PERIODS_AGO = 50
MOST_CONSTANTS = 64
CONSTANT = "constant"
_TERM = re.compile(r"(?P<field>\w+)(\[(?P<first>\d+)(:(?P<stop>\d+))?\])?(@(?P<ago>\d+)(\.\.(?P<until>\d+))?)?")
_CONSTANT = re.compile(rf"{CONSTANT}\((?P<numbers>[^()]*)\)")


@dataclass(frozen=True)
class Term:
    """One entry of a manifest's observation.

    ``numbers`` are those of the field that are taken, ``periods_ago`` when, one after the other; a constant has no field.
    """

    text: str
    field: str | None
    numbers: range
    periods_ago: tuple[int, ...]
    constant: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """How many numbers it shows."""
        return len(self.constant) if self.field is None else len(self.numbers) * len(self.periods_ago)

    @property
    def is_whole(self) -> bool:
        """Whether it is a field's present value and nothing else."""
        return self.text == self.field


@functools.lru_cache(maxsize=4096)
def term_of(text: str) -> Term:
    """The term that a text stands for.

    Raises:
        ValueError: it stands for none; the message lists fields and forms.
    """
    if (found := _CONSTANT.fullmatch(text)) is not None:
        return Term(text, None, range(0), (), _constants(text, found["numbers"]))
    found = _TERM.fullmatch(text)
    if found is None or found["field"] not in OBSERVATION_SIZES:
        raise ValueError(
            f"unknown observation field {text!r:.80}; choose from {', '.join(sorted(OBSERVATION_SIZES))}; "
            "a part is FIELD[0:3], an earlier value FIELD@2, a history FIELD@3..0, a constant constant(0, 1)"
        )
    field, size = found["field"], OBSERVATION_SIZES[found["field"]]
    first = int(found["first"] or 0)
    stop = size if found["first"] is None else int(found["stop"] or first + 1)
    if not first < stop <= size:
        raise ValueError(f"{text}: {field} has the numbers 0 to {size - 1}, so that a part is at most {field}[0:{size}]")
    ago = int(found["ago"] or 0)
    until = int(found["until"]) if found["until"] else ago
    if max(ago, until) > MOST_PERIODS_AGO:
        raise ValueError(f"{text}: at most {MOST_PERIODS_AGO} control periods are remembered")
    step = 1 if until >= ago else -1
    return Term(text, field, range(first, stop), tuple(range(ago, until + step, step)))


def _constants(text: str, numbers: str) -> tuple[float, ...]:
    try:
        values = tuple(float(each) for each in numbers.split(","))
    except ValueError:
        raise ValueError(f"{text!r:.80}: write its numbers with commas, such as constant(0, 0.5)") from None
    if len(values) > MOST_CONSTANTS or not all(abs(each) <= 1e6 for each in values):
        raise ValueError(f"{text!r:.80}: at most {MOST_CONSTANTS} numbers of at most a million are taken")
    return values


def sizes_of(observation: Sequence[str]) -> tuple[int, ...]:
    """How many numbers each entry of an observation shows."""
    return tuple(term_of(text).size for text in observation)


def fields_of(observation: Sequence[str]) -> tuple[str, ...]:
    """The fields that an observation is made of, each once, in the order of their first use."""
    return tuple(dict.fromkeys(term.field for term in map(term_of, observation) if term.field is not None))


def number_name(observation: Sequence[str], index: int) -> str:
    """What number ``index`` of an observation is called, such as "joint_velocity_rad_s[4]"."""
    for text, size in zip(observation, sizes_of(observation), strict=True):
        if index < size:
            term = term_of(text)
            if term.field is None:
                return text
            at, ago = index % len(term.numbers), term.periods_ago[index // len(term.numbers)]
            name = f"{term.field}[{term.numbers[at]}]" if OBSERVATION_SIZES[term.field] > 1 else term.field
            return f"{name}@{ago}" if ago else name
        index -= size
    raise IndexError(f"the observation has {sum(sizes_of(observation))} numbers")
