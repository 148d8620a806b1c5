"""A session ends everywhere or nowhere."""

from types import SimpleNamespace

import pytest
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from api_schemas.token import Scope
from services.dashboard.sessions import Seal, Session
from services.dashboard.sign_in import sign_out
from services.jobs.clock import FarmClock
from services.sharing import all_signed_out
from services.tokens import Caller


async def test_whoever_could_not_be_signed_out_can_try_again(new_database):
    seal = Seal(b"k" * 32)
    cookie = seal.close("trifarm_a_b")
    session = Session(Caller("t", "ann", frozenset({Scope.SUBMIT})), seal.word(cookie), "trifarm_a_b", cookie, seal)
    farm = SimpleNamespace(database=new_database, clock=FarmClock.start())

    async def rename(old, new):
        async with new_database.write() as tx:
            await tx.execute(text(f"ALTER TABLE {old} RENAME TO {new}"))

    await rename("signed_out", "away")
    with pytest.raises(DBAPIError):
        await sign_out(session, farm)
    assert session.lasts
    await rename("away", "signed_out")
    await sign_out(session, farm)
    assert not session.lasts
    async with new_database.read() as connection:
        assert await all_signed_out(connection, 0.0) == [session.mark]
