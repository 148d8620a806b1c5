"""The robot's side of the policy process: starts it, asks it under a deadline, ends it.

The deadline counts the process's own CPU time, so that a noisy machine never makes a policy fail: one second of CPU for an
action is the policy's fault, ten seconds of wall time without that CPU time are the platform's. All actions of a trial
together have a limit, too; it is looked at when an action is slow and otherwise only now and then, so that it costs nothing.

What the process sends is a stranger's: the robot's ends of both pipes never block, because each request and each reply is short
enough to go through a pipe whole, and every number of a reply is looked at before it is used.
"""

import math
import os
import select
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

import numpy as np

from api_schemas import policy_link
from api_schemas.policy import ACTION_SIZE
from api_schemas.policy_images import PolicyImages
from api_schemas.trial import OutcomeKind
from jail.environment import jail_environment
from jail.level import Jail, JailLevel, Layer, too_open
from robot_farm.policy.shown_images import ShownImages

ACTION_CPU_S = 1.0
ACTION_WALL_S = 10.0
TRIAL_CPU_S = 120.0
_LOOK_EVERY_ACTIONS = 100
START_CPU_S = 20.0
START_WALL_S = 60.0
_POLL_S = 0.05
MOST_TRIALS, _MOST_REQUEST_BYTES = 16, 32 * 1024
"""Of trials that are under way together; their requests must go through a pipe whole."""
_NUMBERS = struct.Struct(f"<{ACTION_SIZE}f")
_ACTION_BYTES = _NUMBERS.size
_LONGEST_INFERENCE_NS = 86_400 * 10**9
"""A day: a machine may have slept in between, but what is longer than this is made up, and no log could hold it."""
POLICY_PROCESS, BUILTIN_PROCESS = "robot_farm.policy.jailed_policy", "robot_farm.policy.builtin_policy"


