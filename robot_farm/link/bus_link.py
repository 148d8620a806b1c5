"""A robot's connection to the bus: presence, heartbeats, live state, offers and commands. Never the source of truth."""

import os
import queue
import socket
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any

import zenoh
from pydantic import ValidationError

from api_schemas import bus
from api_schemas.jail_report import JailReport
from api_schemas.robot import Lease, OfferReply, RobotHealth, RobotState
from api_schemas.scene_form import FIRST_FORM
from robot_farm.link.bus_access import Access
from robot_farm.link.outage import Standing

LIVE_EVERY_S = 0.1
CLOSE_WITHIN_S = 3.0


@dataclass(frozen=True)
class Accepted:
    """A lease and when it was accepted, on the robot's monotonic clock."""

    lease: Lease
    at_s: float


@dataclass(frozen=True)
class _Open:
    """A session and what was declared on it."""

    session: zenoh.Session
    heartbeats: zenoh.Publisher
    lives: zenoh.Publisher
    declared: tuple[Any, ...]


class BusLink:
    """Presence of one robot on the bus; a context manager. Owner of the robot's state as others see it.

    Args:
        access: where the bus is, the farm's name on it, and what a guarded one is shown.
        robot: name of the robot.
        physics: name of its physics, as told to the dispatcher.
        physics_digest: of what the name stands for, and of the farm's secret; "" where all robots are ideal.
        form: of the scene that the robot is simulated in.
        live: gives the live state, or None when nothing runs; called ten times a second while a trial runs.
        on_cancel: called with trial id and fence when a trial shall stop.
        stopping: whether the robot is about to end and takes no more offers.
        jail: what its policies are put into.
        health: how the robot is; asked for each heartbeat.
        standing: how it stands with the API; asked for each heartbeat and offer.
        alive_file: touched with each heartbeat, for the health check of a container.
        sees: whether it has cameras for policies that see.
    """

    def __init__(
        self,
        access: Access,
        robot: str,
        physics: str,
        *,
        physics_digest: str = "",
        form: str = FIRST_FORM,
        live: Callable[[], bus.LiveState | None],
        on_cancel: Callable[[str, int], None],
        stopping: Callable[[], bool],
        jail: JailReport | None = None,
        health: Callable[[], RobotHealth | None] = lambda: None,
        standing: Callable[[], Standing] = Standing,
        alive_file: Path | None = None,
        sees: bool = False,
    ) -> None:
        self._access, self._robot, self._physics = access, robot, physics
        self._physics_digest = physics_digest
        self._form = form
        self._jail, self._health, self._alive_file, self._sees = jail, health, alive_file, sees
        self._live, self._on_cancel, self._stopping = live, on_cancel, stopping
        self._standing = standing
        self._instance, self._version = uuid.uuid4().hex, version("trifarm")  # which reads files
        self._lock, self._sending = threading.Lock(), threading.Lock()
        self._state = RobotState.IDLE
        self._lease: Lease | None = None
        self._draining, self._leaving = False, False
        self._wrong: str | None = None
        self._resume_asked = threading.Event()
        self._offers: queue.SimpleQueue[Accepted | None] = queue.SimpleQueue()
        self._running, self._closing = threading.Event(), threading.Event()

    def __enter__(self) -> "BusLink":
        with self._sending:  # a command may be answered, with a heartbeat, before this line is over
            self._open = self._opened(self._access)
        self._threads = [
            threading.Thread(target=self._beat, name="heartbeat", daemon=True),
            threading.Thread(target=self._show, name="live-state", daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._closing.set()
        self._running.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        _close(self._open.session)

    def renew(self, access: Access) -> None:
        """Goes over to a session with a new certificate; the old one ends when the new one stands: nobody misses the robot.

        Raises:
            zenoh.ZError: the bus cannot be reached; the old session stays.
        """
        new = self._opened(access)
        with self._sending:
            old, self._open, self._access = self._open, new, access
        self._send_heartbeat()
        _close(old.session)

    def _opened(self, access: Access) -> "_Open":
        farm, robot = access.farm, self._robot
        session = zenoh.open(zenoh.Config.from_json5(access.session_config()))
        declared = (
            session.declare_queryable(bus.offer_key(farm, robot), self._answer_offer),
            session.declare_queryable(bus.command_key(farm, robot), self._answer_command),
            session.liveliness().declare_token(bus.alive_key(farm, robot)),
        )
        heartbeats = session.declare_publisher(bus.heartbeat_key(farm, robot))
        return _Open(session, heartbeats, session.declare_publisher(bus.live_key(farm, robot)), declared)

    def next_lease(self, timeout_s: float) -> Accepted | None:
        """The lease that was accepted, or None if none came in time, or something else wants to be looked at."""
        try:
            return self._offers.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def wake(self) -> None:
        """End a wait for the next lease."""
        self._offers.put(None)

    def running(self) -> None:
        """The accepted lease's trial has begun."""
        self._running.set()
        self._become(RobotState.RUNNING)

    def finishing(self) -> None:
        """The outcome is about to be reported; from its acceptance on the next offer may come at any moment."""
        with self._lock:
            self._lease = None
            self._state = self._idle_state()
        self._send_heartbeat()

    def free(self, lease: Lease) -> None:
        """A lease is over, however it ended; the next one may have been accepted already."""
        self._running.clear()
        with self._lock:
            if self._lease is None or self._lease is lease:
                self._lease, self._state = None, self._idle_state()
        self._send_heartbeat()

    def out_of_service(self, reason: str | None) -> None:
        """The robot is unfit, for this reason, and takes no offers until further notice; None: it is fit again."""
        with self._lock:
            self._wrong = reason
            if self._lease is None:
                self._state = self._idle_state()
        self._send_heartbeat()

    def leave(self) -> None:
        """Say that the robot goes when what it has in hand is done; from now on it declines all offers."""
        with self._lock:
            self._leaving = True
            if self._lease is None:
                self._state = self._idle_state()
        self._send_heartbeat()

    def accepted_already(self) -> Accepted | None:
        """A lease that was accepted before the robot began to leave, if there is one."""
        while True:
            try:
                if (accepted := self._offers.get_nowait()) is not None:
                    return accepted
            except queue.Empty:
                return None

    def resume_asked(self) -> bool:
        """Whether an operator wants a robot that is out of service back; asks once for each such wish."""
        if not self._resume_asked.is_set():
            return False  # and is not cleared: a wish may come at this very moment
        self._resume_asked.clear()
        return True

    def _idle_state(self) -> RobotState:
        if self._wrong is not None:
            return RobotState.OUT_OF_SERVICE
        return RobotState.DRAINING if self._draining or self._leaving else RobotState.IDLE

    def _become(self, state: RobotState) -> None:
        with self._lock:
            self._state = state
        self._send_heartbeat()

    def _answer_offer(self, query: zenoh.Query) -> None:
        """Accept an offer if the robot is idle; the reply is the acceptance."""
        try:
            lease = Lease.model_validate_json(query.payload.to_bytes() if query.payload else b"")
        except ValidationError as error:
            reply = OfferReply(accepted=False, reason=f"the offer is not a lease: {error.error_count()} errors")
        else:
            reply = self._accept(lease)
        query.reply(bus.offer_key(self._access.farm, self._robot), reply.model_dump_json())

    def _accept(self, lease: Lease) -> OfferReply:
        with self._lock:
            if self._lease is not None:
                if (self._lease.trial_id, self._lease.fence) == (lease.trial_id, lease.fence):
                    return OfferReply(accepted=True)  # the same offer again: its first answer was lost
                return OfferReply(accepted=False, reason=f"busy with trial {self._lease.trial_id}")
            if self._wrong is not None:
                return OfferReply(accepted=False, reason=f"out of service: {self._wrong}")
            if not (standing := self._standing()).takes_offers:
                return OfferReply(accepted=False, reason=f"out of service: {standing.reason}")
            if self._draining or self._stopping():
                return OfferReply(accepted=False, reason="draining" if self._draining else "about to end")
            self._lease, self._state = lease, RobotState.LEASED
        self._offers.put(Accepted(lease, time.monotonic()))
        return OfferReply(accepted=True)

    def _answer_command(self, query: zenoh.Query) -> None:
        try:
            command = bus.Command.model_validate_json(query.payload.to_bytes() if query.payload else b"")
        except ValidationError as error:
            reply = OfferReply(accepted=False, reason=f"not a command: {error.error_count()} errors")
        else:
            reply = self._obey(command)
        query.reply(bus.command_key(self._access.farm, self._robot), reply.model_dump_json())
        self._send_heartbeat()

    def _obey(self, command: bus.Command) -> OfferReply:
        with self._lock:
            lease = self._lease
            if command.kind is not bus.CommandKind.CANCEL and self._leaving:
                return OfferReply(accepted=False, reason="about to end")
            if command.kind is not bus.CommandKind.CANCEL:
                self._draining = command.kind is bus.CommandKind.DRAIN
                if self._wrong is not None and not self._draining:
                    self._resume_asked.set()
                    self.wake()
                if lease is None:
                    self._state = self._idle_state()
                return OfferReply(accepted=True)
        if lease is None or (lease.trial_id, lease.fence) != (command.trial_id, command.fence):
            return OfferReply(accepted=False, reason=f"not running trial {command.trial_id}, attempt {command.fence}")
        self._on_cancel(lease.trial_id, lease.fence)
        return OfferReply(accepted=True)

    def _send_heartbeat(self) -> None:
        health, standing = self._health(), self._standing()
        cut_off_trial_id, cut_off_fence = standing.cut_off or (None, None)
        with self._lock:
            beat = bus.Heartbeat(
                robot=self._robot,
                instance=self._instance,
                pid=os.getpid(),
                host=socket.gethostname(),
                state=self._state if standing.takes_offers else RobotState.OUT_OF_SERVICE,
                trial_id=self._lease.trial_id if self._lease else None,
                fence=self._lease.fence if self._lease else None,
                cut_off_trial_id=cut_off_trial_id,
                cut_off_fence=cut_off_fence,
                api_away=standing.api_away and self._wrong is None,
                disk_full=standing.disk_full and self._wrong is None,
                leaving=self._leaving,
                reason=self._wrong or standing.reason,
                physics=self._physics,
                physics_digest=self._physics_digest,
                form=self._form,
                version=self._version,
                sees=self._sees,
                jail=self._jail,
                health=health,
            )
        with self._sending:
            self._open.heartbeats.put(beat.model_dump_json())
        if self._alive_file is not None:
            with suppress(OSError):  # whoever looks at it finds it old
                self._alive_file.touch()

    def _beat(self) -> None:
        self._send_heartbeat()
        while not self._closing.wait(bus.HEARTBEAT_EVERY_S * (bus.IDLE_HEARTBEATS_APART if self._lease is None else 1.0)):
            self._send_heartbeat()

    def _show(self) -> None:
        while not self._closing.wait(LIVE_EVERY_S):
            self._running.wait()  # an idle robot costs its host next to nothing
            with suppress(ValidationError):  # a number that is not finite; the next may be
                state = self._live()
                if state is not None:
                    with self._sending:
                        self._open.lives.put(state.model_dump_json())


def _close(session: zenoh.Session) -> None:
    closer = threading.Thread(target=session.close, daemon=True)  # may block when the network is gone
    closer.start()
    closer.join(timeout=CLOSE_WITHIN_S)
