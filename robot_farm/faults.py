"""Faults that befall a robot: scheduled by its operator or drawn by chance; each is a change of the robot's physics.

A fault is written ``ROBOT:KIND[:WHERE[:SIZE]][@TRIAL[+SECONDS]]``, for example
``robot-1:stuck_joint:finger0_base_to_upper@2+3.5``: from 3.5 simulated seconds into the robot's third trial on (trials count
from 0). Without seconds it is there before that trial begins, without a trial from the robot's start.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c

CAMERA_NAMES = tuple(camera.name for camera in c.CAMERAS)
RESTART_S = 0.5
"""How long a controller sends no torque while it restarts."""
STUCK_TORQUE_NM = 1.0
"""Holding torque of a stuck joint: more than twice what its motor has."""
LONGEST_TRIAL_S = 15.0
"""A fault drawn by chance comes within so much of its trial's begin."""
FORM = "ROBOT:KIND[:WHERE[:SIZE]][@TRIAL[+SECONDS]]"
_PATTERN = re.compile(
    r"(?P<robot>[a-z0-9-]{1,40}):(?P<kind>\w+)(?::(?P<where>[a-z]\w*))?(?::(?P<size>-?[0-9.]+))?"
    r"(?:@(?P<trial>\d+)(?:\+(?P<at_s>[0-9.]+))?)?"
)


@dataclass(frozen=True)
class Kind:
    """A sort of fault: the parameter that it sets, the places it may befall and how much it is if nothing is said."""

    key: str
    places: tuple[str, ...]
    size: float
    takes_size: bool = False
    lasts_s: float | None = None


KINDS: dict[str, Kind] = {
    "stuck_joint": Kind("stuck_joint.holding_torque_nm", c.JOINT_NAMES, STUCK_TORQUE_NM, takes_size=True),
    "dead_camera": Kind("dead_camera.dead", CAMERA_NAMES, 1.0),
    "encoder_jump": Kind("encoder_jump.offset_rad", c.JOINT_NAMES, 0.3, takes_size=True),
    "controller_restart": Kind("controller_restart.off", (), 1.0, lasts_s=RESTART_S),
}


@dataclass(frozen=True)
class Fault:
    """One fault. ``trial`` counts the robot's trials from 0; ``at_s`` is None where it comes before that trial begins."""

    robot: str
    kind: str
    where: str | None
    size: float
    trial: int = 0
    at_s: float | None = None

    def starts_at_s(self) -> float:
        """Simulated seconds into its trial; a controller that restarts does so within the trial."""
        return 0.0 if self.at_s is None else self.at_s

    def ends_at_s(self) -> float | None:
        """When it passes by itself, None if never."""
        lasts_s = KINDS[self.kind].lasts_s
        return None if lasts_s is None else self.starts_at_s() + lasts_s

    def is_there_before(self, trial: int) -> bool:
        """Whether the robot has it when trial number ``trial`` begins."""
        if KINDS[self.kind].lasts_s is not None or trial < self.trial:
            return False
        return trial > self.trial or self.at_s is None

    def comes_within(self, trial: int) -> bool:
        """Whether it befalls the robot in the course of trial number ``trial``."""
        return trial == self.trial and not self.is_there_before(trial)


@dataclass(frozen=True)
class Change:
    """The robot's physics from a moment of a trial on."""

    at_s: float
    physics: Physics


def parse_fault(text: str) -> Fault:
    """A fault from its written form.

    Raises:
        ValueError: the text has another form, or names a kind, place or size that does not exist.
    """
    match = _PATTERN.fullmatch(text)
    if match is None:
        raise ValueError(f"fault {text!r} does not have the form {FORM}")
    kind = KINDS.get(match["kind"])
    if kind is None:
        raise ValueError(f"fault {text!r} is of unknown kind {match['kind']!r}; choose from {', '.join(KINDS)}")
    where = match["where"]
    if kind.places and where not in kind.places:
        raise ValueError(f"fault {text!r} is at {where or 'nothing'!r}; choose from {', '.join(kind.places)}")
    if where is not None and not kind.places:
        raise ValueError(f"fault {text!r}: {match['kind']} affects the whole robot; leave out {where!r}")
    if match["size"] is not None and not kind.takes_size:
        raise ValueError(f"fault {text!r}: {match['kind']} has no size, leave out {match['size']!r}")
    size = kind.size if match["size"] is None else float(match["size"])
    at_s = None if match["at_s"] is None else float(match["at_s"])
    fault = Fault(match["robot"], match["kind"], where, size, int(match["trial"] or 0), at_s)
    changed(Physics.nominal(), (fault,))  # the catalogue knows the bounds
    return fault


def changed(physics: Physics, faults: Sequence[Fault]) -> Physics:
    """The physics of a robot (n = 1) that has these faults, too."""
    for fault in faults:
        kind = KINDS[fault.kind]
        values = physics.value(kind.key).copy()
        if kind.places:
            values[0, kind.places.index(str(fault.where))] = fault.size
        else:
            values[0] = fault.size
        physics = physics.changed({kind.key: values})
    return physics


def timeline(physics: Physics, faults: Sequence[Fault], trial: int) -> tuple[Physics, tuple[Change, ...]]:
    """What a robot's physics are when a trial begins and how they change within it.

    Args:
        physics: of the robot without faults.
        faults: all that befall this robot.
        trial: number of the trial, from 0.

    Returns:
        The physics at the begin and the changes after it, in order of time.
    """
    coming = [fault for fault in faults if fault.comes_within(trial)]
    moments = {fault.starts_at_s() for fault in coming} | {end for fault in coming if (end := fault.ends_at_s()) is not None}
    before = [fault for fault in faults if fault.is_there_before(trial)]

    def there(at_s: float) -> list[Fault]:
        now = [f for f in coming if f.starts_at_s() <= at_s and ((end := f.ends_at_s()) is None or at_s < end)]
        return before + now

    changes = tuple(Change(at_s, changed(physics, there(at_s))) for at_s in sorted(moments))
    return changed(physics, before), changes


def draw_fault(rng: np.random.Generator, robot: str, trial: int) -> Fault:
    """A fault of any kind, anywhere, at any time of a trial."""
    name = list(KINDS)[rng.integers(len(KINDS))]
    kind = KINDS[name]
    where = kind.places[rng.integers(len(kind.places))] if kind.places else None
    size = kind.size * (rng.choice((-1.0, 1.0)) if name == "encoder_jump" else 1.0)
    return Fault(robot, name, where, float(size), trial, float(rng.uniform(0.0, LONGEST_TRIAL_S)))
