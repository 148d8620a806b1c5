"""Trials, their attempts and their outcomes: how a trial ended and whose fault it was."""

from enum import StrEnum

from pydantic import Field

from api_schemas.excitation import ExcitationName
from api_schemas.goal import OwnGoal
from api_schemas.jail_report import JailReport
from api_schemas.scene_form import form_or_first
from api_schemas.schema import Schema
from api_schemas.tracker import TrackerName

NineNumbers = tuple[float, float, float, float, float, float, float, float, float]
Pose = tuple[float, float, float, float, float, float, float]
MAX_REASON = 2000
"""Characters of a reason."""


class TrialState(StrEnum):
    """``queued -> leased -> running -> done``, and back to ``queued`` after a fault of the platform."""

    HELD = "held"  # not in the queue yet: the goals before it may answer the job's question
    QUEUED = "queued"
    LEASED = "leased"
    RUNNING = "running"
    DONE = "done"
    CANCELLED = "cancelled"


class Fault(StrEnum):
    """Whose fault the end of a trial was. A platform fault is tried again and never counts in a success rate."""

    NONE = "none"
    POLICY = "policy"
    PLATFORM = "platform"


class OutcomeKind(StrEnum):
    """How an attempt ended."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"  # ran to the end, goal not reached: nobody's fault
    RECORDED = "recorded"  # an excitation ran to its end; it has no goal
    NONFINITE_ACTION = "nonfinite_action"
    ACTION_DEADLINE = "action_deadline"  # the policy used more than its CPU time for one action
    POLICY_PROCESS_ENDED = "policy_process_ended"
    POLICY_ERROR = "policy_error"  # the network raised an error
    PLATFORM_ERROR = "platform_error"
    LEASE_LOST = "lease_lost"
    OUT_OF_SPACE = "out_of_space"  # the robot's disk was full; it counts neither for the trial nor for the robot
    CANCELLED = "cancelled"


FAULT_OF: dict[OutcomeKind, Fault] = {
    OutcomeKind.SUCCEEDED: Fault.NONE,
    OutcomeKind.FAILED: Fault.NONE,
    OutcomeKind.RECORDED: Fault.NONE,
    OutcomeKind.NONFINITE_ACTION: Fault.POLICY,
    OutcomeKind.ACTION_DEADLINE: Fault.POLICY,
    OutcomeKind.POLICY_PROCESS_ENDED: Fault.POLICY,
    OutcomeKind.POLICY_ERROR: Fault.POLICY,
    OutcomeKind.PLATFORM_ERROR: Fault.PLATFORM,
    OutcomeKind.LEASE_LOST: Fault.PLATFORM,
    OutcomeKind.OUT_OF_SPACE: Fault.PLATFORM,
    OutcomeKind.CANCELLED: Fault.NONE,
}


class Measures(Schema):
    """What a trial achieved, measured on the true poses (Gürtler et al., ICLR 2023, and the 2020 challenge cost).

    Errors of ``reach`` are those of the worst fingertip; angles are null where the task ignores orientation.
    """

    success_at_end: bool
    success_ever: bool
    success_fraction: float = Field(ge=0, le=1)  # of control steps
    final_position_error_m: float
    final_angle_error_rad: float | None
    episode_return: float
    control_steps: int
    simulated_s: float


class PolicyTiming(Schema):
    """Wall-clock inference time of one trial, recorded and never allowed to change the physics."""

    mean_ms: float
    p99_ms: float
    max_ms: float
    allowed_ms: float  # what the manifest leaves on hardware: its action delay + 1 ms
    missed: int  # actions that took longer than allowed


class FailureCause(Schema):
    """Why a goal was missed, in one sentence told from measured numbers; ``kind`` groups such trials."""

    kind: str = Field(max_length=40)
    sentence: str = Field(max_length=MAX_REASON)
    at_s: float | None = None
    finger: str | None = Field(default=None, max_length=40)


MAX_GLIMPSES = 16


class Glimpse(Schema):
    """A few measured poses of a trial, from which a small looping picture of it is drawn."""

    t_s: tuple[float, ...] = Field(max_length=MAX_GLIMPSES)
    joint_position_rad: tuple[NineNumbers, ...] = Field(max_length=MAX_GLIMPSES)
    tracked_pose: tuple[Pose, ...] = Field(max_length=MAX_GLIMPSES, description="x, y, z in m and quaternion wxyz, each")
    goal: Pose | NineNumbers | None = Field(description="pose of the object, or a point for each fingertip")


class Outcome(Schema):
    """How an attempt ended, whose fault it was, and what was measured until then."""

    kind: OutcomeKind
    fault: Fault
    reason: str = Field(max_length=MAX_REASON)
    measures: Measures | None = None
    policy_timing: PolicyTiming | None = None
    wall_s: float = 0.0
    jail: JailReport | None = None  # of the policy's process; none where it never started or there was no policy
    form: str | None = Field(default=None, max_length=40, description="of the scene; null from robots of 0.1.0")
    # Left out where there is none, so that services that do not know it take outcomes of newer robots.
    failure: FailureCause | None = Field(default=None, exclude_if=lambda cause: cause is None)
    glimpse: Glimpse | None = Field(default=None, exclude_if=lambda glimpse: glimpse is None)
    tracker: TrackerName = Field(default=TrackerName.POSE, exclude_if=lambda tracker: tracker is TrackerName.POSE)


class AttemptState(StrEnum):
    """What became of a lease: still open, its outcome accepted, a platform fault, cancelled, or declined by the robot.

    A declined offer never began, so that it is neither a fault nor an attempt that counts.
    """

    OPEN = "open"
    ACCEPTED = "accepted"
    PLATFORM_FAULT = "platform_fault"
    CANCELLED = "cancelled"
    DECLINED = "declined"


class Attempt(Schema):
    """One lease's try at a trial; ``fence`` numbers the attempts of a trial from 1."""

    fence: int
    robot: str
    state: AttemptState
    reason: str | None = None
    departure: str | None = None  # why this robot was not the first of the trial's drawn order
    started_at: str
    ended_at: str | None = None
    log_sha256: str | None = None