class PolicyFailedError(Exception):
    """The policy process did not answer as it must; ``kind`` says how (a fault of the policy or of the platform)."""

    def __init__(self, kind: OutcomeKind, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind


def most_trials(observation_size: int) -> int:
    """How many trials with observations of this size may be under way together in one process."""
    return max(1, min(MOST_TRIALS, _MOST_REQUEST_BYTES // (4 * observation_size)))


class JailedPolicy:
    """One policy in its own process. Kept for consecutive trials of the same policy; state is reset between them.

    Args:
        digest: of the policy.
        graph: the ONNX file.
        least: a policy whose jail does not reach this level is not loaded.
        module: what runs in the process: a network's, or a built-in policy's; others are for tests alone.
        images: what the policy sees, if it does.
    """

    def __init__(
        self,
        digest: str,
        graph: Path,
        *,
        least: JailLevel = JailLevel.NONE,
        module: str = POLICY_PROCESS,
        images: PolicyImages | None = None,
    ) -> None:
        self.digest, self._least = digest, least
        self._images = None if images is None else ShownImages(images)
        self.jail: Jail | None = None
        """How closed the process said it is, once it has."""
        to_child, self._write_fd = os.pipe()
        self._read_fd, from_child = os.pipe()
        os.set_inheritable(to_child, True)
        os.set_inheritable(from_child, True)
        arguments, passed = [str(graph), str(to_child), str(from_child), str(os.getpid())], [to_child, from_child]
        if self._images is not None:
            arguments += self._images.arguments
            passed.append(self._images.reading_fd)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", module, *arguments],
            pass_fds=passed,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=jail_environment(),
            cwd="/",
            start_new_session=True,
        )
        os.close(to_child)
        os.close(from_child)
        os.set_blocking(self._write_fd, False)
        os.set_blocking(self._read_fd, False)
        self._poll = select.poll()
        self._poll.register(self._read_fd, select.POLLIN)
        self._ready = False
        self._asked, self._trial_from_cpu_s, self._trials = 0, 0.0, 1

    def __enter__(self) -> "JailedPolicy":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Process id of the policy process."""
        return self._process.pid

    def reset(self, trials: int = 1) -> None:
        """Forget the last trial; waits until the network is loaded when it is the first.

        Args:
            trials: that begin, side by side (:meth:`act_each`); a robot has one at a time.

        Raises:
            PolicyFailedError: the process ended, failed to load, is not jailed enough or missed its deadline.
        """
        if not self._ready:
            self._start()
        self._trial_from_cpu_s, self._trials = self._cpu_s(), trials
        self._ask(policy_link.pack_request(policy_link.RESET, None if trials == 1 else np.array([trials], np.float32)))

    def _start(self) -> None:
        self._wait(START_CPU_S, START_WALL_S, "starting the policy process")
        status, payload, _ = self._reply()
        if status != policy_link.JAILED:
            raise PolicyFailedError(OutcomeKind.PLATFORM_ERROR, f"the robot has no working runtime: {_text(payload)}")
        self.jail = Jail.of([Layer(name) for name in _text(payload).split()])
        if (reason := too_open(self.jail, self._least)) is not None:
            raise PolicyFailedError(OutcomeKind.PLATFORM_ERROR, f"the policy is not run: {reason}")
        self._wait(START_CPU_S, START_WALL_S, "loading the network")
        status, payload, _ = self._reply()
        if status == policy_link.BROKEN:
            raise PolicyFailedError(OutcomeKind.PLATFORM_ERROR, f"the policy cannot be run here: {_text(payload)}")
        if status != policy_link.READY:
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, f"the network could not be loaded: {_text(payload)}")
        self._ready = True

    def show(self, images: np.ndarray) -> None:
        """What the policy sees from now on: images of its manifest's shape, uint8; only between two requests."""
        assert self._images is not None, "made for a policy that sees"
        self._images.show(images)

    def act(self, observation: np.ndarray) -> tuple[np.ndarray, int]:
        """Ask for one action.

        Args:
            observation: float32 vector.

        Returns:
            The action, shape (9,), float64, and the inference time in ns.

        Raises:
            PolicyFailedError: as for :meth:`reset`, or the action is not finite or has another size.
        """
        numbers, inference_time_ns = self._actions(observation, 1)
        return np.array(numbers), inference_time_ns

    def act_each(self, observation: np.ndarray) -> np.ndarray:
        """Ask for an action in each of the trials that are under way.

        Args:
            observation: float32, shape (trials, size).

        Returns:
            The actions, shape (trials, 9), float64.

        Raises:
            PolicyFailedError: as for :meth:`act`.
        """
        assert len(observation) == self._trials, "each trial that is under way has an observation"
        return np.array(self._actions(observation, self._trials)[0]).reshape(self._trials, ACTION_SIZE)

    def _actions(self, observation: np.ndarray, trials: int) -> tuple[tuple[float, ...], int]:
        request = policy_link.pack_request(policy_link.ACT, observation)
        payload, inference_time_ns = self._ask(request, expected_bytes=trials * _ACTION_BYTES)
        if len(payload) != trials * _ACTION_BYTES:
            raise PolicyFailedError(
                OutcomeKind.POLICY_ERROR, f"the action has {len(payload) / 4 / trials:g} numbers instead of {ACTION_SIZE}"
            )
        numbers = _NUMBERS.unpack(payload) if trials == 1 else struct.unpack(f"<{trials * ACTION_SIZE}f", payload)
        if not all(map(math.isfinite, numbers)):
            raise PolicyFailedError(OutcomeKind.NONFINITE_ACTION, f"the action is not finite: {list(numbers)}")
        return numbers, inference_time_ns

    def close(self) -> None:
        """End the process and everything it started."""
        if self._process.poll() is None:
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                self._process.kill()
        self._process.wait()
        if self._images is not None:
            self._images.close()
        for fd in (self._write_fd, self._read_fd):
            try:
                os.close(fd)
            except OSError:
                continue  # closed before

    def _ask(self, request: bytes, expected_bytes: int = 0) -> tuple[bytes, int]:
        self._asked += 1
        if self._asked % _LOOK_EVERY_ACTIONS == 0:
            self._check_trial(self._cpu_s())
        try:
            os.write(self._write_fd, request)
        except BrokenPipeError:
            raise self._ended() from None
        except BlockingIOError:
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, "the policy process answers before it reads the request") from None
        self._wait(self._trials * ACTION_CPU_S, self._trials * ACTION_WALL_S, "one action")
        status, payload, inference_time_ns = self._reply(expected_bytes)
        if status != policy_link.OK:
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, f"the network raised an error: {_text(payload)}")
        return payload, inference_time_ns

    def _wait(self, cpu_limit_s: float, wall_limit_s: float, what: str) -> None:
        """Wait for a reply; the process's CPU time is looked at only when it does not come at once."""
        if self._poll.poll(_POLL_S * 1000):
            return
        started_s, cpu_start_s = time.monotonic() - _POLL_S, self._cpu_s()
        while not self._poll.poll(_POLL_S * 1000):
            cpu_s = self._cpu_s() - cpu_start_s
            self._check_trial(cpu_start_s + cpu_s)
            if cpu_s > cpu_limit_s:
                raise PolicyFailedError(
                    OutcomeKind.ACTION_DEADLINE, f"{what} took more than {cpu_limit_s:g} s of the policy's CPU time"
                )
            if time.monotonic() - started_s > wall_limit_s:
                raise PolicyFailedError(
                    OutcomeKind.PLATFORM_ERROR,
                    f"{what} took {wall_limit_s:g} s of wall time but only {cpu_s:.2f} s of CPU time",
                )

    def _check_trial(self, cpu_s: float) -> None:
        if self._ready and cpu_s - self._trial_from_cpu_s > self._trials * TRIAL_CPU_S:
            reason = f"the actions of one trial took more than {TRIAL_CPU_S:g} s of the policy's CPU time"
            raise PolicyFailedError(OutcomeKind.ACTION_DEADLINE, reason)

    def _cpu_s(self) -> float:
        """CPU time of the process; a process that has ended reads as an ended one."""
        try:
            return time.clock_gettime(~self._process.pid << 3 | 2)  # the kernel's clock of another process
        except OSError:
            raise self._ended() from None

    def _reply(self, expected_bytes: int = 0) -> tuple[int, bytes, int]:
        try:
            status, payload, inference_time_ns = policy_link.read_reply(self._read_fd, expected_bytes)
        except policy_link.LinkClosedError:
            raise self._ended() from None
        except BlockingIOError:
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, "the policy process sent a partial reply") from None
        if inference_time_ns > _LONGEST_INFERENCE_NS:
            reason = f"the policy process reports that an action took {inference_time_ns / 1e9:g} s"
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, reason)
        return status, payload, inference_time_ns

    def _ended(self) -> PolicyFailedError:
        try:
            code = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return PolicyFailedError(OutcomeKind.POLICY_PROCESS_ENDED, "the policy process closed its connection")
        how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        return PolicyFailedError(OutcomeKind.POLICY_PROCESS_ENDED, f"the policy process ended ({how})")


def _text(payload: bytes) -> str:
    """What the process said, without what would steer a terminal that shows it."""
    return "".join(each if each.isprintable() else " " for each in payload.decode(errors="replace"))
