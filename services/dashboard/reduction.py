"""Reduces a trial's log to what a browser draws: run as a process of its own, so that a large log holds up nobody, in a jail.

The result is one file: the length of a JSON header as four bytes, the header, and the arrays that it names as float32, all
little-endian. A log of any length becomes at most a few megabytes.
"""

import json
import math
import os
import struct
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.reader import McapReader, make_reader
from mcap.summary import Summary
from mcap_protobuf.decoder import DecoderFactory

from api_schemas.tolerance import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M
from jail.entering import enter
from jail.needs import Needs
from services.dashboard import partial
from services.dashboard import replay_limits as limits
from services.dashboard.tips import moments_of
from trial_logs import trial_log as t

MOST_SAMPLES = 1500
"""Of each array over time; more than a screen has columns."""
MOST_IMAGE_BYTES = 4 * 1024**2
"""Of what the cameras of a trial saw; of more images some are left out, evenly over time."""
NICENESS = 10
"""Robots run trials in real time beside this."""
NS = 1e9
OFTEN = (t.JOINT_STATES, t.TORQUE, t.POLICY, t.CUBE_POSE, t.MEASURED_TRANSFORMS)
RARE = (t.TRACKED_POSE, t.TRACKER, t.GOAL, t.MEASURED_SCENE, t.TRUE_SCENE, t.EVENTS)
SHAPES = ("cubes", "spheres", "cylinders", "triangles")


def confined(arguments: list[str]) -> None:
    """``main`` in a jail and its working folder: the log comes from a robot, and anyone may have made what is in it."""
    os.nice(NICENESS)
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)
    enter(Needs(limits.MEMORY_BYTES, limits.CPU_S, limits.LARGEST_REPLAY_BYTES, installation=True, folder=Path.cwd()))
    main(arguments)


def main(arguments: list[str]) -> None:
    """``LOG OUT [TRUTH]``: reduces the log, with what the truth adds to it, to the file OUT.

    ``--measured LOG OUT`` leaves out the truth that a log of an ideal robot has. ``--images LOG OUT`` writes what the cameras
    saw. ``--plan LOG OUT`` writes the byte ranges that the reduction of a large log will read beyond its summary.
    """
    if arguments[0] == "--plan":
        log, out = (Path(argument) for argument in arguments[1:])
        with log.open("rb") as stream:
            out.write_text(json.dumps(partial.plan(_summary(make_reader(stream)), log.stat().st_size)))
        return
    if arguments[0] == "--images":
        log, out = (Path(argument) for argument in arguments[1:])
        out.write_bytes(images(log))
        return
    is_measured = arguments[0] == "--measured"
    log, out, *truth = (Path(argument) for argument in arguments[is_measured:])
    header, arrays = reduce(log, truth[0] if truth else None, with_truth=not is_measured)
    out.write_bytes(packed(header, arrays))


