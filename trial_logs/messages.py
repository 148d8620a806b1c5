"""How the messages of a trial log look: their encoders, and the schemas of those that Foxglove does not have."""

import json
from collections.abc import Sequence
from typing import Any

import foxglove
import numpy as np
from foxglove import messages as fm
from google.protobuf import descriptor_pb2

from trial_logs.block_writer import HEADER_BYTES, room_for
from trial_logs.fixed_message import MARKER_NANOS, MARKER_SECONDS

WORLD_FRAME = "world"


def _schema(name: str, fields: Sequence[tuple[str, int, bool]]) -> foxglove.Schema:
    """A protobuf schema of our own from (name, type, repeated) triples."""
    descriptor = descriptor_pb2.FileDescriptorProto(name=f"trifarm/{name}.proto", package="trifarm", syntax="proto3")
    message = descriptor.message_type.add(name=name)
    for number, (field, kind, repeated) in enumerate(fields, start=1):
        label = (
            descriptor_pb2.FieldDescriptorProto.LABEL_REPEATED if repeated else descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
        )
        message.field.add(name=field, number=number, type=kind, label=label)
    files = descriptor_pb2.FileDescriptorSet(file=[descriptor])
    return foxglove.Schema(name=f"trifarm.{name}", encoding="protobuf", data=files.SerializeToString())


_DOUBLE = descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE
_FLOAT = descriptor_pb2.FieldDescriptorProto.TYPE_FLOAT
_FIXED64 = descriptor_pb2.FieldDescriptorProto.TYPE_FIXED64


def torque_schema() -> foxglove.Schema:
    """Desired and applied torque."""
    return _schema("Torque", [("desired_nm", _DOUBLE, True), ("applied_nm", _DOUBLE, True)])


def command_schema() -> foxglove.Schema:
    """What an excitation asked for."""
    return _schema("Command", [("desired_torque_nm", _DOUBLE, True), ("position_target_rad", _DOUBLE, True)])


def motors_schema() -> foxglove.Schema:
    """Temperatures of the motors."""
    return _schema("Motors", [("temperature_rise_k", _DOUBLE, True)])


def policy_step_schema() -> foxglove.Schema:
    """What a policy saw and asked for."""
    return _schema(
        "PolicyStep", [("observation", _FLOAT, True), ("action", _DOUBLE, True), ("inference_time_ns", _FIXED64, False)]
    )


def packed(number: int, payload: bytes) -> bytes:
    """A length-delimited protobuf field of less than 16 KiB."""
    size = len(payload)
    length = bytes([size]) if size < 0x80 else bytes([size & 0x7F | 0x80, size >> 7])
    return bytes([number << 3 | 2]) + length + payload


def encode_torque(values: list[float]) -> bytes:
    """Desired, then applied torque of nine joints."""
    return packed(1, np.array(values[:9]).tobytes()) + packed(2, np.array(values[9:]).tobytes())


def encode_command(values: list[float]) -> bytes:
    """Desired torque, then position target of nine joints."""
    return encode_torque(values)  # the same layout


def encode_motors(values: list[float]) -> bytes:
    """Temperatures of nine motors."""
    return packed(1, np.array(values).tobytes())


def encode_policy_steps(observation: np.ndarray, action: np.ndarray, inference_time_ns: np.ndarray) -> np.ndarray:
    """Messages of a policy, as ``room_for`` gives them: observations (n, size), as float32, actions (n, 9) and times (n,)."""
    parts, n = (observation.astype("<f4"), action.astype("<f8"), inference_time_ns.astype("<u8")[:, None]), len(action)
    begins = (*(packed(number, part[0].tobytes())[: -part[0].nbytes] for number, part in enumerate(parts[:2], start=1)), b"\x19")
    rows = room_for(n, sum(len(begin) + part[0].nbytes for begin, part in zip(begins, parts, strict=True)))
    place = HEADER_BYTES
    for begin, part in zip(begins, parts, strict=True):
        for content in (np.frombuffer(begin, np.uint8), part.view(np.uint8).reshape(n, -1)):
            rows[:, place : place + content.shape[-1]] = content
            place += content.shape[-1]
    return rows


def _marked_stamp() -> fm.Timestamp:
    return fm.Timestamp(sec=MARKER_SECONDS, nsec=MARKER_NANOS)


def encode_pose(values: list[float]) -> bytes:
    """Position and quaternion wxyz in the world frame."""
    position = fm.Vector3(x=values[0], y=values[1], z=values[2])
    orientation = fm.Quaternion(w=values[3], x=values[4], y=values[5], z=values[6])
    pose = fm.Pose(position=position, orientation=orientation)
    return fm.PoseInFrame(timestamp=_marked_stamp(), frame_id=WORLD_FRAME, pose=pose).encode()


def encode_joint_states(names: tuple[str, ...], values: list[float]) -> bytes:
    """Position, velocity and effort of each joint in turn."""
    joints = [
        fm.JointState(name=name, position=values[3 * j], velocity=values[3 * j + 1], effort=values[3 * j + 2])
        for j, name in enumerate(names)
    ]
    return fm.JointStates(timestamp=_marked_stamp(), joints=joints).encode()


def encode_transforms(frames: tuple[tuple[str, str], ...], values: list[float]) -> bytes:
    """Position and quaternion wxyz of each frame in turn."""
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


_TRACKER: dict[str, Any] = {
    "type": "object",
    "title": "trifarm.Tracker",
    "properties": {
        "capture_time_s": {"type": "number"},
        "delivery_time_s": {"type": "number"},
        "confidence": {"type": "number"},
        "raw_confidence": {"type": "number"},
        "raw_position_world_m": {"type": "array", "items": {"type": "number"}},
        "raw_quat_wxyz": {"type": "array", "items": {"type": "number"}},
    },
}


def tracker_schema(cameras: Sequence[str]) -> foxglove.Schema:
    """A report of the tracker, as JSON; viewers want to know of every object which properties it has."""
    faces = {"type": "object", "properties": {name: {"type": "array", "items": {"type": "string"}} for name in cameras}}
    told = _TRACKER | {"properties": _TRACKER["properties"] | {"visible_faces": faces}}
    return foxglove.Schema(name=_TRACKER["title"], encoding="jsonschema", data=json.dumps(told).encode())
