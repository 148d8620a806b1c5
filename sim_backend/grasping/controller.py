"""The structured controller: look, choose a grasp, get ready, close, carry; begin again when the cube was lost.

Where a goal has an orientation, the tips turn with the cube about the vertical while they carry it; what one grasp cannot turn is
left to the next one, which begins as after a loss: the cube is set down, the hand opens and looks.
Where the goal becomes another one, a cube that is held is carried on, and set down to be grasped anew where this grasp does not
reach.
"""

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum

import numpy as np

from api_schemas.builtin_policies import GRASP
from api_schemas.policy import PolicyManifest
from sim_backend.grasping.carrying import Carried
from sim_backend.grasping.choice import Grasp, carried_to, choose_grasp
from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.grasping.sight import Reports, Sight
from sim_backend.grasping.turning import wrapped
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad as inverse_kinematics

PERIOD_S = 1 / GRASP.rate_hz

OVER_M = 0.120
"""Height at which fingers pass over the cube."""
FREE_SPEED_M_S, CLOSING_SPEED_M_S = 0.25, 0.06
SETTLING_S, CLOSING_S = 0.15, 0.5
"""After a motion is over, and after the tips should touch."""
PRESS_N, PRESS_ALONE_N = 2.0, 1.0
"""Of the two fingers that face each other, and of the third; less where a finger has not so much."""
OPENED_M, OPENING_S = 0.03, 0.8
THERE_M, THERE_RAD = 0.006, 0.12
"""Nearer to its goal, the cube is left alone."""
SET_DOWN_S = 0.3
"""At the end of a way, before the hand opens to grasp the cube anew."""


class Phase(StrEnum):
    """What the hand is doing."""

    LOOK = "look"
    RAISE = "raise"
    OVER = "over"
    DOWN = "down"
    CLOSE = "close"
    CARRY = "carry"
    OPEN = "open"


