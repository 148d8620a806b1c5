"""A first run of a converted graph on plausible observations: does it load, fit, stay finite and keep its rate?"""

import time
from pathlib import Path

import numpy as np
import onnxruntime

from api_schemas.policy import ACTION_SIZE, OBSERVATION_SIZES, PolicyManifest
from api_schemas.policy_graph import GraphRunner
from services.policies.unfit import UnfitError

RUNS = 8
SEED = 20220801
TYPICAL: dict[str, tuple[float, float]] = {
    "joint_position_rad": (0.0, 0.8),
    "joint_velocity_rad_s": (0.0, 1.0),
    "joint_torque_nm": (0.0, 0.1),
    "fingertip_position_world_m": (0.05, 0.06),
    "cube_position_world_m": (0.03, 0.05),
    "cube_quat_wxyz": (0.5, 0.1),
    "cube_keypoints_world_m": (0.03, 0.05),
    "tracker_confidence": (0.9, 0.05),
    "tracker_delay_s": (0.09, 0.01),
    "goal_position_world_m": (0.03, 0.05),
    "goal_quat_wxyz": (0.5, 0.1),
    "goal_keypoints_world_m": (0.03, 0.05),
    "goal_fingertip_position_world_m": (0.05, 0.06),
    "previous_action": (0.0, 0.1),
}
"""Mean and spread of each field as a running robot gives them, in the field's unit."""


def observations(manifest: PolicyManifest) -> np.ndarray:
    """The same plausible observations each time, shape (RUNS, n)."""
    rng = np.random.default_rng(SEED)
    fields = [rng.normal(*TYPICAL[name], (RUNS, OBSERVATION_SIZES[name])) for name in manifest.observation]
    return np.concatenate(fields, axis=1).astype(np.float32)


def load(graph: Path) -> onnxruntime.InferenceSession:
    """A session of one thread, as robots have it.

    Raises:
        UnfitError: the runtime cannot load the graph.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise UnfitError(f"the runtime cannot load the network: {error}") from error


def run(session: onnxruntime.InferenceSession, manifest: PolicyManifest) -> list[str]:
    """Runs the graph a few times; gives a sentence for each thing a user should know.

    Raises:
        UnfitError: the network fails, or gives the wrong shape.
    """
    actions, spent_s = [], []
    policy = GraphRunner(session)
    for observation in observations(manifest):
        began_s = time.process_time()
        try:
            action = policy.act(observation[None, :])
        except Exception as error:
            reason = str(error).strip()[:300]
            raise UnfitError(f"the network fails on a plausible observation ({reason})", slug="dry-run-failed") from error
        spent_s.append(time.process_time() - began_s)
        actions.append(action)
    if actions[0].shape != (1, ACTION_SIZE):
        raise UnfitError(f"the network gives an array of shape {actions[0].shape} instead of (1, {ACTION_SIZE})")
    return _warnings(np.concatenate(actions), float(np.median(spent_s)), 1 / manifest.rate_hz)


def _warnings(actions: np.ndarray, typical_s: float, period_s: float) -> list[str]:
    found = []
    if not np.isfinite(actions).all():
        found.append("gave actions that are not finite on plausible observations; a trial ends at the first such action")
    elif len(np.unique(actions, axis=0)) == 1:
        found.append(f"gave the same action on {len(actions)} different observations")
    if typical_s > period_s:
        found.append(f"took {typical_s * 1e3:.1f} ms for an action, longer than the control period of {period_s * 1e3:g} ms")
    return found
