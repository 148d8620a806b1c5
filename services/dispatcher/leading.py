"""Of several dispatchers on one database one leads: it hears the robots and gives leases, the others stand by.

A leader's own lease, kept in a row and renewed, by the clock of the database. Nothing else depends on it: every lease of a trial
is written by a guarded statement, so that two who believe that they lead cost time and do no harm.
"""

import time
import uuid
from dataclasses import dataclass, field

from prometheus_client import Gauge
from sqlalchemy import Float, bindparam, cast, or_, update
from sqlalchemy.dialects.postgresql import insert

from services.database.database import Database
from services.database.postgres import server_clock_s
from services.database.tables import leader

LEADS_S = 3.0
"""A leader that has said nothing for so long leads no more."""
ASKS_EVERY_S = 0.5
SEES_NOBODY_S = 10.0
"""Who leads and sees no robot in service for so long lets others try, whose way to the bus may be better."""
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
    leads: bool = False
    _name: str = field(default_factory=lambda: uuid.uuid4().hex)
    _asks_from_s: float = 0.0
    _seen_s: float = 0.0

    def __post_init__(self) -> None:
        self.leads = not self.database.is_shared
        self.shown.set_function(lambda: self.leads)

    async def look(self, *, sees_robots: bool) -> None:
        """Takes the lead if nobody has it, or keeps it; to be asked every ``ASKS_EVERY_S`` where many may lead.

        Args:
            sees_robots: whether any robot is in service, as far as this process knows.

        Raises:
            DBAPIError, Unavailable: the database is away; then this process does not lead.
        """
        now_s = time.monotonic()
        if sees_robots or not self.leads:
            self._seen_s = now_s
        if now_s - self._seen_s > SEES_NOBODY_S:
            await self.let_go()
            self._asks_from_s = now_s + STANDS_BACK_S
        elif now_s >= self._asks_from_s:
            leads = False
            try:
                async with self.database.single() as connection:
                    leads = (await connection.execute(_TAKE, {"by": self._name, "leads_s": LEADS_S})).rowcount == 1
            finally:
                self.leads = leads

    async def let_go(self) -> None:
        """Lets another lead at once."""
        if self.leads and self.database.is_shared:
            self.leads = False
            async with self.database.single() as connection:
                await connection.execute(_LET_GO, {"by": self._name})
