"""What processes tell each other by the database, on both homes."""

from sqlalchemy import insert

from services.database.tables import signed_out
from services.sharing import KEPT_S, add_asked, all_signed_out, forget_old, note_signed_out


async def test_who_signed_out_is_known_to_all_until_the_cookie_is_too_old(new_database):
    for mark, until_s, at_s in ((b"a" * 32, 100.0, 10.0), (b"b" * 32, 300.0, 20.0), (b"b" * 32, 300.0, 21.0)):
        async with new_database.write() as tx:
            await note_signed_out(tx, mark, until_s, at_s)
    async with new_database.read() as connection:
        assert await all_signed_out(connection, 50.0) == [(b"a" * 32, 100.0), (b"b" * 32, 300.0)]
        assert await all_signed_out(connection, 200.0) == [(b"b" * 32, 300.0)]
        assert await all_signed_out(connection, 50.0, since_s=20.0) == [(b"b" * 32, 300.0)]
        assert await all_signed_out(connection, 50.0, since_s=20.5) == []
    async with new_database.write() as tx:
        await forget_old(tx, 400.0)
    async with new_database.read() as connection:
        assert await all_signed_out(connection, 0.0) == []


async def test_what_a_process_of_an_older_version_has_signed_out_is_always_read(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(signed_out).values(mark="aa" * 32, until_s=100.0))
    async with new_database.read() as connection:
        assert await all_signed_out(connection, 50.0, since_s=60.0) == [(b"\xaa" * 32, 100.0)]


async def test_counts_of_several_processes_add_up_and_old_ones_go(new_database):
    for counts, expected in (
        ({"token a": 3, "robot b": 1}, {"token a": 3, "robot b": 1}),
        ({"token a": 4}, {"token a": 7}),
        ({}, {}),
    ):
        async with new_database.write() as tx:
            assert await add_asked(tx, counts, 1000.0) == expected
    async with new_database.write() as tx:
        await forget_old(tx, 1001.0 + KEPT_S)
        assert await add_asked(tx, {"token a": 1}, 2000.0) == {"token a": 1}
