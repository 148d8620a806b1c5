"""Compares what a log says beyond the simulated numbers with the farm's own log of the trial: actions, commands, words."""

import json

import numpy as np

from sim_backend.replays.comparison import Comparison
from trial_logs.reader import TrialLog


def compare_with_original(found: Comparison, log: TrialLog, original: TrialLog) -> None:
    """Note the first action, command or report of the tracker that is another; other words differ from the first step on."""
    for steps_name, names in (
        ("policy_steps", ("policy_steps", "action")),
        ("command_steps", ("command_steps", "command_torque_nm", "command_target_rad")),
    ):
        for name in names:
            found.compare(getattr(original, steps_name), getattr(log, name), getattr(original, name))
    for report, own, delivery_s in zip(log.tracker, original.tracker, original.delivery_s, strict=False):
        # As text, since NaN differs from itself.
        if json.dumps(report, sort_keys=True) != json.dumps(own, sort_keys=True):
            found.note(max(round(1000 * delivery_s), 0))
            break
    if _words(log) != _words(original):
        found.note(0)


def _words(log: TrialLog) -> tuple:
    goal = None if log.goal is None else tuple(np.concatenate(log.goal).tolist())
    return log.metadata, log.outcome, log.manifest, goal
