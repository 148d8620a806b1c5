"""The structured controller: look, choose a grasp, get ready, close, carry, and begin again when the cube was lost."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from api_schemas.policy import OBSERVATION_SIZES, ActionKind, PolicyManifest
from sim_backend.grasping.choice import Grasp, choose_grasp, side_normals
from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m, joint_position_rad
from sim_backend.tasks.keypoints import rotation_matrix

MANIFEST = PolicyManifest(
    name="grasp",
    observation=(
        "joint_position_rad",
        "cube_position_world_m",
        "cube_quat_wxyz",
        "tracker_delay_s",
        "goal_position_world_m",
    ),
    action_kind=ActionKind.JOINT_POSITION,
)
PERIOD_S = 1 / MANIFEST.rate_hz

OVER_M = 0.120
"""Height at which fingers pass over the cube."""
FREE_SPEED_M_S, CLOSING_SPEED_M_S, CARRYING_SPEED_M_S = 0.25, 0.06, 0.12
SETTLING_S, CLOSING_S = 0.15, 0.5
"""After a motion is over, and after the tips should touch."""
PRESS_N, PRESS_ALONE_N = 2.0, 1.0
"""Of the two fingers that face each other, and of the third; less where a finger has not so much."""
CARRY_UP_M = 0.025
"""How far the cube is lifted before it is carried aside."""
OPENED_M = 0.03
REPORTS = 3
"""Of a cube that lies still, before a grasp is chosen."""
STILL_M, LOST_M, DROPPED_M, THERE_M = 0.015, 0.03, 0.018, 0.006
CORRECTION, LARGEST_CORRECTION_M = 0.4, 0.03
"""Share of what a report says is missing that is added to where the cube is asked to be, and how much in all."""


class Phase(StrEnum):
    """What the hand is doing."""

    LOOK = "look"
    RAISE = "raise"
    OVER = "over"
    DOWN = "down"
    CLOSE = "close"
    CARRY = "carry"
    OPEN = "open"


@dataclass(frozen=True)
class Sight:
    """One observation by its fields."""

    joint_position_rad: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    tracker_delay_s: float
    goal_position_world_m: np.ndarray

    @classmethod
    def of(cls, observation: np.ndarray) -> "Sight":
        """From a row as ``MANIFEST`` has it."""
        ends = np.cumsum([OBSERVATION_SIZES[name] for name in MANIFEST.observation])
        joints, cube, quat, delay, goal = np.split(np.asarray(observation, dtype=float), ends[:-1])
        return cls(joints, cube, quat, float(delay[0]), goal)


@dataclass
class Hand:
    """The controller of one trial. Owner of its phase, of the commanded tips and of the grasp."""

    phase: Phase = Phase.LOOK
    grasp: Grasp | None = None
    tip_m: np.ndarray | None = None  # commanded, (3, 3)
    failures: int = 0
    _ticks: int = 0  # since the phase began
    _arrived: int = 0  # since its motion was over
    _joints_rad: np.ndarray = field(default_factory=lambda: c.START_JOINT_POSITION_RAD.copy())
    _delay_s: float = np.inf
    _reports: list[tuple[np.ndarray, float]] = field(default_factory=list)  # newest last: place, and angle of the first face
    _low: int = 0  # reports one after the other that say the cube is not where it is held
    _cube_m: np.ndarray = field(default_factory=lambda: np.zeros(3))  # where the cube is asked to be while it is held
    _held_at_m: list[np.ndarray] = field(default_factory=list)  # the same, newest last
    _way_m: list[np.ndarray] = field(default_factory=list)
    _missing_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def act(self, sight: Sight) -> np.ndarray:
        """Joint positions to ask for, shape (9,), rad."""
        if self.tip_m is None:
            self.tip_m = fingertip_position_world_m(sight.joint_position_rad).reshape(3, 3)
        fresh = sight.tracker_delay_s <= self._delay_s
        self._delay_s = sight.tracker_delay_s
        self._ticks += 1
        getattr(self, f"_{self.phase}")(sight, fresh)
        return self._command(sight)

    def _go(self, phase: Phase) -> None:
        self.phase, self._ticks, self._arrived = phase, 0, 0

    def _look(self, sight: Sight, fresh: bool) -> None:
        if not fresh:
            return
        normals = side_normals(rotation_matrix(sight.cube_quat_wxyz))
        if normals is None:
            self._reports = []
            return
        self._reports = [*self._reports, (sight.cube_position_world_m, 4 * np.arctan2(normals[0, 1], normals[0, 0]))][-REPORTS:]
        places = np.array([place for place, _ in self._reports])
        if len(places) < REPORTS or np.ptp(places, axis=0).max() > STILL_M:
            return
        seen_m = np.median(places, axis=0)
        if np.linalg.norm(seen_m - sight.goal_position_world_m) < THERE_M:
            return
        angles = [angle for _, angle in self._reports]  # times four, since the faces of a cube are alike
        angle = np.arctan2(np.mean(np.sin(angles)), np.mean(np.cos(angles))) / 4
        turned = angle + np.arange(4) * np.pi / 2
        normals = np.stack([np.cos(turned), np.sin(turned), np.zeros(4)], axis=1)
        self.grasp = choose_grasp(seen_m, normals, sight.goal_position_world_m, rank=self.failures)
        if self.grasp is not None:
            self._cube_m = seen_m
            self._go(Phase.RAISE)

    def _raise(self, sight: Sight, fresh: bool) -> None:
        assert self.tip_m is not None
        if self._move(np.concatenate([self.tip_m[:, :2], np.full((3, 1), OVER_M)], axis=1), FREE_SPEED_M_S):
            self._go(Phase.OVER)

    def _over(self, sight: Sight, fresh: bool) -> None:
        ready = self._ready()
        if self._move(np.concatenate([ready[:, :2], np.full((3, 1), OVER_M)], axis=1), FREE_SPEED_M_S):
            self._go(Phase.DOWN)

    def _down(self, sight: Sight, fresh: bool) -> None:
        if self._move(self._ready(), FREE_SPEED_M_S, SETTLING_S):
            self._go(Phase.CLOSE)

    def _close(self, sight: Sight, fresh: bool) -> None:
        assert self.grasp is not None
        if self._move(self._cube_m + self.grasp.tip_m, CLOSING_SPEED_M_S, CLOSING_S):
            goal, here = self.grasp.goal_m, self._cube_m
            height = max(goal[2], here[2] + CARRY_UP_M)
            self._way_m = [np.array([*here[:2], height]), np.array([*goal[:2], height]), goal.copy()]
            self._held_at_m, self._missing_m, self._low = [], np.zeros(3), 0
            self._go(Phase.CARRY)

    def _carry(self, sight: Sight, fresh: bool) -> None:
        assert self.grasp is not None and self.tip_m is not None
        way = self._way_m[0] - self._cube_m
        step, length = CARRYING_SPEED_M_S * PERIOD_S, float(np.linalg.norm(way))
        self._cube_m = self._cube_m + way * min(1.0, step / max(length, 1e-9))
        if length <= step and len(self._way_m) > 1:
            self._way_m.pop(0)
        self._held_at_m.append(self._cube_m + self._missing_m)
        self.tip_m = self._cube_m + self._missing_m + self.grasp.tip_m
        late = round(sight.tracker_delay_s / PERIOD_S)
        if fresh and self._ticks > late + 5:
            asked = self._held_at_m[-1 - late] - self._missing_m
            missing = asked - sight.cube_position_world_m
            self._low = self._low + 1 if missing[2] > DROPPED_M or np.linalg.norm(missing) > LOST_M else 0
            if self._low >= 2:
                self.failures += 1
                self._go(Phase.OPEN)
            elif length <= step:
                more = self._missing_m + CORRECTION * missing
                self._missing_m = np.clip(more, -LARGEST_CORRECTION_M, LARGEST_CORRECTION_M)

    def _open(self, sight: Sight, fresh: bool) -> None:
        assert self.grasp is not None and self.tip_m is not None
        if self._ticks == 1:
            tips = fingertip_position_world_m(sight.joint_position_rad).reshape(3, 3)
            self._opened_m = tips - OPENED_M * self.grasp.inward
            self._opened_m[:, 2] = np.maximum(self._opened_m[:, 2], c.TIP_RADIUS_M + 0.005)
            self.tip_m = tips
        if self._move(self._opened_m, FREE_SPEED_M_S) or self._ticks > 40:
            self._reports, self.grasp = [], None
            self._go(Phase.LOOK)

    def _ready(self) -> np.ndarray:
        assert self.grasp is not None
        return self._cube_m + self.grasp.tip_m - self.grasp.clearance_m * self.grasp.inward

    def _move(self, target_m: np.ndarray, speed_m_s: float, wait_s: float = 0.0) -> bool:
        """A step towards a place; whether the tips have been asked to be there for so long."""
        assert self.tip_m is not None
        way = target_m - self.tip_m
        length = np.linalg.norm(way, axis=1, keepdims=True)
        self.tip_m = self.tip_m + way * np.minimum(1.0, speed_m_s * PERIOD_S / np.maximum(length, 1e-9))
        self._arrived = self._arrived + 1 if (length <= speed_m_s * PERIOD_S).all() else 0
        return self._arrived * PERIOD_S > wait_s

    def _command(self, sight: Sight) -> np.ndarray:
        """What makes the robot's own controller hold the fingers at the commanded tips and press."""
        assert self.tip_m is not None
        wanted = joint_position_rad(self.tip_m.reshape(9))
        self._joints_rad = np.where(np.isnan(wanted), self._joints_rad, wanted)
        self._joints_rad = np.clip(self._joints_rad, c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD)
        torque_nm = gravity_torque_nm(sight.joint_position_rad)
        if self.phase in (Phase.CLOSE, Phase.CARRY):
            torque_nm = torque_nm + self._pressing_nm(sight)
        return self._joints_rad + torque_nm / c.POSITION_GAIN_NM_RAD

    def _pressing_nm(self, sight: Sight) -> np.ndarray:
        assert self.grasp is not None
        facing = (self.grasp.inward @ self.grasp.inward.T < -0.9).any(axis=1)
        press = np.minimum(np.where(facing, min(PRESS_N, self.grasp.force_n[facing].min()), PRESS_ALONE_N), self.grasp.force_n)
        force = press[:, None] * self.grasp.inward
        if self.phase is Phase.CARRY:
            force = force + [0.0, 0.0, c.CUBE_MASS_KG * c.GRAVITY_M_S2 / 3]
        return np.einsum("fcj,fc->fj", tip_jacobian(sight.joint_position_rad), force).reshape(9)


class GraspPolicy:
    """The controller for many trials at once, as evaluations ask policies; each trial has a hand of its own."""

    manifest = MANIFEST

    def begin(self, trials: int) -> None:
        """Forget all that was."""
        self.hands = [Hand() for _ in range(trials)]

    def __call__(self, observation: np.ndarray, /) -> np.ndarray:
        """Actions (n, 9) from observations (n, size)."""
        return np.stack([hand.act(Sight.of(row)) for hand, row in zip(self.hands, observation, strict=True)])
