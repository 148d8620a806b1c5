import pytest
from sqlalchemy import select

from api_schemas.token import Scope, TokenRequest
from services.database.database import Database
from services.database.pages import Asked
from services.database.tables import token
from services.errors import Refused, Unauthorised
from services.jobs.clock import FarmClock
from services.tokens import Tokens, sha256

ADMIN = TokenRequest(owner="operator", scopes=(Scope.ADMIN,))
ROBOT = TokenRequest(owner="farm", scopes=(Scope.ROBOT,))
OLD, NEW = "trifarm_admin_oldsecret", "trifarm_admin_newsecret"


@pytest.fixture
async def tokens(sqlite_url):
    database = Database(sqlite_url)
    yield Tokens(database, FarmClock.start())
    await database.close()


async def test_a_given_token_replaces_the_secret_of_its_id(tokens, capsys):
    await tokens.register(OLD, ADMIN)
    assert (await tokens.caller(OLD)).owner == "operator"
    await tokens.register(NEW, ADMIN)
    assert (await tokens.caller(NEW)).scopes == {Scope.ADMIN}
    with pytest.raises(Unauthorised):
        await tokens.caller(OLD)
    assert len((await tokens.page(Asked(10))).entries) == 1
    said = capsys.readouterr()
    assert "stored token replaced" in said.out + said.err
    assert "secret_sha256" in said.out + said.err
    for secret in ("newsecret", "oldsecret", sha256(NEW), sha256(OLD)):
        assert secret not in said.out + said.err


async def test_who_only_reads_is_answered_though_nothing_can_be_written(tokens):
    """As on a full disk: when a token was last used is not worth a refusal."""
    await tokens.register(OLD, ADMIN)
    async with tokens.database.write() as tx:
        full = "CREATE TRIGGER full BEFORE UPDATE ON token BEGIN SELECT RAISE(ABORT, 'database or disk is full'); END"
        await tx.exec_driver_sql(full)
    assert (await tokens.caller(OLD)).owner == "operator"


async def test_a_given_token_replaces_scopes_and_owner(tokens):
    await tokens.register(OLD, ROBOT)
    await tokens.register(OLD, ADMIN)
    caller = await tokens.caller(OLD)
    assert (caller.scopes, caller.owner) == ({Scope.ADMIN}, "operator")


async def test_a_given_token_is_valid_again_though_it_was_revoked(tokens):
    await tokens.register(OLD, ADMIN)
    await tokens.revoke("admin")
    await tokens.register(OLD, ADMIN)
    assert (await tokens.caller(OLD)).token_id == "admin"


async def test_the_same_token_again_changes_nothing(tokens, capsys):
    await tokens.register(OLD, ADMIN)
    async with tokens.database.read() as connection:
        before = (await connection.execute(select(token))).all()
    await tokens.register(OLD, ADMIN)
    async with tokens.database.read() as connection:
        assert (await connection.execute(select(token))).all() == before
    assert "replaced" not in "".join(capsys.readouterr())


async def test_what_is_no_token_is_refused(tokens):
    with pytest.raises(Refused, match="trifarm_<id>_<secret>"):
        await tokens.register("trifarm_admin", ADMIN)


async def test_what_was_read_before_a_token_was_revoked_is_not_remembered_after_it(tokens, monkeypatch):
    await tokens.register(OLD, ADMIN)
    revoked = []

    async def meanwhile(token_id, _now_s):
        if not revoked:
            revoked.append(token_id)
            await tokens.revoke(token_id)

    monkeypatch.setattr(tokens, "_used", meanwhile)
    assert (await tokens.caller(OLD)).owner == "operator", "it was good when it was looked at"
    assert revoked == ["admin"]
    with pytest.raises(Unauthorised):
        await tokens.caller(OLD)
