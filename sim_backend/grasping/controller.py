"""The structured controller: look, choose a grasp, get ready, close, carry; begin again when the cube was lost.

Where the goal becomes another one, a cube that is held is carried on, and let go only where this grasp does not reach.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from api_schemas.builtin_policies import GRASP
from api_schemas.policy import OBSERVATION_SIZES
from sim_backend.grasping.carrying import Carried
from sim_backend.grasping.choice import Grasp, carried_to, choose_grasp, side_normals
from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.tasks.keypoints import rotation_matrix
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.kinematics import joint_position_rad as inverse_kinematics

MANIFEST = GRASP
PERIOD_S = 1 / MANIFEST.rate_hz

OVER_M = 0.120
"""Height at which fingers pass over the cube."""
FREE_SPEED_M_S, CLOSING_SPEED_M_S = 0.25, 0.06
SETTLING_S, CLOSING_S = 0.15, 0.5
"""After a motion is over, and after the tips should touch."""
PRESS_N, PRESS_ALONE_N = 2.0, 1.0
"""Of the two fingers that face each other, and of the third; less where a finger has not so much."""
OPENED_M, OPENING_S = 0.03, 0.8
REPORTS = 3
"""Of a cube that lies still, before a grasp is chosen."""
STILL_M, THERE_M = 0.015, 0.006


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
        joints, cube, quat, delay, goal = np.split(np.asarray(observation, dtype=float), _ENDS)
        return cls(joints, cube, quat, float(delay[0]), goal)

    @property
    def tip_m(self) -> np.ndarray:
        """Where the tips are by the measured joints, shape (3, 3)."""
        return fingertip_position_world_m(self.joint_position_rad).reshape(3, 3)


_ENDS = np.cumsum([OBSERVATION_SIZES[name] for name in MANIFEST.observation])[:-1]


class Hand:
    """The controller of one trial. Owner of its phase, of the grasp and of the places that the tips are asked to be at."""

    def __init__(self) -> None:
        self.phase, self.grasp, self.failures = Phase.LOOK, None, 0
        self._tip_m: np.ndarray | None = None
        self._periods, self._arrived = 0, 0  # since the phase began, and since its motion was over
        self._delay_s = np.inf
        self._goal_m: np.ndarray | None = None
        self._reports: list[tuple[np.ndarray, float]] = []  # of the cube: place, and angle of its first face

    phase: Phase
    grasp: Grasp | None

    def next(self, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
        """Where the tips are to be, m, and with what force they are to press, N, in the world; both (3 fingers, 3)."""
        self._sight, self._reported = sight, sight.tracker_delay_s <= self._delay_s
        self._delay_s = sight.tracker_delay_s
        self._periods += 1
        if self._tip_m is None:
            self._tip_m = sight.tip_m
        if self._goal_m is not None and (sight.goal_position_world_m != self._goal_m).any():
            self._take_another_goal()
        self._goal_m = sight.goal_position_world_m
        self._tip_m = _PHASES[self.phase](self, self._tip_m)
        return self._tip_m, self._pressing_n()

    def _go(self, phase: Phase) -> None:
        self.phase, self._periods, self._arrived = phase, 0, 0

    def _take_another_goal(self) -> None:
        self.failures = 0
        if self.phase is Phase.CARRY:
            if (there_m := carried_to(self._grasp, self._sight.goal_position_world_m)) is None:
                self._let_go()
            else:
                self.grasp = replace(self._grasp, goal_m=there_m)
                self._carried.aim(there_m)
        elif self.phase is not Phase.OPEN:
            self._look_again()

    def _let_go(self) -> None:
        self._opened_m = self._sight.tip_m - OPENED_M * self._grasp.inward
        self._go(Phase.OPEN)

    def _look_again(self) -> None:
        self._reports, self.grasp = [], None
        self._go(Phase.LOOK)

    def _look(self, tip_m: np.ndarray) -> np.ndarray:
        if self._reported and (found := self._cube_at_rest()) is not None:
            self._cube_m, normals = found
            goal_m = self._sight.goal_position_world_m
            if np.linalg.norm(self._cube_m - goal_m) > THERE_M:
                self.grasp = choose_grasp(self._cube_m, normals, goal_m, rank=self.failures)
            if self.grasp is not None:
                self._go(Phase.RAISE)
        return tip_m

    def _cube_at_rest(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Where the cube lies, (3,), and the normals of its upright faces, (4, 3), by the latest reports; None if not still."""
        normals = side_normals(rotation_matrix(self._sight.cube_quat_wxyz))
        if normals is None:
            self._reports = []
            return None
        angle = 4 * np.arctan2(normals[0, 1], normals[0, 0])  # times four, since the faces of a cube are alike
        self._reports = [*self._reports, (self._sight.cube_position_world_m, angle)][-REPORTS:]
        places, angles = (np.array(each) for each in zip(*self._reports, strict=True))
        if len(places) < REPORTS or np.ptp(places, axis=0).max() > STILL_M:
            return None
        angle = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean()) / 4 + np.arange(4) * np.pi / 2
        return np.median(places, axis=0), np.stack([np.cos(angle), np.sin(angle), np.zeros(4)], axis=1)

    def _raise(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, _over(tip_m), FREE_SPEED_M_S, then=Phase.OVER)

    def _over(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, _over(self._ready_m), FREE_SPEED_M_S, then=Phase.DOWN)

    def _down(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, self._ready_m, FREE_SPEED_M_S, SETTLING_S, then=Phase.CLOSE)

    def _close(self, tip_m: np.ndarray) -> np.ndarray:
        grasp = self._grasp
        self._carried = Carried(self._cube_m, grasp.goal_m, PERIOD_S)
        return self._move(tip_m, self._cube_m + grasp.tip_m, CLOSING_SPEED_M_S, CLOSING_S, then=Phase.CARRY)

    def _carry(self, tip_m: np.ndarray) -> np.ndarray:
        tip_m = self._carried.go_on() + self._grasp.tip_m
        if self._reported and self._carried.lost(self._sight.cube_position_world_m, self._sight.tracker_delay_s):
            self.failures += 1
            self._let_go()
        return tip_m

    def _open(self, tip_m: np.ndarray) -> np.ndarray:
        if self._periods * PERIOD_S > OPENING_S:
            self._look_again()
            return tip_m
        return self._move(tip_m, self._opened_m, FREE_SPEED_M_S)

    @property
    def _grasp(self) -> Grasp:
        assert self.grasp is not None, "only while there is one"
        return self.grasp

    @property
    def _ready_m(self) -> np.ndarray:
        """Beside the faces that the fingers are to touch, (3, 3)."""
        return self._cube_m + self._grasp.tip_m - self._grasp.clearance_m * self._grasp.inward

    def _move(
        self, tip_m: np.ndarray, target_m: np.ndarray, speed_m_s: float, wait_s: float = 0.0, *, then: Phase | None = None
    ) -> np.ndarray:
        """A step of the tips towards a place; the next phase begins when they have been asked to be there for so long."""
        way = target_m - tip_m
        step, length = speed_m_s * PERIOD_S, np.linalg.norm(way, axis=1, keepdims=True)
        self._arrived = self._arrived + 1 if (length <= step).all() else 0
        if then is not None and self._arrived * PERIOD_S > wait_s:
            self._go(then)
        return tip_m + way * np.minimum(1.0, step / np.maximum(length, 1e-9))

    def _pressing_n(self) -> np.ndarray:
        if self.phase not in (Phase.CLOSE, Phase.CARRY):
            return np.zeros((3, 3))
        grasp = self._grasp
        facing = (grasp.inward @ grasp.inward.T < -0.9).any(axis=1)
        press_n = np.minimum(np.where(facing, min(PRESS_N, grasp.force_n[facing].min()), PRESS_ALONE_N), grasp.force_n)
        force_n = press_n[:, None] * grasp.inward
        if self.phase is Phase.CARRY:
            force_n[:, 2] += c.CUBE_MASS_KG * c.GRAVITY_M_S2 / 3
        return force_n


