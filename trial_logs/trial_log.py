"""The log of a trial: which MCAP channels it has, and its writer.

``/measured/`` channels hold what a real robot could give, ``/truth/`` channels what only a simulation knows. Robots that are all
the same ideal one write both into one file; every other robot writes the truth into a file of its own (``TRUTH_TOPICS``). Times
are simulated nanoseconds since the trial's start; a tracked pose is logged when it was delivered and stamped when its image was
taken. Messages are those of Foxglove where it has one, so that Foxglove and Lichtblick show a log without set-up.
"""

import json
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import foxglove
import numpy as np
from foxglove import messages as fm

from trial_logs.block_writer import BlockWriter, Topic
from trial_logs.fixed_message import FixedMessage
from trial_logs.messages import (
    WORLD_FRAME,
    command_schema,
    encode_command,
    encode_joint_states,
    encode_motors,
    encode_policy_steps,
    encode_pose,
    encode_torque,
    encode_transforms,
    motors_schema,
    policy_step_schema,
    torque_schema,
    tracker_schema,
)

JOINT_STATES = "/measured/joint_states"  # foxglove.JointStates at 1 kHz; effort is the measured torque
TORQUE = "/measured/torque"  # trifarm.Torque at 1 kHz: desired and applied
TRACKED_POSE = "/measured/tracked_cube_pose"  # foxglove.PoseInFrame at 10 Hz
TRACKER = "/measured/tracker"  # JSON at 10 Hz: capture and delivery time, confidence, visible faces, the pose before the filter
POLICY = "/measured/policy"  # trifarm.PolicyStep at the policy's rate: observation, action, inference time
COMMAND = "/measured/command"  # trifarm.Command, instead of POLICY, where an excitation ran
GOAL = "/measured/goal"  # foxglove.PoseInFrame, once; not for ``reach``, whose goal is a metadata record
MEASURED_TRANSFORMS = "/measured/tf"  # foxglove.FrameTransforms
MEASURED_SCENE = "/measured/scene"  # foxglove.SceneUpdate, once
EVENTS = "/measured/events"  # foxglove.Log
CAMERA_NAMES = ("camera60", "camera180", "camera300")
IMAGES = tuple(
    f"/measured/{name}/image" for name in CAMERA_NAMES
)  # foxglove.CompressedImage at 10 Hz, where images were asked for
CALIBRATIONS = tuple(
    f"/measured/{name}/calibration" for name in CAMERA_NAMES
)  # foxglove.CameraCalibration, once; as its file has it
CUBE_POSE = "/truth/cube_pose"  # foxglove.PoseInFrame at 100 Hz
TRUE_TRANSFORMS = "/truth/tf"  # foxglove.FrameTransforms
TRUE_SCENE = "/truth/scene"  # foxglove.SceneUpdate, once
TRUE_JOINT_STATES = "/truth/joint_states"  # foxglove.JointStates at 100 Hz; effort is the torque that reached the joint
MOTORS = "/truth/motors"  # trifarm.Motors at 4 Hz: temperatures
TRUE_EVENTS = "/truth/events"  # foxglove.Log: faults as they come and go

SHARED_TRUTH_TOPICS = (CUBE_POSE, TRUE_TRANSFORMS, TRUE_SCENE)
"""The truth about robots that are all alike: it gives nothing away and stands in the same file."""
TRUTH_TOPICS = (*SHARED_TRUTH_TOPICS, TRUE_JOINT_STATES, MOTORS, TRUE_EVENTS)
MEASURED_TOPICS = (
    JOINT_STATES,
    TORQUE,
    TRACKED_POSE,
    TRACKER,
    POLICY,
    COMMAND,
    GOAL,
    MEASURED_TRANSFORMS,
    MEASURED_SCENE,
    EVENTS,
    *IMAGES,
    *CALIBRATIONS,
)

TRIAL_EVENT, MOMENT_EVENT = "trial", "moment"
"""The names of events: lines of the trial's life, and moments that its robot found in what it had measured."""
Level = Literal["info", "warning", "error"]
"""A missed goal and what went wrong on the way are warnings, faults are errors."""
LEVELS: dict[Level, fm.LogLevel] = {"info": fm.LogLevel.Info, "warning": fm.LogLevel.Warning, "error": fm.LogLevel.Error}
TRIAL_METADATA = "trial"
OUTCOME_METADATA = "outcome"
GOAL_METADATA = "goal"
PHYSICS_METADATA = "physics"
"""Of a truth file: the robot's effects and how they changed, the start and the seed of the noise."""
MODEL_ATTACHMENT = "model.xml"
MANIFEST_ATTACHMENT = "manifest.json"

