"""The process of a policy that comes with the farm; jailed, asked and timed as a stranger's is.

Started as ``python -m robot_farm.policy.builtin_policy FILE IN_FD OUT_FD ROBOT_PID``; the file holds
what ``builtin_content`` gives.
"""

import sys
import time
from typing import Any

import numpy as np

from api_schemas.builtin_policies import BUILTIN, GRASP_TURN, builtin_content
from api_schemas.policy import PolicyManifest
from robot_farm.policy import jailed_policy
from sim_backend.grasping.controller import GraspPolicy, Phase
from sim_backend.trifinger import constants as c


class Grasp:
    """The structured controller as a policy process has it."""

    def __init__(self, manifest: PolicyManifest) -> None:
        self._manifest = manifest
        self._policy = GraspPolicy(manifest)

    def __call__(self, data: bytes) -> tuple[Any, int]:
        """From an observation's bytes to an action (float32 array) and the time it took in ns."""
        observation = np.frombuffer(data, np.float32)[None]
        started_ns = time.perf_counter_ns()
        action = self._policy(observation)[0].astype(np.float32)
        return action, time.perf_counter_ns() - started_ns

    def forget(self) -> None:
        """Begin a new trial."""
        self._policy.begin(1)

    def another(self) -> "Grasp":
        """The same controller for another trial."""
        return Grasp(self._manifest)


def _try_out() -> None:
    """Choose a grasp once, since numpy imports some of itself when it is first used, and in the jail there are no files."""
    cube = [0.0, 0.0, c.CUBE_REST_HEIGHT_M]
    goal = [0.05, 0.0, c.MAX_GOAL_HEIGHT_M, 0.0, 0.0, 0.0, 1.0]  # the other way round: more than one grasp can turn
    observation = np.array([*c.START_JOINT_POSITION_RAD, *cube, 1.0, 0.0, 0.0, 0.0, c.CAMERA_DELAY_S, *goal], np.float32)
    policy = GraspPolicy(GRASP_TURN)  # does all that the other one does
    while policy.hands[0].phase is not Phase.CARRY:
        policy(observation[None])


def _load(content: bytes, _np: Any, _onnxruntime: Any) -> Grasp:
    for name, manifest in BUILTIN.items():
        if content == builtin_content(name):
            return Grasp(manifest)
    raise jailed_policy.UnknownHereError("this robot's version has no such built-in policy")


if __name__ == "__main__":
    _try_out()
    sys.exit(jailed_policy.main(_load))