def reduce(log: Path, truth: Path | None, *, with_truth: bool = True) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What is drawn of a trial: a header of scene and words, and arrays over time in seconds, metres, radians and N m."""
    found: dict[str, list[tuple[float, Any]]] = {topic: [] for topic in (*OFTEN, *RARE)}
    with log.open("rb") as stream:
        reader = make_reader(stream)
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        wanted = tuple(topic for topic in found if with_truth or topic not in t.SHARED_TRUTH_TOPICS)
        shown, chunks = _collect(stream, reader, wanted, found)
        has_images = any(_counts(_summary(reader)).get(topic, 0) for topic in t.IMAGES)
    if truth is not None:
        known = (t.CUBE_POSE, t.TRUE_SCENE)
        found |= {topic: [] for topic in known}
        with truth.open("rb") as stream:
            _collect(stream, make_reader(stream), known, found)
    header = {
        "format": "trifarm-replay/1",
        "task": records.get(t.TRIAL_METADATA, {}).get("task", ""),
        "began_at": records.get(t.TRIAL_METADATA, {}).get("began_at", ""),
        "tolerance_mm": 1e3 * POSITION_TOLERANCE_M,
        "tolerance_deg": round(math.degrees(ANGLE_TOLERANCE_RAD), 1),
        "parts": [shown, chunks],
        "has_images": has_images,
        "fixed": [],
        "frames": [],
        "entities": [*_entities(found[t.MEASURED_SCENE]), *_entities(found[t.TRUE_SCENE])],
        "events": [{"t_s": at_s, "text": message.message} for at_s, message in found[t.EVENTS] if message.name != t.MOMENT_EVENT],
        "goal": [_pose(message.pose) for _, message in found[t.GOAL]][:1],
    }
    arrays = _arrays(found)
    fixed, moving = _transforms(found[t.MEASURED_TRANSFORMS])
    header |= {"fixed": fixed, "frames": moving[0]}
    arrays |= {"frame_t_s": moving[1], "frame_pose": moving[2]}
    header["duration_s"] = max(
        (float(times[-1]) for name, times in arrays.items() if name.endswith("t_s") and len(times)), default=0
    )
    header["moments"] = moments_of(header, arrays)
    return header, arrays


def packed(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> bytes:
    """The file: the header says where in what follows it each array begins."""
    parts, at = [], 0
    listed = {}
    for name, values in arrays.items():
        part = np.ascontiguousarray(values, dtype="<f4").tobytes()
        listed[name] = {"shape": list(values.shape), "at": at}
        parts.append(part)
        at += len(part)
    text = json.dumps(header | {"arrays": listed}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # so that the arrays lie on even addresses
    return struct.pack("<I", len(text)) + text + b"".join(parts)


def images(log: Path) -> bytes:
    """What the cameras saw: the length of a JSON header as four bytes, the header, and the JPEG files one after another.

    The header has the ``cameras`` that the log has images of, and for each image its camera, its time in s, where it begins after
    the header and how many bytes it has.
    """
    with log.open("rb") as stream:
        summary = _summary(make_reader(stream))
        chunks = partial.chosen(summary, os.fstat(stream.fileno()).st_size)
        places = {name: at for at, name in enumerate(t.IMAGES)}
        factory, decoders = DecoderFactory(), {}
        seen: list[list[tuple[float, bytes]]] = [[] for _ in t.IMAGES]
        for each in partial.messages(stream, summary, chunks, dict.fromkeys(t.IMAGES, 1)):
            if each.channel.id not in decoders:
                decoders[each.channel.id] = factory.decoder_for(each.channel.message_encoding, each.schema)
            seen[places[each.channel.topic]].append((each.log_time / NS, bytes(decoders[each.channel.id](each.data).data)))
    every = max(1, math.ceil(sum(len(jpeg) for of in seen for _, jpeg in of) / MOST_IMAGE_BYTES))
    listed, parts, at = [], [], 0
    for camera, of in enumerate(seen):
        for at_s, jpeg in of[::every]:
            listed.append([camera, at_s, at, len(jpeg)])
            parts.append(jpeg)
            at += len(jpeg)
    text = json.dumps({"cameras": list(t.CAMERA_NAMES), "images": listed}, separators=(",", ":")).encode()
    return struct.pack("<I", len(text)) + text + b"".join(parts)


def _summary(reader: McapReader) -> Summary:
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise SystemExit("the log has no summary: the robot that wrote it did not finish")
    return summary


def _counts(summary: Summary) -> dict[str, int]:
    """How many messages each topic has."""
    counted = {} if summary.statistics is None else summary.statistics.channel_message_counts
    return {channel.topic: counted.get(number, 0) for number, channel in summary.channels.items()}


def _collect(
    stream: BinaryIO, reader: McapReader, topics: tuple[str, ...], found: dict[str, list[tuple[float, Any]]]
) -> tuple[int, int]:
    """Decodes of each frequent topic only as many messages as will be drawn, evenly over time; gives the parts read and all."""
    summary = _summary(reader)
    counts = _counts(summary)
    chunks = partial.chosen(summary, os.fstat(stream.fileno()).st_size)
    share = len(chunks) / max(1, len(summary.chunk_indexes))
    every = {topic: max(1, math.ceil(share * counts.get(topic, 0) / MOST_SAMPLES)) for topic in OFTEN if topic in topics}
    factory, decoders = DecoderFactory(), {}
    # In the order of the file, which is that of time within each topic: to merge all topics by time takes a third longer.
    for each in partial.messages(stream, summary, chunks, dict.fromkeys(topics, 1) | every):
        channel = each.channel
        if channel.id not in decoders:
            is_json = channel.message_encoding == "json"
            decoders[channel.id] = json.loads if is_json else factory.decoder_for(channel.message_encoding, each.schema)
        found[channel.topic].append((each.log_time / NS, decoders[channel.id](each.data)))
    return len(chunks), len(summary.chunk_indexes)


def _arrays(found: dict[str, list[tuple[float, Any]]]) -> dict[str, np.ndarray]:
    joints = np.array([[(j.position, j.velocity, j.effort) for j in message.joints] for _, message in found[t.JOINT_STATES]])
    joints = joints.reshape(-1, 9, 3)
    torque = found[t.TORQUE]
    return {
        "joint_t_s": _times(found[t.JOINT_STATES]),
        "joint_position_rad": joints[:, :, 0],
        "joint_velocity_rad_s": joints[:, :, 1],
        "torque_t_s": _times(torque),
        "desired_nm": np.array([message.desired_nm for _, message in torque]).reshape(-1, 9),
        "applied_nm": np.array([message.applied_nm for _, message in torque]).reshape(-1, 9),
        "tracked_t_s": _times(found[t.TRACKED_POSE]),
        "captured_t_s": np.array([message.get("capture_time_s", at_s) for at_s, message in found[t.TRACKER]], dtype=float),
        "tracked_pose": _poses(message.pose for _, message in found[t.TRACKED_POSE]),
        "confidence": np.array([message["confidence"] for _, message in found[t.TRACKER]]),
        "true_t_s": _times(found[t.CUBE_POSE]),
        "true_pose": _poses(message.pose for _, message in found[t.CUBE_POSE]),
        "policy_t_s": _times(found[t.POLICY]),
        "inference_ms": np.array([message.inference_time_ns / 1e6 for _, message in found[t.POLICY]]),
    }


def _times(messages: list[tuple[float, Any]]) -> np.ndarray:
    return np.array([at_s for at_s, _ in messages])


def _poses(poses: Iterable[Any]) -> np.ndarray:
    """Shape (n, 7): position and quaternion wxyz."""
    return np.array([_pose(pose) for pose in poses]).reshape(-1, 7)


def _pose(pose: Any) -> list[float]:
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def _transforms(messages: list[tuple[float, Any]]) -> tuple[list[dict], tuple[list[list[str]], np.ndarray, np.ndarray]]:
    """The transforms that never move, and the names, times and rows of those that do; shape (n, frames, 7)."""
    if not messages:
        return [], ([], np.zeros(0), np.zeros((0, 0, 7)))
    # Those that never move are told at the start: links, and where the log keeps images the cameras in a message of their own.
    told = [[[f.parent_frame_id, f.child_frame_id] for f in message.transforms] for _, message in messages]
    names = told[-1] if len(messages) > 1 else []
    moving = [message for message, its in zip(messages, told, strict=True) if its == names]
    still = [f for (_, message), its in zip(messages, told, strict=True) if its != names for f in message.transforms]
    fixed = [{"parent": f.parent_frame_id, "child": f.child_frame_id, "pose": _transform(f)} for f in still]
    rows = np.array([[_transform(f) for f in message.transforms] for _, message in moving]).reshape(len(moving), len(names), 7)
    return fixed, (names, _times(moving), rows)


def _transform(frame: Any) -> list[float]:
    p, q = frame.translation, frame.rotation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def _entities(scenes: list[tuple[float, Any]]) -> Iterator[dict[str, Any]]:
    """The primitives of a scene, each with its frame."""
    for _, scene in scenes[:1]:
        for entity in scene.entities:
            for kind in SHAPES:
                for shape in getattr(entity, kind):
                    yield {"id": entity.id, "frame": entity.frame_id, "kind": kind, **_primitive(kind, shape)}


def _primitive(kind: str, shape: Any) -> dict[str, Any]:
    c = shape.color
    common = {"pose": _pose(shape.pose), "colour": [c.r, c.g, c.b, c.a]}
    if kind == "triangles":
        return common | {"points": [[p.x, p.y, p.z] for p in shape.points], "indices": list(shape.indices)}
    return common | {"size": [shape.size.x, shape.size.y, shape.size.z]}


if __name__ == "__main__":
    confined(sys.argv[1:])