def joint_command_rad(joint_position_rad: np.ndarray, tip_m: np.ndarray, force_n: np.ndarray) -> np.ndarray:
    """Joint positions that make the robots' own controllers hold the tips there and press.

    Args:
        joint_position_rad: measured, shape (n, 9).
        tip_m: where the tips are to be, shape (n, 3 fingers, 3); a finger that does not reach so far stays where it is.
        force_n: with what force they are to press, shape (n, 3, 3).

    Returns:
        Shape (n, 9), rad.
    """
    wanted = inverse_kinematics(tip_m.reshape(-1, 9))
    wanted = np.where(np.isnan(wanted), joint_position_rad, wanted)
    torque_nm = gravity_torque_nm(joint_position_rad)
    torque_nm += np.einsum("nfcj,nfc->nfj", tip_jacobian(joint_position_rad), force_n).reshape(-1, 9)
    return np.clip(wanted, c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD) + torque_nm / c.POSITION_GAIN_NM_RAD


_PHASES: dict[Phase, Callable[[Hand, np.ndarray], np.ndarray]] = {phase: getattr(Hand, f"_{phase}") for phase in Phase}
"""Each takes where the tips are asked to be and says where they are asked to be next, shapes (3, 3), m."""


def _over(place_m: np.ndarray) -> np.ndarray:
    """The same places above the cube."""
    return np.concatenate([place_m[:, :2], np.full((3, 1), OVER_M)], axis=1)


class GraspPolicy:
    """The controller of any number of trials, as evaluations ask policies; each trial has a hand of its own."""

    manifest = MANIFEST

    def __init__(self) -> None:
        self.begin(1)

    def begin(self, trials: int) -> None:
        """Forget all that was."""
        self.hands = [Hand() for _ in range(trials)]

    def __call__(self, observation: np.ndarray, /) -> np.ndarray:
        """Actions (n, 9) from observations (n, size)."""
        sights = [Sight.of(row) for row in observation]
        tip_m, force_n = zip(*(hand.next(sight) for hand, sight in zip(self.hands, sights, strict=True)), strict=True)
        return joint_command_rad(np.array([sight.joint_position_rad for sight in sights]), np.array(tip_m), np.array(force_n))