class Hand:
    """The controller of one trial. Owner of its phase, of the grasp and of the places that the tips are asked to be at."""

    def __init__(self) -> None:
        self.phase, self.grasp, self.failures = Phase.LOOK, None, 0
        self._tip_m: np.ndarray | None = None
        self._periods, self._arrived = 0, 0  # since the phase began, and since its motion was over
        self._delay_s = np.inf
        self._before: Sight | None = None
        self._reports = Reports()

    phase: Phase
    grasp: Grasp | None

    def next(self, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
        """Where the tips are to be, m, and with what force they are to press, N, in the world; both (3 fingers, 3)."""
        self._sight, self._reported = sight, sight.tracker_delay_s <= self._delay_s
        self._delay_s = sight.tracker_delay_s
        self._periods += 1
        if self._tip_m is None:
            self._tip_m = sight.tip_m
        if self._before is not None and not sight.has_goal_of(self._before):
            self._take_another_goal(self._before)
        self._before = sight
        self._tip_m = _PHASES[self.phase](self, self._tip_m)
        return self._tip_m, self._pressing_n()

    def _go(self, phase: Phase) -> None:
        self.phase, self._periods, self._arrived = phase, 0, 0

    def _take_another_goal(self, before: Sight) -> None:
        self.failures = 0
        if self.phase is Phase.CARRY:
            self._turn_rad = wrapped(self._turn_rad + before.turn_to_goal_of(self._sight))
            if not self._carry_on(self._sight.goal_position_world_m, self._turn_rad):
                self._set_down()
        elif self.phase is not Phase.OPEN:
            self._look_again()

    def _set_down(self) -> None:
        """Below where the cube is, to be grasped anew there; it is let go in the air only where even that is out of reach."""
        below_m = np.array([*self._carried.asked_m[:2], c.CUBE_REST_HEIGHT_M])
        if not self._carry_on(below_m, self._carried.turned_rad, unfinished=True):
            self._let_go()

    def _carry_on(self, goal_m: np.ndarray, turn_rad: float, *, unfinished: bool = False) -> bool:
        """Whether this grasp reaches there, shape (3,), m; if so it is aimed there."""
        if (there_m := carried_to(self._grasp, goal_m, turn_rad)) is None:
            return False
        self.grasp = replace(self._grasp, goal_m=there_m, turn_rad=turn_rad, unfinished=unfinished)
        self._carried.aim(there_m, turn_rad)
        return True

    def _let_go(self) -> None:
        self._opened_m = self._sight.tip_m - OPENED_M * self._held.inward
        self._go(Phase.OPEN)

    def _look_again(self) -> None:
        self._reports, self.grasp = Reports(), None
        self._go(Phase.LOOK)

    def _look(self, tip_m: np.ndarray) -> np.ndarray:
        if self._reported and (found := self._reports.at_rest(self._sight)) is not None:
            self._cube_m, self._turn_rad = found.cube_m, found.turn_rad
            goal_m = self._sight.goal_position_world_m
            if np.linalg.norm(self._cube_m - goal_m) > THERE_M or abs(self._turn_rad) > THERE_RAD:
                self.grasp = choose_grasp(self._cube_m, found.normals, goal_m, rank=self.failures, turn_rad=self._turn_rad)
            if self.grasp is not None:
                self._go(Phase.RAISE)
        return tip_m

    def _raise(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, _over(tip_m), FREE_SPEED_M_S, then=Phase.OVER)

    def _over(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, _over(self._ready_m), FREE_SPEED_M_S, then=Phase.DOWN)

    def _down(self, tip_m: np.ndarray) -> np.ndarray:
        return self._move(tip_m, self._ready_m, FREE_SPEED_M_S, SETTLING_S, then=Phase.CLOSE)

    def _close(self, tip_m: np.ndarray) -> np.ndarray:
        grasp = self._grasp
        self._carried = Carried(self._cube_m, grasp.goal_m, PERIOD_S, grasp.turn_rad)
        return self._move(tip_m, self._cube_m + grasp.tip_m, CLOSING_SPEED_M_S, CLOSING_S, then=Phase.CARRY)

    def _carry(self, tip_m: np.ndarray) -> np.ndarray:
        cube_m = self._carried.go_on()
        tip_m = cube_m + self._held.tip_m
        self._arrived = self._arrived + 1 if self._carried.arrived else 0
        turned_rad = self._turn_rad - self._sight.turn_rad
        if self._reported and self._carried.lost(self._sight.cube_position_world_m, self._sight.tracker_delay_s, turned_rad):
            self.failures += 1
            self._let_go()
        elif self._arrived * PERIOD_S > SET_DOWN_S and self._is_to_be_regrasped():
            self._let_go()
        return tip_m

    def _is_to_be_regrasped(self) -> bool:
        """Whether the cube, at the end of its way, needs to be turned further than this grasp has turned it."""
        on_floor = self._grasp.goal_m[2] < c.CUBE_REST_HEIGHT_M + THERE_M
        return self._grasp.unfinished or (on_floor and self._carried.slipped)

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
    def _held(self) -> Grasp:
        """The grasp as the cube was turned with it."""
        return self._grasp.turned(self._carried.turned_rad if self.phase is Phase.CARRY else 0.0)

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
        grasp = self._held
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
    """The controller of any number of trials, as evaluations ask policies; each trial has a hand of its own.

    With the manifest of ``builtin:grasp-turn`` it turns cubes, too.
    """

    def __init__(self, manifest: PolicyManifest = GRASP) -> None:
        self.manifest = manifest
        self.begin(1)

    def begin(self, trials: int) -> None:
        """Forget all that was."""
        self.hands = [Hand() for _ in range(trials)]

    def __call__(self, observation: np.ndarray, /) -> np.ndarray:
        """Actions (n, 9) from observations (n, size)."""
        sights = [Sight.of(row, self.manifest) for row in observation]
        tip_m, force_n = zip(*(hand.next(sight) for hand, sight in zip(self.hands, sights, strict=True)), strict=True)
        return joint_command_rad(np.array([sight.joint_position_rad for sight in sights]), np.array(tip_m), np.array(force_n))
