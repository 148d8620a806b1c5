"""Reads a trial's log, and the file with the truth about it, into aligned arrays."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import itemgetter
from os import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from mcap.reader import McapReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from trial_logs import trial_log

Read = TypeVar("Read")
MAGIC = b"\x89MCAP0\r\n"
"""How every MCAP file begins and ends (mcap.dev/spec, "Magic")."""


class LogUnreadableError(Exception):
    """The file is not a complete trial log; the message says what is wrong."""


@dataclass(frozen=True)
class TrialLog:
    """A trial's log as arrays; ``steps`` count milliseconds since the start.

    Shapes: joints (n, 9) in rad, rad/s and N m at every step; cube poses (m, 3) in m and (m, 4) wxyz at ``cube_steps``;
    tracked poses (k, 3), (k, 4) with ``capture_s``, ``delivery_s`` and ``confidence`` (k,), and what the tracker said besides in
    ``tracker``. ``goal`` is the wanted pose of the cube, None where the task has none. A policy's observations (p, size) and
    actions (p, 9) are at ``policy_steps``; what an excitation asked for, torques and position targets (q, 9), NaN for none, is at
    ``command_steps``. The truth of a robot with physics of its own is not here: there ``cube_steps`` is empty.
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
    tracker: tuple[dict, ...]
    goal: tuple[np.ndarray, np.ndarray] | None
    policy_steps: np.ndarray
    observation: np.ndarray
    action: np.ndarray
    command_steps: np.ndarray
    command_torque_nm: np.ndarray
    command_target_rad: np.ndarray
    manifest: str | None
    message_counts: dict[str, int]


@dataclass(frozen=True)
class TruthLog:
    """The truth about a trial. Shapes as in :class:`TrialLog`; ``effective_torque_nm`` is what reached the joints.

    ``physics`` holds, as plain values, the robot's effects at the start, their changes, the start and the seed of the noise;
    ``temperature_rise_k`` (m, 9) are the motors' temperatures above ambient at ``motor_steps``.
    """

    metadata: dict[str, str]
    physics: dict[str, Any]
    joint_steps: np.ndarray
    joint_position_rad: np.ndarray
    joint_velocity_rad_s: np.ndarray
    effective_torque_nm: np.ndarray
    cube_steps: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    motor_steps: np.ndarray
    temperature_rise_k: np.ndarray


def read_log(path: Path | str) -> TrialLog:
    """Read a whole log.

    Raises:
        LogUnreadableError: the file is missing, truncated, corrupted or not a trial log.
    """
    return _opened(path, "a trial log", _read)


def read_truth(path: Path | str) -> TruthLog:
    """Read the truth about a trial.

    Raises:
        LogUnreadableError: the file is missing, truncated, corrupted or holds no truth.
    """
    return _opened(path, "the truth about a trial", _read_truth)


def read_trial(path: Path) -> dict[str, str]:
    """A log's record of its trial (robot, seed, task or excitation …), without reading its rows.

    Raises:
        LogUnreadableError: as :func:`read_log`, as far as it shows without the rows.
    """
    return _opened(path, "a trial log", lambda stream: _records(_whole(stream))[trial_log.TRIAL_METADATA])


def _opened(file: Path | str, what: str, read: Callable[[BinaryIO], Read]) -> Read:
    path = Path(file)
    try:
        with path.open("rb") as stream:
            return read(stream)
    except Exception as error:  # the border to foreign bytes: decoders raise errors of many libraries
        raise LogUnreadableError(f"{path.name} cannot be read as {what}: {error or type(error).__name__}") from error


