"""What people call a job and remember of it; nothing else of the job hangs on it."""

from collections.abc import Mapping

from sqlalchemy import update
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.tables import job


async def label(tx: AsyncConnection, job_number: int, values: Mapping[str, str | None]) -> None:
    """Sets ``name``, ``note`` or both; an empty text, like None, takes it away."""
    kept = {name: text.strip() or None if text else None for name, text in values.items()}
    if kept:
        await tx.execute(update(job).where(job.c.number == job_number).values(**kept))