STEP_NS = 1_000_000
FLUSH_EVERY_S, FLUSH_EVERY_STEPS = 0.25, 1000
"""The recorder flushes so often: a killed robot loses at most so many seconds of its work, or so many steps if that is less.

A robot alone simulates a second in less than a tenth; each flush costs as much as writing a hundred steps.
"""


class LogChannels:
    """The channels of a robot's logs and the templates of their messages, made once for all of its trials.

    Args:
        joint_names: names of the nine joints.
        frames: (parent, child) of the moving transforms under /measured/tf, in the order of their rows.
        topics: the channels that there are.
    """

    def __init__(
        self,
        *,
        joint_names: tuple[str, ...],
        frames: tuple[tuple[str, str], ...],
        topics: tuple[str, ...] = (*MEASURED_TOPICS, *SHARED_TRUTH_TOPICS),
    ) -> None:
        joint_states = FixedMessage(lambda v: encode_joint_states(joint_names, v), 3 * len(joint_names))
        self.fixed = {
            JOINT_STATES: joint_states,
            TRUE_JOINT_STATES: joint_states,
            TORQUE: FixedMessage(encode_torque, 18),
            COMMAND: FixedMessage(encode_command, 18),
            MOTORS: FixedMessage(encode_motors, len(joint_names)),
            MEASURED_TRANSFORMS: FixedMessage(lambda v: encode_transforms(frames, v), 7 * len(frames)),
            TRUE_TRANSFORMS: FixedMessage(lambda v: encode_transforms(((WORLD_FRAME, "cube"),), v), 7),
        }
        self.fixed |= dict.fromkeys((TRACKED_POSE, GOAL, CUBE_POSE), FixedMessage(encode_pose, 7))
        schemas = {topic: schema for topic, schema in _protobuf_schemas().items() if topic in topics}
        self.topics = {topic: Topic("protobuf", schema) for topic, schema in schemas.items()}
        if TRACKER in topics:
            self.topics[TRACKER] = Topic("json", tracker_schema(CAMERA_NAMES))