@dataclass(frozen=True)
class _Content:
    """Everything in a file: decoded messages with their times in ns by topic, metadata records and attachments by name."""

    messages: dict[str, list[tuple[int, Any]]]
    records: dict[str, dict[str, str]]
    attachments: dict[str, bytes]

    def steps(self, topic: str) -> np.ndarray:
        return np.array([time_ns for time_ns, _ in self.messages[topic]], dtype=int) // trial_log.STEP_NS

    def values(self, topic: str) -> list[Any]:
        return [message for _, message in self.messages[topic]]

    def joints(self, topic: str) -> np.ndarray:
        """Position, velocity and effort, shape (n, 9, 3)."""
        joints = (joint for message in self.values(topic) for joint in message.joints)
        values = (value for joint in joints for value in (joint.position, joint.velocity, joint.effort))
        return np.fromiter(values, float).reshape(-1, 9, 3)

    def poses(self, topic: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) and orientations (n, 4) wxyz."""
        poses = [_pose(m) for m in self.values(topic)]
        return np.array([p for p, _ in poses]).reshape(-1, 3), np.array([q for _, q in poses]).reshape(-1, 4)


def _whole(stream: BinaryIO) -> McapReader:
    """A reader of a file that was written to its end."""
    _check_whole(stream)
    reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
    if reader.get_summary() is None:
        raise ValueError("it has no summary: the robot that wrote it did not finish")
    return reader


def _records(reader: McapReader) -> dict[str, dict[str, str]]:
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    if trial_log.TRIAL_METADATA not in records:
        raise ValueError(f"it has no metadata record {trial_log.TRIAL_METADATA!r}")
    return records


def _content(stream: BinaryIO) -> _Content:
    reader = _whole(stream)
    messages: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for _, channel, message, decoded in _decoded(reader):
        messages[channel.topic].append((message.log_time, decoded))
    for of_topic in messages.values():
        of_topic.sort(key=itemgetter(0))  # as they are already, unless somebody else wrote the file again
    return _Content(messages, _records(reader), {attached.name: attached.data for attached in reader.iter_attachments()})


def _check_whole(stream: BinaryIO) -> None:
    """Refuses what a reader would stumble over somewhere in the middle; leaves the stream at its start."""
    begins = stream.read(len(MAGIC))
    stream.seek(max(0, stream.seek(0, SEEK_END) - len(MAGIC)))
    ends = stream.read()
    stream.seek(0)
    if begins != MAGIC:
        raise ValueError("it is no MCAP file")
    if ends != MAGIC:
        raise ValueError("its end is missing; fetch or copy it again")


def _read(stream: BinaryIO) -> TrialLog:
    content = _content(stream)
    joints, torque = content.joints(trial_log.JOINT_STATES), content.values(trial_log.TORQUE)
    cube, tracked, goals = (content.poses(topic) for topic in (trial_log.CUBE_POSE, trial_log.TRACKED_POSE, trial_log.GOAL))
    tracker, policy = content.values(trial_log.TRACKER), content.values(trial_log.POLICY)
    command, manifest = content.values(trial_log.COMMAND), content.attachments.get(trial_log.MANIFEST_ATTACHMENT)
    return TrialLog(
        metadata=content.records[trial_log.TRIAL_METADATA],
        outcome=content.records.get(trial_log.OUTCOME_METADATA, {}),
        joint_steps=content.steps(trial_log.JOINT_STATES),
        joint_position_rad=joints[:, :, 0],
        joint_velocity_rad_s=joints[:, :, 1],
        measured_torque_nm=joints[:, :, 2],
        desired_torque_nm=np.array([m.desired_nm[:] for m in torque]).reshape(-1, 9),
        applied_torque_nm=np.array([m.applied_nm[:] for m in torque]).reshape(-1, 9),
        cube_steps=content.steps(trial_log.CUBE_POSE),
        cube_position_world_m=cube[0],
        cube_quat_wxyz=cube[1],
        tracked_position_world_m=tracked[0],
        tracked_quat_wxyz=tracked[1],
        capture_s=np.array([m["capture_time_s"] for m in tracker]),
        delivery_s=np.array([m["delivery_time_s"] for m in tracker]),
        confidence=np.array([m["confidence"] for m in tracker]),
        tracker=tuple(tracker),
        goal=(goals[0][0], goals[1][0]) if len(goals[0]) else None,
        policy_steps=content.steps(trial_log.POLICY),
        observation=np.array([m.observation[:] for m in policy], dtype=np.float32).reshape(
            len(policy), len(policy[0].observation) if policy else 0
        ),
        action=np.array([m.action[:] for m in policy]).reshape(-1, 9),
        command_steps=content.steps(trial_log.COMMAND),
        command_torque_nm=np.array([m.desired_torque_nm[:] for m in command]).reshape(-1, 9),
        command_target_rad=np.array([m.position_target_rad[:] for m in command]).reshape(-1, 9),
        manifest=None if manifest is None else manifest.decode(),
        message_counts={topic: len(messages) for topic, messages in content.messages.items() if messages},
    )


def _read_truth(stream: BinaryIO) -> TruthLog:
    content = _content(stream)
    if trial_log.PHYSICS_METADATA not in content.records:
        raise ValueError(f"it has no metadata record {trial_log.PHYSICS_METADATA!r}")
    joints, cube = content.joints(trial_log.TRUE_JOINT_STATES), content.poses(trial_log.CUBE_POSE)
    return TruthLog(
        metadata=content.records[trial_log.TRIAL_METADATA],
        physics={key: json.loads(value) for key, value in content.records[trial_log.PHYSICS_METADATA].items()},
        joint_steps=content.steps(trial_log.TRUE_JOINT_STATES),
        joint_position_rad=joints[:, :, 0],
        joint_velocity_rad_s=joints[:, :, 1],
        effective_torque_nm=joints[:, :, 2],
        cube_steps=content.steps(trial_log.CUBE_POSE),
        cube_position_world_m=cube[0],
        cube_quat_wxyz=cube[1],
        motor_steps=content.steps(trial_log.MOTORS),
        temperature_rise_k=np.array([m.temperature_rise_k[:] for m in content.values(trial_log.MOTORS)]).reshape(-1, 9),
    )


def _decoded(reader) -> Iterator[tuple]:
    """Messages as the file has them, decoded by their schema; JSON ones as dicts.

    Putting those of all topics in one order would take half of the time.
    """
    factory, decoders = DecoderFactory(), {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if channel.message_encoding == "json":
            yield schema, channel, message, json.loads(message.data)
            continue
        if channel.id not in decoders:
            decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
        yield schema, channel, message, decoders[channel.id](message.data)


def _pose(message) -> tuple[tuple[float, ...], tuple[float, ...]]:
    p, q = message.pose.position, message.pose.orientation
    return (p.x, p.y, p.z), (q.w, q.x, q.y, q.z)
