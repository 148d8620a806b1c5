"""Of several dispatchers on one database one leads: it hears the robots and gives leases, the others stand by.

A leader's own lease, kept in a row and renewed, by the clock of the database. No lease depends on it: each is
written by a guarded statement, so that two who believe that they lead cost time and do no harm.
"""

import asyncio
import time
import uuid
from dataclasses import dataclass, field
from math import inf

from prometheus_client import Gauge
from sqlalchemy import Float, bindparam, cast, or_, update
from sqlalchemy.dialects.postgresql import insert

from services.database.database import Database
from services.database.postgres import server_clock_s
from services.database.tables import leader

LEADS_S = 3.0
"""A leader that has said nothing for so long leads no more."""
ASKS_EVERY_S = 0.5
OF_NO_USE_S = 10.0
"""Who leads and sees no robot in service for so long, or gets nothing done, lets others try."""
STANDS_BACK_S = 2.0
ROLE = "dispatcher"

_NOW_S = cast(server_clock_s(), Float(53))
_LONG = bindparam("leads_s", type_=Float)
_HAS = insert(leader).values(role=ROLE, holder=bindparam("by"), until_s=_NOW_S + _LONG)
_TAKE = _HAS.on_conflict_do_update(
    index_elements=[leader.c.role],
    set_={"holder": _HAS.excluded.holder, "until_s": _HAS.excluded.until_s},
    # A time too far ahead was written before the database's clock went back.
    where=or_(leader.c.holder == _HAS.excluded.holder, leader.c.until_s < _NOW_S, leader.c.until_s > _NOW_S + 2 * _LONG),
)
_LET_GO = update(leader).where(leader.c.role == ROLE, leader.c.holder == bindparam("by")).values(holder=None, until_s=0.0)


@dataclass
class Leadership:
    """Whether this process leads; alone on its database, as with SQLite, it always does. ``shown`` tells it to metrics."""

    database: Database
    shown: Gauge
    _name: str = field(default_factory=lambda: uuid.uuid4().hex)
    _leads_until_s: float = -inf
    _asks_from_s: float = -inf
    _of_use_s: float = -inf

    def __post_init__(self) -> None:
        self._leads_until_s = -inf if self.database.is_shared else inf
        self.shown.set_function(lambda: self.leads)

    @property
    def leads(self) -> bool:
        """Whether it leads now: a process that was stopped for a while knows of itself that its time is over."""
        return time.monotonic() < self._leads_until_s

    async def look(self, *, is_of_use: bool) -> None:
        """Takes the lead if nobody has it, or keeps it; to be asked every ``ASKS_EVERY_S`` where many may lead.

        Args:
            is_of_use: whether this process sees a robot in service, and could give it a lease.

        Raises:
            DBAPIError, Unavailable, TimeoutError: the database is away; then this process leads until its time is over.
        """
        now_s = time.monotonic()
        if is_of_use or not self.leads:
            self._of_use_s = now_s
        if now_s - self._of_use_s > OF_NO_USE_S:
            await self.let_go()
            self._asks_from_s = now_s + STANDS_BACK_S
        elif now_s >= self._asks_from_s:
            async with asyncio.timeout(LEADS_S), self.database.single() as connection:
                took = (await connection.execute(_TAKE, {"by": self._name, "leads_s": LEADS_S})).rowcount == 1
            self._leads_until_s = now_s + LEADS_S if took else -inf

    async def let_go(self) -> None:
        """Lets another lead at once."""
        if self.leads and self.database.is_shared:
            self._leads_until_s = -inf
            async with asyncio.timeout(LEADS_S), self.database.single() as connection:
                await connection.execute(_LET_GO, {"by": self._name})
