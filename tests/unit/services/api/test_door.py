"""A request that lasts is watched, and a database that is away for a moment does not end it."""

from types import SimpleNamespace

import pytest
from sqlalchemy.exc import OperationalError

from services.api.door import _Watch
from services.errors import Unavailable


@pytest.mark.parametrize("away", [Unavailable("database-unavailable", "away"), OperationalError("SELECT 1", None, OSError())])
async def test_a_token_that_cannot_be_looked_at_still_holds(away):
    async def still_holds(_caller):
        raise away

    scope = {"type": "http", "method": "GET", "headers": [], "state": {"caller": object()}}
    watch = _Watch(SimpleNamespace(still_holds=still_holds), scope, None, 30.0)
    assert await watch._holds()
