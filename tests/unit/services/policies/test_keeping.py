"""On each home: what an upload is answered is what is kept, also where the same policy comes or goes at this moment."""

import asyncio

import pytest
from sqlalchemy import event, select

from api_schemas.policy import WeightsFormat, policy_digest
from services.database.tables import policy, policy_owner
from services.errors import Conflict
from services.files.store import FileStore
from services.policies import keeping
from services.policies.keeping import Policies, Upload
from services.settings import Settings
from tests.integration.farm_process import sha256, small_policy


@pytest.fixture
def policies(new_database, tmp_path):
    return Policies(Settings(conversion_at_once=2), new_database, FileStore(tmp_path / "files"))


@pytest.fixture
def upload_of(tmp_path):
    content, manifest = small_policy()
    weights = tmp_path / "weights.safetensors"
    weights.write_bytes(content)
    digest, form = policy_digest(sha256(content), manifest), WeightsFormat.SAFETENSORS
    return lambda owner: Upload(digest, weights, sha256(content), form, manifest, owner)


@pytest.fixture
def reads(new_database):
    """How often the whole row of a policy was read."""
    found = []

    def note(connection, cursor, statement, *_):
        if statement.lstrip().startswith("SELECT policy.number"):
            found.append(statement)

    for engine in (new_database._readers, new_database._writer):
        event.listen(engine.sync_engine, "before_cursor_execute", note)
    return found


async def test_what_is_answered_is_what_is_kept_and_the_row_is_read_once(policies, upload_of, reads):
    for owner, now, new in (("ann", "one", True), ("ann", "two", False), ("bob", "three", True)):
        reads.clear()
        answer, is_new = await policies.take(upload_of(owner), now)
        assert (is_new, len(reads)) == (new, 1)
        assert answer == await policies.find(answer.digest, owner)
        assert answer.created_at == {"ann": "one", "bob": "three"}[owner]


@pytest.mark.parametrize("other", ["ann", "bob"])
async def test_a_policy_that_comes_twice_at_once_is_kept_once(policies, new_database, upload_of, other):
    answers = await asyncio.gather(*(policies.take(upload_of(owner), owner) for owner in ("ann", other)))
    assert sorted(new for _, new in answers) == [other != "ann", True]
    for owner, (answer, _) in zip(("ann", other), answers, strict=True):
        assert answer == await policies.find(answer.digest, owner)
    async with new_database.read() as connection:
        assert len((await connection.execute(select(policy))).all()) == 1
        owners = (await connection.execute(select(policy_owner.c.owner))).scalars().all()
    assert sorted(owners) == sorted({"ann", other})


async def test_files_that_are_gone_come_again_and_the_answer_names_the_new_graph(policies, upload_of):
    first, _ = await policies.take(upload_of("ann"), "one")
    await policies._files.remove(first.graph_sha256)
    again, new = await policies.take(upload_of("ann"), "two")
    assert (again, new) == (first, False)
    assert await policies._files.size(again.graph_sha256)


async def test_a_policy_that_is_deleted_while_its_files_come_again_is_to_be_sent_again(policies, upload_of, monkeypatch):
    kept, _ = await policies.take(upload_of("ann"), "one")
    await policies._files.remove(kept.graph_sha256)
    convert = keeping.convert

    async def meanwhile_deleted(*given, **options):
        await policies.disown(kept.digest, "ann")
        return await convert(*given, **options)

    monkeypatch.setattr(keeping, "convert", meanwhile_deleted)
    with pytest.raises(Conflict, match="send it again") as refusal:
        await policies.take(upload_of("ann"), "two")
    assert refusal.value.slug == "policy-going"
