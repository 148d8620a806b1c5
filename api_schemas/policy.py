"""A policy is weights plus a manifest, never code: the manifest, its ready-made layouts and the policy's digest."""

import hashlib
import json
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, model_validator

from api_schemas.error import Problem
from api_schemas.observation import sizes_of, term_of
from api_schemas.policy_images import PolicyImages
from api_schemas.policy_network import MOST_BINS, ActionHead, Cell, FrameStack, NetworkState
from api_schemas.schema import Schema

ACTION_SIZE = 9
MOST_TERMS, MOST_NUMBERS = 128, 4096
"""Entries of an observation, and numbers in all."""
MAX_WEIGHTS_BYTES = 64 * 1024 * 1024
PERIOD_MS_DIVISORS = "1000 must be a multiple of rate_hz, so that a control period is a whole number of 1 ms steps"


class ActionKind(StrEnum):
    """What the nine outputs of a policy mean."""

    TORQUE = "torque"  # N m at the joints
    JOINT_POSITION = "joint_position"  # rad, followed by the robot's position controller
    JOINT_POSITION_DELTA = "joint_position_delta"  # rad, added to the measured position of the same observation


class WeightsFormat(StrEnum):
    """The forms of weights that the farm accepts. Of a zip of stable-baselines3 only numbers and plain text are read."""

    SAFETENSORS = "safetensors"
    ONNX = "onnx"
    ZIP = "zip"


BUILTIN_FORMAT: Literal["builtin"] = "builtin"
"""What a policy that comes with the farm has instead (``builtin_policies.py``); nobody can send it."""