class TrialLogWriter:
    """Writes one trial's log; a context manager. Steps are physics steps of 1 ms since the trial's start.

    Args:
        path: file to create; it must not exist.
        channels: the robot's channels.
    """

    def __init__(self, path: Path, channels: LogChannels) -> None:
        self._writer, self._fixed = BlockWriter(path, channels.topics), channels.fixed

    def __enter__(self) -> "TrialLogWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._writer.close()

    def joint_states(self, first_step: int, position: np.ndarray, velocity: np.ndarray, torque_nm: np.ndarray) -> None:
        """Rows of consecutive steps; each array has shape (n, 9), in rad, rad/s and N m."""
        self._rows(JOINT_STATES, _by_joint(position, velocity, torque_nm), first_step + np.arange(len(position)))

    def true_joint_states(self, steps: np.ndarray, position: np.ndarray, velocity: np.ndarray, torque_nm: np.ndarray) -> None:
        """True states and the torque that reached the joints; shapes (n,) and (n, 9), in rad, rad/s and N m."""
        self._rows(TRUE_JOINT_STATES, _by_joint(position, velocity, torque_nm), steps)

    def motors(self, step: int, temperature_rise_k: np.ndarray) -> None:
        """Temperatures of the motors above ambient, shape (9,), K."""
        self._rows(MOTORS, temperature_rise_k[None], np.array([step]))

    def command(self, step: int, desired_torque_nm: np.ndarray, position_target_rad: np.ndarray | None) -> None:
        """What an excitation asked for, each shape (9,), N m and rad; without a position part the targets are NaN."""
        target = np.full(len(desired_torque_nm), np.nan) if position_target_rad is None else position_target_rad
        self._rows(COMMAND, np.concatenate([desired_torque_nm, target])[None], np.array([step]))

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
        self,
        capture_step: int,
        delivery_step: int,
        position_world_m: np.ndarray,
        quat_wxyz: np.ndarray,
        confidence: float,
        **more: Any,
    ) -> None:
        """One report of the tracker; ``more`` is written with it. Images taken before the start are stamped with the start."""
        pose, stamp_ns = np.concatenate([position_world_m, quat_wxyz]), max(0, capture_step) * STEP_NS
        at_ns = max(0, delivery_step) * STEP_NS
        self._writer.message(TRACKED_POSE, self._fixed[TRACKED_POSE].one(pose, stamp_ns), at_ns)
        report = {
            "capture_time_s": capture_step * STEP_NS / 1e9,
            "delivery_time_s": delivery_step * STEP_NS / 1e9,
            "confidence": float(confidence),
            **more,
        }
        self._writer.message(TRACKER, json.dumps(report).encode(), at_ns)

    def goal(self, position_world_m: np.ndarray, quat_wxyz: np.ndarray) -> None:
        """The wanted pose of the cube, at the start."""
        values = np.concatenate([position_world_m, quat_wxyz])[None]
        self._rows(GOAL, values, np.zeros(1))

    def policy_steps(self, steps: np.ndarray, observation: np.ndarray, action: np.ndarray, inference_time_ns: np.ndarray) -> None:
        """What the policy saw, what it asked for and how long it took; shapes (n,), (n, size), (n, 9) and (n,)."""
        self._writer.rows(POLICY, encode_policy_steps(observation, action, inference_time_ns), steps * STEP_NS)

    def message(self, topic: str, step: int, encoded: bytes) -> None:
        """One encoded message of a channel that is written rarely (scenes, fixed transforms)."""
        self._writer.message(topic, encoded, step * STEP_NS)

    def image(self, camera: int, step: int, jpeg: bytes) -> None:
        """What a camera saw when it was exposed at a step, as a JPEG file."""
        image = fm.CompressedImage(timestamp=_stamp(step), frame_id=CAMERA_NAMES[camera], data=jpeg, format="jpeg")
        self._writer.message(IMAGES[camera], image.encode(), step * STEP_NS)

    def event(self, step: int, text: str, *, level: Level = "info", topic: str = EVENTS, name: str = TRIAL_EVENT) -> None:
        """A line of the trial's history; ``name`` tells lines of its life from moments that were found in what was measured."""
        event = fm.Log(timestamp=_stamp(step), level=LEVELS[level], message=text, name=name)
        self._writer.message(topic, event.encode(), step * STEP_NS)

    def metadata(self, name: str, values: dict[str, Any]) -> None:
        """A metadata record; values that are not text are written as JSON."""
        self._writer.metadata(
            name, {key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()}
        )

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """A file inside the log."""
        self._writer.attach(name, media_type, data)

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        self._writer.flush()

    def _rows(self, topic: str, values: np.ndarray, steps: np.ndarray) -> None:
        times_ns = np.asarray(steps, dtype=np.int64) * STEP_NS
        self._writer.rows(topic, self._fixed[topic].rows(values, times_ns), times_ns)


def _by_joint(position: np.ndarray, velocity: np.ndarray, torque_nm: np.ndarray) -> np.ndarray:
    """Three arrays of shape (n, joints) as one, (n, 3 * joints), joint by joint; n may be 0."""
    return np.stack([position, velocity, torque_nm], axis=2).reshape(len(position), 3 * position.shape[1])


def _stamp(step: int) -> fm.Timestamp:
    return fm.Timestamp(sec=step // 1000, nsec=step % 1000 * STEP_NS)


def _protobuf_schemas() -> dict[str, foxglove.Schema]:
    """The schema of every channel but the JSON one."""
    poses = {topic: fm.PoseInFrame.get_schema() for topic in (TRACKED_POSE, GOAL, CUBE_POSE)}
    transforms = {topic: fm.FrameTransforms.get_schema() for topic in (MEASURED_TRANSFORMS, TRUE_TRANSFORMS)}
    scenes = {topic: fm.SceneUpdate.get_schema() for topic in (MEASURED_SCENE, TRUE_SCENE)}
    return {
        JOINT_STATES: fm.JointStates.get_schema(),
        TRUE_JOINT_STATES: fm.JointStates.get_schema(),
        COMMAND: command_schema(),
        MOTORS: motors_schema(),
        TORQUE: torque_schema(),
        POLICY: policy_step_schema(),
        EVENTS: fm.Log.get_schema(),
        TRUE_EVENTS: fm.Log.get_schema(),
        **dict.fromkeys(IMAGES, fm.CompressedImage.get_schema()),
        **dict.fromkeys(CALIBRATIONS, fm.CameraCalibration.get_schema()),
        **poses,
        **transforms,
        **scenes,
    }
