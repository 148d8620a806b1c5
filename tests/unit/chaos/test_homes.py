"""The servers that a run of chaos starts are open to nobody but its farm."""

import asyncio
import tempfile
from pathlib import Path

import asyncpg
import pytest

from chaos.homes import HomeMissing, scale_home
from chaos.processes import process_group

ADDRESS = "TRIFARM_DATABASE_URL"


async def who_am_i(address):
    connection = await asyncpg.connect(address)
    try:
        return await connection.fetchval("SELECT current_user")
    finally:
        await connection.close()


def test_the_database_asks_who_comes_for_a_password():
    with tempfile.TemporaryDirectory(dir="/tmp") as name, process_group() as processes:
        Path(name).chmod(0o711)  # root's server runs as somebody else
        try:
            home = scale_home(Path(name), Path(name) / "logs", processes)
        except HomeMissing as missing:
            pytest.skip(str(missing))
        home.start_database()
        assert asyncio.run(who_am_i(home.settings[ADDRESS])) == "postgres"
        before, _, after = home.settings[ADDRESS].rpartition("@")
        for guess in ("postgres", "postgres:postgres"):
            with pytest.raises(asyncpg.InvalidPasswordError):
                asyncio.run(who_am_i(f"postgresql://{guess}@{after}"))
        assert (Path(name) / "postgres").stat().st_mode & 0o077 == 0  # its socket, too
        password = before.rpartition(":")[2]
        kept = [path for path in (Path(name) / "postgres").rglob("*") if path.is_file() and path.stat().st_size < 1000]
        assert kept
        assert not any(password in path.read_text(errors="replace") for path in kept)