def _known_fields(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        term_of(name)
    if sum(sizes_of(names)) > MOST_NUMBERS:
        raise ValueError(f"the observation has {sum(sizes_of(names))} numbers; at most {MOST_NUMBERS} are taken")
    return names


class InputScaling(Schema):
    """How an observation becomes the network's input: bounds to [-1, 1], running mean and variance, a whitening matrix, a clip.

    ``whitening`` has a row for each number that comes out, as many as go in. Each list has one number per observation element,
    or per element of the stack of observations. For safetensors they may be left out and are then read from the tensors
    ``observation_low``, ``observation_high``, ``running_mean``, ``running_var`` and ``whitening_matrix``, if the file has them.
    """

    low: tuple[float, ...] | None = None
    high: tuple[float, ...] | None = None
    mean: tuple[float, ...] | None = None
    variance: tuple[float, ...] | None = None
    epsilon: float = Field(default=1e-5, gt=0)
    clip: float | None = Field(default=None, gt=0)
    whitening: tuple[tuple[float, ...], ...] | None = None


class OutputScaling(Schema):
    """How the network's output becomes an action: squashed, clipped to ±clip, times ``scale``, plus ``offset`` (N m or rad).

    ``scale`` and ``offset`` may be one number or nine; for safetensors ``scale`` may be left out and is then read from
    ``torque_limit_nm``.
    """

    clip: float | None = Field(default=None, gt=0)
    scale: float | tuple[float, ...] | None = None
    squash: Literal["tanh"] | None = None
    offset: float | tuple[float, ...] | None = None


class PolicyManifest(Schema):
    """What a policy expects of the robot that runs it.

    ``recurrent`` names the cell of a safetensors file with memory, ``states`` the memory of an ONNX file; ``images`` is for ONNX
    files that see, beside their observation.
    """

    format: Literal["trifarm-policy/1"] = "trifarm-policy/1"
    name: str = Field(default="unnamed", min_length=1, max_length=100)
    observation: Annotated[tuple[str, ...], AfterValidator(_known_fields)] = Field(min_length=1, max_length=MOST_TERMS)
    action_kind: ActionKind = ActionKind.TORQUE
    rate_hz: int = Field(default=50, ge=4, le=1000)
    action_delay_s: float = Field(default=0.0, ge=0, lt=1)
    activation: Literal["elu", "relu", "tanh"] = "elu"
    input_scaling: InputScaling = InputScaling()
    output_scaling: OutputScaling = OutputScaling()
    frame_stack: FrameStack | None = None
    recurrent: Cell | None = None
    states: tuple[NetworkState, ...] = Field(default=(), max_length=8)
    head: ActionHead = ActionHead.DIRECT
    bins: int | None = Field(default=None, ge=2, le=MOST_BINS)
    images: PolicyImages | None = None

    @model_validator(mode="after")
    def _timing_fits(self) -> "PolicyManifest":
        if 1000 % self.rate_hz:
            raise ValueError(f"rate_hz is {self.rate_hz}; {PERIOD_MS_DIVISORS}")
        if self.action_delay_s >= 1 / self.rate_hz:
            raise ValueError(
                f"action_delay_s is {self.action_delay_s}, but must be shorter than the control period {1 / self.rate_hz:g} s"
            )
        if abs(self.action_delay_s * 1000 - round(self.action_delay_s * 1000)) > 1e-9:
            raise ValueError(f"action_delay_s is {self.action_delay_s}; it must be a whole number of milliseconds")
        return self

    @model_validator(mode="after")
    def _network_fits(self) -> "PolicyManifest":
        if (self.bins is None) == (self.head is ActionHead.BINS):
            raise ValueError(f"head is {self.head.value} and bins is {self.bins}; give bins with the head 'bins', and only there")
        if self.recurrent is not None and self.states:
            raise ValueError("recurrent is for safetensors, states for ONNX; give one of them")
        if self.recurrent is not None and self.images is not None:
            raise ValueError("recurrent is for safetensors, images for ONNX; give one of them")
        names = [name for state in self.states for name in (state.input, state.output)]
        names += [] if self.images is None else [self.images.input]
        if len(set(names)) != len(names):
            raise ValueError("each state needs an input and an output of its own, and so do images an input")
        return self

    @property
    def network_inputs(self) -> int:
        """Numbers that the network takes: an observation, or a stack of them."""
        return self.observation_size * (self.frame_stack.count if self.frame_stack else 1)

    @property
    def network_outputs(self) -> int:
        """Numbers that the network gives."""
        return ACTION_SIZE * {ActionHead.DIRECT: 1, ActionHead.GAUSSIAN: 2, ActionHead.BINS: self.bins or 0}[self.head]

    @property
    def observation_size(self) -> int:
        """Number of elements of the observation vector."""
        return sum(sizes_of(self.observation))

    @property
    def period_steps(self) -> int:
        """Control period in physics steps of 1 ms."""
        return 1000 // self.rate_hz

    @property
    def delay_steps(self) -> int:
        """Delay between an observation and its action in physics steps of 1 ms."""
        return round(self.action_delay_s * 1000)


def _rrc2022(task_goal: str, action_delay_s: float, name: str) -> PolicyManifest:
    return PolicyManifest(
        name=name,
        observation=("joint_position_rad", "joint_velocity_rad_s", "cube_keypoints_world_m", task_goal, "previous_action"),
        action_delay_s=action_delay_s,
        input_scaling=InputScaling(clip=5.0),
        output_scaling=OutputScaling(clip=1.0),
    )


def _rrc2022_flat(achieved: str, task_goal: str, action_delay_s: float, name: str) -> PolicyManifest:
    """All that ``trifinger_rl_datasets`` observes, flattened in the order of its sorted keys (TRD sim_env.py)."""
    camera = ("tracker_confidence", "tracker_delay_s", "cube_keypoints_world_m", "cube_quat_xyzw", "cube_position_world_m")
    tips = ("fingertip_force", "fingertip_position_world_m", "fingertip_velocity_world_m_s")
    robot = (*tips, "joint_position_rad", "robot_id", "joint_torque_nm", "joint_velocity_rad_s")
    observation = (achieved, "previous_action", *camera, task_goal, *robot)
    return PolicyManifest(name=name, observation=observation, action_delay_s=action_delay_s)


_ROBOT = ("joint_position_rad", "joint_velocity_rad_s", "fingertip_position_world_m")
_CUBE = ("cube_keypoints_world_m", "tracker_delay_s")
LAYOUTS: dict[str, PolicyManifest] = {
    "rrc2022-push": _rrc2022("goal_position_world_m", 0.010, "rrc2022-push"),
    "rrc2022-lift": _rrc2022("goal_keypoints_world_m", 0.002, "rrc2022-lift"),
    "rrc2022-push-flat": _rrc2022_flat("cube_position_world_m", "goal_position_world_m", 0.010, "rrc2022-push-flat"),
    "rrc2022-lift-flat": _rrc2022_flat("cube_keypoints_world_m", "goal_keypoints_world_m", 0.002, "rrc2022-lift-flat"),
    "keypoints": PolicyManifest(
        name="keypoints",
        observation=(
            "joint_position_rad",
            "joint_velocity_rad_s",
            "cube_keypoints_world_m",
            "goal_keypoints_world_m",
            "previous_action",
        ),
        output_scaling=OutputScaling(clip=1.0),
    ),
    "pose": PolicyManifest(
        name="pose",
        observation=(
            "joint_position_rad",
            "joint_velocity_rad_s",
            "cube_position_world_m",
            "cube_quat_wxyz",
            "goal_position_world_m",
            "goal_quat_wxyz",
            "previous_action",
        ),
        output_scaling=OutputScaling(clip=1.0),
    ),
    "reach": PolicyManifest(
        name="reach",
        observation=(
            *_ROBOT,
            "goal_fingertip_position_world_m",
            "previous_action",
        ),
    ),
    "push": PolicyManifest(
        name="push",
        observation=(
            *_ROBOT,
            *_CUBE,
            "goal_position_world_m",
            "previous_action",
        ),
    ),
    "move": PolicyManifest(
        name="move",
        observation=(
            *_ROBOT,
            *_CUBE,
            "goal_keypoints_world_m",
            "previous_action",
        ),
    ),
    "move-pose": PolicyManifest(
        name="move-pose",
        observation=(
            *_ROBOT,
            "cube_position_world_m",
            "cube_quat_wxyz",
            "tracker_delay_s",
            "goal_position_world_m",
            "goal_quat_wxyz",
            "previous_action",
        ),
    ),
    "images": PolicyManifest(
        name="images",
        observation=(
            *_ROBOT,
            "tracker_delay_s",
            "goal_position_world_m",
            "goal_quat_wxyz",
            "previous_action",
        ),
        rate_hz=10,
        images=PolicyImages(),
    ),
}
"""Ready-made manifests by name; ``rrc2022-*`` are those of the published experts (Gürtler et al. 2023, arXiv
2307.15690, and github.com/rr-learning/trifinger-rl-example).

``rrc2022-*-flat`` show the whole observation of the published datasets; their actions are N m as they are. ``reach``, ``push``,
``move`` and ``move-pose`` are what policies of the shipped recipes see, the fingertips, too: ``push`` is for goals without an
orientation, ``move`` and ``move-pose`` for any pose, by corners and by quaternion. ``images`` shows no pose of the object but
what the cameras see.
"""


ADDED_LATER = ("frame_stack", "recurrent", "states", "head", "bins", "images")
ADDED_TO_INPUT_SCALING = ("whitening",)
ADDED_TO_OUTPUT_SCALING = ("squash", "offset")
"""Fields that the first manifests did not have; left out where they say nothing, so that no digest has changed, and older robots
take what has nothing new in it."""


def canonical_json(manifest: PolicyManifest) -> str:
    """The one spelling of a manifest that is hashed: sorted keys, no spaces, defaults written out but those added later."""
    return json.dumps(first_form(manifest), sort_keys=True, separators=(",", ":"), allow_nan=False)


def first_form(manifest: PolicyManifest) -> dict[str, Any]:
    """A manifest as JSON for whoever may know its first form alone: without fields that came later and say nothing."""
    content = manifest.model_dump(mode="json")
    _drop_defaults(content, manifest, ADDED_LATER)
    _drop_defaults(content["input_scaling"], manifest.input_scaling, ADDED_TO_INPUT_SCALING)
    _drop_defaults(content["output_scaling"], manifest.output_scaling, ADDED_TO_OUTPUT_SCALING)
    return content


def _drop_defaults(content: dict[str, Any], given: BaseModel, names: tuple[str, ...]) -> None:
    for name in names:
        if getattr(given, name) == type(given).model_fields[name].default:
            del content[name]


def policy_digest(weights_sha256: str, manifest: PolicyManifest) -> str:
    """SHA-256 (hex) that identifies a policy: over the weights' digest and the canonical manifest."""
    return hashlib.sha256(f"{weights_sha256}\n{canonical_json(manifest)}".encode()).hexdigest()


class Policy(Schema):
    """A policy as the API shows it."""

    digest: str
    name: str
    weights_format: WeightsFormat | Literal["builtin"]
    weights_sha256: str
    weights_bytes: int
    graph_sha256: str
    manifest: PolicyManifest
    warnings: tuple[str, ...] = ()
    created_at: str


class PolicyPage(Schema):
    """One page of policies; ``next_cursor`` is null on the last page."""

    policies: tuple[Policy, ...]
    next_cursor: str | None = None


class PolicyCheck(Schema):
    """The verdict on weights and a manifest; ``problem`` is what the server would answer to those that it refuses."""

    accepted: bool
    file: str
    digest: str
    weights_format: WeightsFormat | None = None
    weights_bytes: int
    warnings: tuple[str, ...] = ()
    problem: Problem | None = None
