"""The bus of the farm: a router here or a session to one elsewhere, what it hears from robots and what it asks them."""

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import structlog
import zenoh
from pydantic import BaseModel, ValidationError

from api_schemas import bus
from api_schemas.robot import Lease, OfferReply
from services.errors import NotReady
from services.jobs.signals import Signals

log = structlog.get_logger()
CLOSE_WITHIN_S = 2.0
ROUTER_WITHIN_S, ROUTER_AGAIN_S = 10.0, 0.5
HEARD_EVERY_S, AT_ONCE, MOST_WAITING = 0.05, 200, 20_000
"""How often messages are taken in, how many of a kind before others of the loop come, and how many wait at most."""


class Bus:
    """One session; what robots say is taken in on the event loop, and other callbacks of zenoh's threads hop onto it."""

    def __init__(self, session: zenoh.Session, farm: str, loop: asyncio.AbstractEventLoop) -> None:
        self._session = session
        self._farm = farm
        self._loop = loop
        self._declared: list[Any] = []
        self._heard: list[Any] = []
        self._looks: list[Callable[[], bool]] = []
        self._listening: asyncio.Task[None] | None = None

    @classmethod
    async def open(cls, config: str, farm: str) -> "Bus":
        """Opens a session as ``services/joining/session.py`` describes it.

        A router elsewhere that is not there yet is waited for a moment: all are started at the same time.

        Raises:
            NotReady: the address cannot be listened on, or nobody answers there.
        """
        gives_up_s, waits = time.monotonic() + ROUTER_WITHIN_S, '"mode": "client"' in config
        while True:
            try:
                session = await asyncio.to_thread(zenoh.open, zenoh.Config.from_json5(config))
            except zenoh.ZError as error:
                if not waits:
                    raise NotReady(f"the bus cannot listen: {_said(error)}; see --bus, TRIFARM_BUS") from error
                if time.monotonic() > gives_up_s:
                    hint = "start 'python -m services router' there first; a guarded one must have keys of the same farm"
                    raise NotReady(f"nobody answered on the bus within {ROUTER_WITHIN_S:g} s ({_said(error)}); {hint}") from error
                await asyncio.sleep(ROUTER_AGAIN_S)
            else:
                return cls(session, farm, asyncio.get_running_loop())

    def on_heartbeat(self, take: Callable[[bus.Heartbeat], None]) -> None:
        """Has every well-formed heartbeat given to ``take``, on the event loop."""
        self._hear(bus.heartbeat_key(self._farm, "*"), bus.Heartbeat, take)

    def on_live_state(self, take: Callable[[bus.LiveState], None]) -> None:
        """Has every well-formed live state given to ``take``, on the event loop."""
        self._hear(bus.live_key(self._farm, "*"), bus.LiveState, take)

    def on_presence(self, take: Callable[[str, bool], None]) -> None:
        """Has each coming (true) and going (false) of a robot's token given to ``take``, on the event loop."""

        def hop(sample: zenoh.Sample) -> None:
            present = sample.kind == zenoh.SampleKind.PUT
            self._hop(take, bus.robot_of_key(str(sample.key_expr)), present)

        key = bus.alive_key(self._farm, "*")
        self._heard.append(self._session.liveliness().declare_subscriber(key, hop, history=True))

    def hear_no_more(self) -> None:
        """Ends what ``on_...`` began; it may begin again."""
        ended, self._heard, self._looks = self._heard, [], []
        for each in ended:
            each.undeclare()

    def share_changes(self, signals: Signals) -> None:
        """Tells other processes of the services what changes here, and has what changes there looked at."""
        key = bus.change_key(self._farm)
        publisher = self._session.declare_publisher(key, express=True, allowed_destination=zenoh.Locality.REMOTE)

        def tell(job_id: str | None) -> None:
            publisher.put(bus.Change(job_id=job_id).model_dump_json())

        def hop(sample: zenoh.Sample) -> None:
            try:
                job_id = bus.Change.model_validate_json(sample.payload.to_bytes()).job_id
            except ValueError as error:
                self._hop(log.warning, "message on the bus ignored", key=key, reason=str(error))
            else:
                self._hop(signals.changed_elsewhere, job_id)

        self._declared += [publisher, self._session.declare_subscriber(key, hop, allowed_origin=zenoh.Locality.REMOTE)]
        signals.tell_others = tell

    async def offer(self, lease: Lease, timeout_s: float) -> OfferReply | None:
        """Offers a lease to its robot; None when no answer came in time."""
        return await self._ask(bus.offer_key(self._farm, lease.robot), lease, timeout_s)

    async def command(self, robot: str, command: bus.Command, timeout_s: float) -> OfferReply | None:
        """Gives a robot a command; None when no answer came in time."""
        return await self._ask(bus.command_key(self._farm, robot), command, timeout_s)

    async def close(self) -> None:
        """Closes the session, at most ``CLOSE_WITHIN_S``: zenoh's own close can block for longer."""
        if self._listening is not None:
            self._listening.cancel()
        closing = threading.Thread(target=self._close, daemon=True)
        closing.start()
        await asyncio.to_thread(closing.join, CLOSE_WITHIN_S)

    def _close(self) -> None:
        for each in (*self._declared, *self._heard):
            each.undeclare()
        self._session.close()

    def _hear(self, key: str, schema: type[Any], take: Callable[[Any], None]) -> None:
        """Has messages wait where zenoh keeps them, until the loop comes for them.

        A callback for each would have zenoh's threads wait for Python's lock, and the loop wake up, a thousand times a second.
        """
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(MOST_WAITING))
        self._heard.append(subscriber)

        def look() -> bool:
            for _ in range(AT_ONCE):
                if (sample := subscriber.try_recv()) is None:
                    return False
                _give(sample, schema, take)
            return True

        self._looks.append(look)
        if self._listening is None:
            self._listening = self._loop.create_task(self._listen())

    async def _listen(self) -> None:
        while True:
            more = [look() for look in self._looks]
            await asyncio.sleep(0.0 if any(more) else HEARD_EVERY_S)

    async def _ask(self, key: str, message: BaseModel, timeout_s: float) -> OfferReply | None:
        answer: asyncio.Future[bytes | None] = self._loop.create_future()

        def settle(payload: bytes | None) -> None:
            if not answer.done():
                answer.set_result(payload)

        def replied(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._hop(settle, reply.ok.payload.to_bytes())

        # zenoh drops the handler once all replies are in or the time is over; that is the answer "nobody".
        handler = zenoh.handlers.Callback(replied, lambda: self._hop(settle, None))
        self._session.get(key, handler, payload=message.model_dump_json(), timeout=timeout_s)
        payload = await answer
        try:
            return None if payload is None else OfferReply.model_validate_json(payload)
        except ValidationError as error:
            return OfferReply(accepted=False, reason=f"its answer could not be read: {error}")

    def _hop(self, call: Callable[..., Any], *args: Any, **more: Any) -> None:
        # After the loop's end a late callback has nobody to tell.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(lambda: call(*args, **more))


def _give(sample: zenoh.Sample, schema: type[Any], take: Callable[[Any], None]) -> None:
    """A well-formed message, of the robot whose key it came on, is taken; others leave a line in the log."""
    key = str(sample.key_expr)
    try:
        message = schema.model_validate_json(sample.payload.to_bytes())
        if message.robot != (named := bus.robot_of_key(key)):
            raise ValueError(f"robot {message.robot!r} spoke on the key of {named!r}")
    except ValueError as error:
        log.warning("message on the bus ignored", key=key, reason=str(error))
        return
    try:
        take(message)
    except Exception:  # the next message must be heard
        log.exception("message on the bus not taken", key=key)


def _said(error: zenoh.ZError) -> str:
    """Zenoh's own words, without the place in its source."""
    return str(error).partition(" at /")[0].strip()
