"""The robot's side of the policy process: starts it, asks it under a deadline, ends it.

The deadline counts the process's own CPU time, so that a noisy machine never makes a policy fail: one second of CPU for an
action is the policy's fault, ten seconds of wall time without that CPU time are the platform's.
"""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

import numpy as np

from api_schemas import policy_link
from api_schemas.policy import ACTION_SIZE
from api_schemas.trial import OutcomeKind

ACTION_CPU_S = 1.0
ACTION_WALL_S = 10.0
START_CPU_S = 20.0
START_WALL_S = 60.0
_POLL_S = 0.05


class PolicyFailedError(Exception):
    """The policy process did not answer as it must; ``kind`` says how (a fault of the policy or of the platform)."""

    def __init__(self, kind: OutcomeKind, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind


class JailedPolicy:
    """One policy in its own process. Kept for consecutive trials of the same policy; state is reset between them."""

    def __init__(self, digest: str, graph: Path) -> None:
        self.digest = digest
        to_child, self._write_fd = os.pipe()
        self._read_fd, from_child = os.pipe()
        os.set_inheritable(to_child, True)
        os.set_inheritable(from_child, True)
        arguments = (str(graph), str(to_child), str(from_child), str(os.getpid()))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "robot_farm.jailed_policy", *arguments],
            pass_fds=(to_child, from_child),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=_environment(),
            cwd="/",
            start_new_session=True,
        )
        os.close(to_child)
        os.close(from_child)
        self._poll = select.poll()
        self._poll.register(self._read_fd, select.POLLIN)
        self._ready = False

    def __enter__(self) -> "JailedPolicy":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Process id of the policy process."""
        return self._process.pid

    def reset(self) -> None:
        """Forget the last trial; waits until the network is loaded when it is the first.

        Raises:
            PolicyFailedError: the process ended, failed to load or missed its deadline.
        """
        if not self._ready:
            self._wait(START_CPU_S, START_WALL_S, "loading the network")
            status, payload, _ = self._reply()
            if status == policy_link.BROKEN:
                raise PolicyFailedError(OutcomeKind.PLATFORM_ERROR, f"the robot has no working runtime: {_text(payload)}")
            if status != policy_link.READY:
                raise PolicyFailedError(OutcomeKind.POLICY_ERROR, f"the network could not be loaded: {_text(payload)}")
            self._ready = True
        self._ask(policy_link.pack_request(policy_link.RESET))

    def act(self, observation: np.ndarray) -> tuple[np.ndarray, int]:
        """Ask for one action.

        Args:
            observation: float32 vector.

        Returns:
            The action, shape (9,), float64, and the inference time in ns.

        Raises:
            PolicyFailedError: as for :meth:`reset`, or the action is not finite or has another size.
        """
        payload, inference_time_ns = self._ask(policy_link.pack_request(policy_link.ACT, observation))
        action = np.frombuffer(payload, np.float32).astype(np.float64)
        if action.shape != (ACTION_SIZE,):
            raise PolicyFailedError(OutcomeKind.POLICY_ERROR, f"the action has {action.size} numbers instead of {ACTION_SIZE}")
        if not np.isfinite(action).all():
            raise PolicyFailedError(OutcomeKind.NONFINITE_ACTION, f"the action is not finite: {action.tolist()}")
        return action, inference_time_ns

    def close(self) -> None:
        """End the process and everything it started."""
        if self._process.poll() is None:
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                self._process.kill()
        self._process.wait()
        for fd in (self._write_fd, self._read_fd):
            try:
                os.close(fd)
            except OSError:
                continue  # closed before

    def _ask(self, request: bytes) -> tuple[bytes, int]:
        try:
            os.write(self._write_fd, request)
        except BrokenPipeError:
            raise self._ended() from None
        self._wait(ACTION_CPU_S, ACTION_WALL_S, "one action")
        status, payload, inference_time_ns = self._reply()
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
            if cpu_s > cpu_limit_s:
                raise PolicyFailedError(
                    OutcomeKind.ACTION_DEADLINE, f"{what} took more than {cpu_limit_s:g} s of the policy's CPU time"
                )
            if time.monotonic() - started_s > wall_limit_s:
                raise PolicyFailedError(
                    OutcomeKind.PLATFORM_ERROR,
                    f"{what} took {wall_limit_s:g} s of wall time but only {cpu_s:.2f} s of CPU time",
                )

    def _cpu_s(self) -> float:
        """CPU time of the process; a process that has ended reads as an ended one."""
        try:
            return time.clock_gettime(~self._process.pid << 3 | 2)  # the kernel's clock of another process
        except OSError:
            raise self._ended() from None

    def _reply(self) -> tuple[int, bytes, int]:
        try:
            return policy_link.read_reply(self._read_fd)
        except policy_link.LinkClosedError:
            raise self._ended() from None

    def _ended(self) -> PolicyFailedError:
        try:
            code = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return PolicyFailedError(OutcomeKind.POLICY_PROCESS_ENDED, "the policy process closed its connection")
        how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        return PolicyFailedError(OutcomeKind.POLICY_PROCESS_ENDED, f"the policy process ended ({how})")


def _environment() -> dict[str, str]:
    """Nothing of the robot's environment but where libraries are; above all no token."""
    kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ}
    return kept | {"PYTHONPATH": str(Path(__file__).parent.parent), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}


def _text(payload: bytes) -> str:
    return payload.decode(errors="replace")