class Trial(Schema):
    """A trial as the API shows it. ``has_truth`` says that operators can fetch what only the simulation knows of it."""

    trial_id: str
    job_id: str
    ordinal: int
    state: TrialState
    waiting_because: str | None
    task: str
    seed: int
    robot: str | None
    robot_order: tuple[str, ...]
    outcome: Outcome | None
    log_sha256: str | None
    log_bytes: int | None
    attempts: tuple[Attempt, ...]
    excitation: ExcitationName | None = None  # of an identification's trial
    has_truth: bool = False
    own_goal: OwnGoal | None = None  # that the job's user brought


class TrialPage(Schema):
    """All or one page of a job's trials, in their order."""

    trials: tuple[Trial, ...]
    next_cursor: str | None = None


class Verification(Schema):
    """Answer of POST /v1/jobs/{job}/trials/{ordinal}/verify.

    ``first_difference_step`` is the first millisecond whose numbers differ, null when none does. How large differences are
    is for operators only: with it, made-up logs would measure the hidden robot. ``form`` is the scene's form that the log is of,
    ``simulated_form`` the one that it was simulated with; where they differ, so may the numbers of a true log.
    """

    trial_id: str
    steps: int
    same: bool
    first_difference_step: int | None
    largest_joint_difference_rad: float | None = None
    largest_cube_difference_m: float | None = None
    form: str | None = None
    simulated_form: str | None = None

    @property
    def is_of_other_form(self) -> bool:
        """Whether the log is of another form of the scene than what it was compared with."""
        return self.simulated_form is not None and self.form != self.simulated_form

    def in_words(self, name: str) -> str:
        """The verdict on a log of this name in a sentence or two."""
        if self.same:
            return f"{name}: same numbers in all {self.steps} steps"
        joints, cube = self.largest_joint_difference_rad, self.largest_cube_difference_m
        differs = f"differs from step {self.first_difference_step} on"
        if joints is not None and cube is not None:
            differs += f" (by up to {joints:.3g} rad at the joints, {cube:.3g} m at the cube)"
        if not self.is_of_other_form:
            return f"{name}: {differs}"
        apart = f"is of form {form_or_first(self.form)} of the scene, and this version simulates form {self.simulated_form}"
        return f"{name}: {apart}; it {differs}, which says nothing against the log"


class ViewerLink(Schema):
    """Answer of POST /v1/trials/{trial_id}/link: whoever has ``url`` can read this one log until ``expires_at``."""

    trial_id: str
    url: str
    expires_at: str
    lasts_s: int = Field(description="from when it was made")
