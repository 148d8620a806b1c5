"""Reads a trial's log into aligned arrays."""

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from api_schemas import trial_log


class LogUnreadableError(Exception):
    """The file is not a complete trial log; the message says what is wrong."""


@dataclass(frozen=True)
class TrialLog:
    """A trial's log as arrays; ``steps`` count milliseconds since the start.

    Shapes: joints (n, 9) in rad, rad/s and N m at every step; cube poses (m, 3) in m and (m, 4) wxyz at ``cube_steps``;
    tracked poses (k, 3), (k, 4) with ``capture_s``, ``delivery_s`` and ``confidence`` (k,). ``goal`` is the wanted pose of the
    cube, None where the task has none.
    """

    metadata: dict[str, str]
    outcome: dict[str, str]
    joint_steps: np.ndarray
    joint_position_rad: np.ndarray
    joint_velocity_rad_s: np.ndarray
    measured_torque_nm: np.ndarray
    desired_torque_nm: np.ndarray
    applied_torque_nm: np.ndarray
    cube_steps: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    tracked_position_world_m: np.ndarray
    tracked_quat_wxyz: np.ndarray
    capture_s: np.ndarray
    delivery_s: np.ndarray
    confidence: np.ndarray
    goal: tuple[np.ndarray, np.ndarray] | None
    message_counts: dict[str, int]


def read_log(path: Path) -> TrialLog:
    """Read a whole log.

    Raises:
        LogUnreadableError: the file is missing, truncated, corrupted or not a trial log.
    """
    try:
        with path.open("rb") as stream:
            return _read(stream)
    except Exception as error:  # the border to foreign bytes: decoders raise errors of many libraries
        raise LogUnreadableError(f"{path.name} cannot be read as a trial log: {error or type(error).__name__}") from error


def _read(stream) -> TrialLog:
    reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
    messages: dict[str, list] = defaultdict(list)
    counts: dict[str, int] = defaultdict(int)
    summary = reader.get_summary()
    if summary is None:
        raise ValueError("it has no summary: the robot that wrote it did not finish")
    for _, channel, message, decoded in _decoded(reader):
        counts[channel.topic] += 1
        messages[channel.topic].append((message.log_time // trial_log.STEP_NS, decoded))
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    if trial_log.TRIAL_METADATA not in records:
        raise ValueError(f"it has no metadata record {trial_log.TRIAL_METADATA!r}")
    joints = [(step, m) for step, m in messages[trial_log.JOINT_STATES]]
    values = np.array([[(j.position, j.velocity, j.effort) for j in m.joints] for _, m in joints]).reshape(-1, 9, 3)
    torque = [m for _, m in messages[trial_log.TORQUE]]
    cube = [_pose(m) for _, m in messages[trial_log.CUBE_POSE]]
    tracked = [_pose(m) for _, m in messages[trial_log.TRACKED_POSE]]
    tracker = [m for _, m in messages[trial_log.TRACKER]]
    goals = [_pose(m) for _, m in messages[trial_log.GOAL]]
    return TrialLog(
        metadata=records[trial_log.TRIAL_METADATA],
        outcome=records.get(trial_log.OUTCOME_METADATA, {}),
        joint_steps=np.array([step for step, _ in joints], dtype=int),
        joint_position_rad=values[:, :, 0],
        joint_velocity_rad_s=values[:, :, 1],
        measured_torque_nm=values[:, :, 2],
        desired_torque_nm=np.array([m.desired_nm for m in torque]).reshape(-1, 9),
        applied_torque_nm=np.array([m.applied_nm for m in torque]).reshape(-1, 9),
        cube_steps=np.array([step for step, _ in messages[trial_log.CUBE_POSE]], dtype=int),
        cube_position_world_m=np.array([position for position, _ in cube]).reshape(-1, 3),
        cube_quat_wxyz=np.array([quat for _, quat in cube]).reshape(-1, 4),
        tracked_position_world_m=np.array([position for position, _ in tracked]).reshape(-1, 3),
        tracked_quat_wxyz=np.array([quat for _, quat in tracked]).reshape(-1, 4),
        capture_s=np.array([m["capture_time_s"] for m in tracker]),
        delivery_s=np.array([m["delivery_time_s"] for m in tracker]),
        confidence=np.array([m["confidence"] for m in tracker]),
        goal=(np.array(goals[0][0]), np.array(goals[0][1])) if goals else None,
        message_counts=dict(counts),
    )


def _decoded(reader) -> Iterator[tuple]:
    """Messages in order of time, decoded by their schema; JSON ones as dicts."""
    factory, decoders = DecoderFactory(), {}
    for schema, channel, message in reader.iter_messages():
        if channel.message_encoding == "json":
            yield schema, channel, message, json.loads(message.data)
            continue
        if channel.id not in decoders:
            decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
        yield schema, channel, message, decoders[channel.id](message.data)


def _pose(message) -> tuple[tuple[float, ...], tuple[float, ...]]:
    p, q = message.pose.position, message.pose.orientation
    return (p.x, p.y, p.z), (q.w, q.x, q.y, q.z)
