"""The log of a trial: which MCAP channels it has, and its writer.

``/measured/`` channels hold what a real robot could give, ``/truth/`` channels what only a simulation knows. Times are
simulated nanoseconds since the trial's start; a tracked pose is logged when it was delivered and stamped when its image was
taken. Messages are those of Foxglove where it has one, so that Foxglove and Lichtblick show a log without set-up.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import foxglove
import numpy as np
from foxglove import messages as fm
from foxglove.mcap import MCAPWriteOptions
from google.protobuf import descriptor_pb2

from api_schemas.fixed_message import MARKER_NANOS, MARKER_SECONDS, FixedMessage

JOINT_STATES = "/measured/joint_states"  # foxglove.JointStates at 1 kHz; effort is the measured torque
TORQUE = "/measured/torque"  # trifarm.Torque at 1 kHz: desired and applied
TRACKED_POSE = "/measured/tracked_cube_pose"  # foxglove.PoseInFrame at 10 Hz
TRACKER = "/measured/tracker"  # JSON at 10 Hz: capture and delivery time, confidence
POLICY = "/measured/policy"  # trifarm.PolicyStep at the policy's rate: observation, action, inference time
GOAL = "/measured/goal"  # foxglove.PoseInFrame, once; not for ``reach``, whose goal is a metadata record
MEASURED_TRANSFORMS = "/measured/tf"  # foxglove.FrameTransforms
MEASURED_SCENE = "/measured/scene"  # foxglove.SceneUpdate, once
EVENTS = "/measured/events"  # foxglove.Log
CUBE_POSE = "/truth/cube_pose"  # foxglove.PoseInFrame at 100 Hz
TRUE_TRANSFORMS = "/truth/tf"  # foxglove.FrameTransforms
TRUE_SCENE = "/truth/scene"  # foxglove.SceneUpdate, once

TRIAL_METADATA = "trial"
OUTCOME_METADATA = "outcome"
GOAL_METADATA = "goal"
MODEL_ATTACHMENT = "model.xml"
MANIFEST_ATTACHMENT = "manifest.json"

STEP_NS = 1_000_000
WORLD_FRAME = "world"
FLUSH_EVERY_STEPS = 250
"""A killed robot loses at most this much: the recorder flushes at least so often."""


def _schema(name: str, fields: Sequence[tuple[str, int, bool]]) -> foxglove.Schema:
    """A protobuf schema of our own from (name, type, repeated) triples."""
    descriptor = descriptor_pb2.FileDescriptorProto(name=f"trifarm/{name}.proto", package="trifarm", syntax="proto3")
    message = descriptor.message_type.add(name=name)
    for number, (field, kind, repeated) in enumerate(fields, start=1):
        label = (
            descriptor_pb2.FieldDescriptorProto.LABEL_REPEATED if repeated else descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
        )
        message.field.add(name=field, number=number, type=kind, label=label)  # pyright: ignore[reportArgumentType]
    files = descriptor_pb2.FileDescriptorSet(file=[descriptor])
    return foxglove.Schema(name=f"trifarm.{name}", encoding="protobuf", data=files.SerializeToString())


_DOUBLE = descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE
_FLOAT = descriptor_pb2.FieldDescriptorProto.TYPE_FLOAT
_FIXED64 = descriptor_pb2.FieldDescriptorProto.TYPE_FIXED64


def _packed(number: int, payload: bytes) -> bytes:
    """A length-delimited protobuf field of less than 16 KiB."""
    size = len(payload)
    length = bytes([size]) if size < 0x80 else bytes([size & 0x7F | 0x80, size >> 7])
    return bytes([number << 3 | 2]) + length + payload


def _encode_torque(values: list[float]) -> bytes:
    return _packed(1, np.array(values[:9]).tobytes()) + _packed(2, np.array(values[9:]).tobytes())


def _marked_stamp() -> fm.Timestamp:
    return fm.Timestamp(sec=MARKER_SECONDS, nsec=MARKER_NANOS)


def _encode_pose(values: list[float]) -> bytes:
    position = fm.Vector3(x=values[0], y=values[1], z=values[2])
    orientation = fm.Quaternion(w=values[3], x=values[4], y=values[5], z=values[6])
    pose = fm.Pose(position=position, orientation=orientation)
    return fm.PoseInFrame(timestamp=_marked_stamp(), frame_id=WORLD_FRAME, pose=pose).encode()


class LogChannels:
    """The channels of a robot's logs and the templates of their messages, made once for all of its trials.

    Args:
        joint_names: names of the nine joints.
        frames: (parent, child) of the moving transforms under /measured/tf, in the order of their rows.
    """

    def __init__(self, *, joint_names: tuple[str, ...], frames: tuple[tuple[str, str], ...]) -> None:
        self.context = foxglove.Context()
        self.fixed = {
            JOINT_STATES: FixedMessage(lambda v: _joint_states(joint_names, v), 3 * len(joint_names)),
            TORQUE: FixedMessage(_encode_torque, 18),
            MEASURED_TRANSFORMS: FixedMessage(lambda v: _transforms(frames, v), 7 * len(frames)),
            TRUE_TRANSFORMS: FixedMessage(lambda v: _transforms(((WORLD_FRAME, "cube"),), v), 7),
        }
        self.fixed |= dict.fromkeys((TRACKED_POSE, GOAL, CUBE_POSE), FixedMessage(_encode_pose, 7))
        self._channels = {
            topic: foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=self.context)
            for topic, schema in _protobuf_schemas().items()
        }
        self._channels[TRACKER] = foxglove.Channel(TRACKER, schema=_TRACKER_SCHEMA, context=self.context)

    def log(self, topic: str, message: bytes, time_ns: int) -> None:
        """One encoded message."""
        self._channels[topic].log(message, log_time=time_ns)

    def log_rows(self, topic: str, values: np.ndarray, times_ns: np.ndarray) -> None:
        """Many messages of fixed size; ``values`` has shape (n, doubles of the message)."""
        log = self._channels[topic].base.log  # without the checks of its wrapper, which cost as much as the log itself
        for encoded, time_ns in zip(self.fixed[topic].rows(values, times_ns), times_ns.tolist(), strict=True):
            log(encoded, time_ns)


class TrialLogWriter:
    """Writes one trial's log; a context manager. Steps are physics steps of 1 ms since the trial's start.

    Args:
        path: file to create; it must not exist.
        channels: the robot's channels; only one writer may use them at a time.
    """

    def __init__(self, path: Path, channels: LogChannels) -> None:
        options = MCAPWriteOptions(compression_threads=0, compression_level=1)
        self._writer = foxglove.open_mcap(path, context=channels.context, writer_options=options)
        self._channels = channels

    def __enter__(self) -> "TrialLogWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._writer.close()

    def joint_states(self, first_step: int, position: np.ndarray, velocity: np.ndarray, torque_nm: np.ndarray) -> None:
        """Rows of consecutive steps; each array has shape (n, 9), in rad, rad/s and N m."""
        values = np.stack([position, velocity, torque_nm], axis=2).reshape(len(position), -1)
        steps = first_step + np.arange(len(position))
        self._rows(JOINT_STATES, values, steps)

    def torque(self, first_step: int, desired_nm: np.ndarray, applied_nm: np.ndarray) -> None:
        """Rows of consecutive steps; each array has shape (n, 9), N m."""
        values = np.concatenate([desired_nm, applied_nm], axis=1)
        self._rows(TORQUE, values, first_step + np.arange(len(values)))

    def cube_pose(self, steps: np.ndarray, position_world_m: np.ndarray, quat_wxyz: np.ndarray) -> None:
        """True poses of the cube; shapes (n,), (n, 3), (n, 4)."""
        self._rows(CUBE_POSE, np.concatenate([position_world_m, quat_wxyz], axis=1), steps)

    def transforms(self, topic: str, steps: np.ndarray, values: np.ndarray) -> None:
        """Moving transforms: per frame x, y, z in m and quaternion wxyz; shape (n, 7 * frames)."""
        self._rows(topic, values, steps)

    def tracked_pose(
        self, capture_step: int, delivery_step: int, position_world_m: np.ndarray, quat_wxyz: np.ndarray, confidence: float
    ) -> None:
        """One report of the tracker. Images taken before the start are stamped with the start."""
        values = np.concatenate([position_world_m, quat_wxyz])[None]
        stamp_ns = np.array([max(0, capture_step) * STEP_NS])
        at_ns = max(0, delivery_step) * STEP_NS
        self._channels.log(TRACKED_POSE, self._channels.fixed[TRACKED_POSE].rows(values, stamp_ns)[0], at_ns)
        report = {
            "capture_time_s": capture_step * STEP_NS / 1e9,
            "delivery_time_s": delivery_step * STEP_NS / 1e9,
            "confidence": float(confidence),
        }
        self._channels.log(TRACKER, json.dumps(report).encode(), at_ns)

    def goal(self, position_world_m: np.ndarray, quat_wxyz: np.ndarray) -> None:
        """The wanted pose of the cube, at the start."""
        values = np.concatenate([position_world_m, quat_wxyz])[None]
        self._rows(GOAL, values, np.zeros(1))

    def policy_step(self, step: int, observation: np.ndarray, action: np.ndarray, inference_time_ns: int) -> None:
        """What the policy saw, what it asked for and how long it took."""
        encoded = (
            _packed(1, observation.astype(np.float32).tobytes())
            + _packed(2, action.astype(np.float64).tobytes())
            + b"\x19"
            + inference_time_ns.to_bytes(8, "little")
        )
        self._channels.log(POLICY, encoded, step * STEP_NS)

    def message(self, topic: str, step: int, encoded: bytes) -> None:
        """One encoded message of a channel that is written rarely (scenes, fixed transforms)."""
        self._channels.log(topic, encoded, step * STEP_NS)

    def event(self, step: int, text: str, *, error: bool = False) -> None:
        """A line of the trial's history."""
        level = fm.LogLevel.Error if error else fm.LogLevel.Info
        stamp = fm.Timestamp(sec=step // 1000, nsec=step % 1000 * STEP_NS)
        event = fm.Log(timestamp=stamp, level=level, message=text, name="trial")
        self._channels.log(EVENTS, event.encode(), step * STEP_NS)

    def metadata(self, name: str, values: dict[str, Any]) -> None:
        """A metadata record; values that are not text are written as JSON."""
        self._writer.write_metadata(
            name, {key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()}
        )

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """A file inside the log."""
        self._writer.attach(log_time=0, create_time=0, name=name, media_type=media_type, data=data)

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        self._writer.flush()

    def _rows(self, topic: str, values: np.ndarray, steps: np.ndarray) -> None:
        self._channels.log_rows(topic, values, np.asarray(steps, dtype=np.int64) * STEP_NS)


def _protobuf_schemas() -> dict[str, foxglove.Schema]:
    """The schema of every channel but the JSON one."""
    poses = {topic: fm.PoseInFrame.get_schema() for topic in (TRACKED_POSE, GOAL, CUBE_POSE)}
    transforms = {topic: fm.FrameTransforms.get_schema() for topic in (MEASURED_TRANSFORMS, TRUE_TRANSFORMS)}
    scenes = {topic: fm.SceneUpdate.get_schema() for topic in (MEASURED_SCENE, TRUE_SCENE)}
    step = [("observation", _FLOAT, True), ("action", _DOUBLE, True), ("inference_time_ns", _FIXED64, False)]
    return {
        JOINT_STATES: fm.JointStates.get_schema(),
        TORQUE: _schema("Torque", [("desired_nm", _DOUBLE, True), ("applied_nm", _DOUBLE, True)]),
        POLICY: _schema("PolicyStep", step),
        EVENTS: fm.Log.get_schema(),
        **poses,
        **transforms,
        **scenes,
    }


def _joint_states(names: tuple[str, ...], values: list[float]) -> bytes:
    joints = [
        fm.JointState(name=name, position=values[3 * j], velocity=values[3 * j + 1], effort=values[3 * j + 2])
        for j, name in enumerate(names)
    ]
    return fm.JointStates(timestamp=_marked_stamp(), joints=joints).encode()


def _transforms(frames: tuple[tuple[str, str], ...], values: list[float]) -> bytes:
    transforms = []
    for index, (parent, child) in enumerate(frames):
        x, y, z, qw, qx, qy, qz = values[7 * index : 7 * index + 7]
        transforms.append(
            fm.FrameTransform(
                timestamp=_marked_stamp(),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=fm.Vector3(x=x, y=y, z=z),
                rotation=fm.Quaternion(w=qw, x=qx, y=qy, z=qz),
            )
        )
    return fm.FrameTransforms(transforms=transforms).encode()


_TRACKER_SCHEMA = {
    "type": "object",
    "title": "trifarm.Tracker",
    "properties": {
        "capture_time_s": {"type": "number"},
        "delivery_time_s": {"type": "number"},
        "confidence": {"type": "number"},
    },
}
