"""From an upload to a kept policy: digest, checks, conversion, files, and the row last."""

import asyncio
import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import structlog
from sqlalchemy import insert, update
from sqlalchemy.exc import IntegrityError

from api_schemas.builtin_policies import BUILTIN, BUILTIN_NAMES, PREFIX, builtin_content, builtin_digest
from api_schemas.policy import BUILTIN_FORMAT, Policy, PolicyManifest, WeightsFormat, canonical_json
from services.database.database import Database
from services.database.pages import Asked, Page
from services.database.rows import AnyRow
from services.database.tables import policy
from services.errors import Conflict, NotFound, Refused
from services.files.store import FileStore, Stored
from services.policies import intake, owners
from services.policies.jailed_conversion import convert
from services.policies.unfit import printable
from services.settings import Settings

log = structlog.get_logger()
WRONG_DIGEST = "check that the upload was not cut short, and send it to the address with the digest of what you have"


@dataclass(frozen=True)
class Upload:
    """One policy that a user sent.

    Attributes:
        digest: of weights and manifest.
        weights: their file, which belongs to the caller.
        weights_sha256: of that file.
        kind: its format.
        manifest: parsed.
        owner: the user.
        filename: what the user calls the weights.
        address: the digest that the user sent it to; None where they named none.
        share_bytes: how much the user may keep; None is without a limit.
    """

    digest: str
    weights: Path
    weights_sha256: str
    kind: WeightsFormat | Literal["builtin"]
    manifest: PolicyManifest
    owner: str
    filename: str | None = None
    address: str | None = None
    share_bytes: int | None = None


class Policies:
    """The policies of the farm; rows in the database, weights and graphs in the file store."""

    def __init__(self, settings: Settings, database: Database, files: FileStore) -> None:
        self._settings = settings
        self._database = database
        self._files = files
        self._converting = asyncio.Semaphore(settings.conversion_at_once)
        self._coming_bytes: Counter[str] = Counter()

    async def find(self, digest: str, owner: str | None = None) -> Policy:
        """The policy of a digest; with ``owner`` only if it is theirs.

        Raises:
            NotFound: it was never uploaded, or by others only.
        """
        async with self._database.read() as connection:
            row = await owners.find(connection, digest, owner)
        if row is None:
            raise NotFound("policy-not-found", f"No policy has the digest {digest}; upload it with POST /v1/policies.")
        return show(row)

    async def page(self, owner: str | None, asked: Asked) -> Page[Policy]:
        """Policies, newest first; with ``owner`` theirs alone."""
        async with self._database.read() as connection:
            return (await owners.page(connection, owner, asked)).show(show)

    async def take(self, upload: Upload, now_iso: str) -> tuple[Policy, bool]:
        """Keeps an upload; gives the policy and whether it is new to its sender.

        Raises:
            Refused: it was sent to the digest of another, or the policy cannot be converted.
            Forbidden: its owner has no room for it.
            Conflict: the same policy was deleted meanwhile.
        """
        digest, address = upload.digest, upload.address or upload.digest
        if address in BUILTIN_NAMES:
            detail = f"This is {PREFIX}{BUILTIN_NAMES[address]}, which comes with the farm; operators alone may use it."
            raise Refused("policy-built-in", detail)
        if address != digest:
            detail = f"Weights and manifest have the digest {digest}, not {address}; PUT them to /v1/policies/{digest}."
            members = {"file": printable(upload.filename), "part": "", "instead": WRONG_DIGEST}
            raise Refused("digest-mismatch", detail, digest=digest, **members)
        async with self._database.read() as connection:
            known = await owners.find_for(connection, digest, upload.owner)
        if known is not None:
            since, known = known.owned_at, await self._restored(known, upload)
            if since is not None:
                return show(known, since), False
        async with self._room(upload, upload.weights.stat().st_size):
            if known is not None:
                return await self._own(upload, known, now_iso)
            weights, graph, warnings = await self._store(upload, is_kept=False)
            return await self._insert(upload, weights, graph, warnings, now_iso)

    async def take_builtin(self, name: str, owner: str, now_iso: str) -> tuple[Policy, bool]:
        """Makes a built-in policy an owner's, as if they had sent it; gives the policy and whether it is new to them."""
        content, manifest = builtin_content(name), BUILTIN[name]
        with tempfile.TemporaryDirectory(prefix="trifarm-builtin-") as folder:
            path = Path(folder) / "builtin"
            path.write_bytes(content)
            sha256 = hashlib.sha256(content).hexdigest()
            upload = Upload(builtin_digest(name), path, sha256, BUILTIN_FORMAT, manifest, owner)
            async with self._database.read() as connection:
                known = await owners.find_for(connection, upload.digest, owner)
            stored = await self._files.put_file(path)
            if known is not None:
                return await self._own(upload, known, now_iso)
            return await self._insert(upload, stored, stored, (), now_iso)

    async def disown(self, digest: str, owner: str) -> None:
        """Takes a policy from its owner; its files go as logs do that nothing refers to.

        Raises:
            NotFound: it is not theirs.
            Conflict: something needs it.
        """
        try:
            async with self._database.write() as tx:
                await owners.disown(tx, digest, owner)
        except IntegrityError as error:  # a job of it came in at this moment
            raise Conflict("policy-in-use", f"A job of the policy {digest} has just come in; it is kept.") from error

    @asynccontextmanager
    async def _room(self, upload: Upload, size: int) -> AsyncIterator[None]:
        """Counts ``size`` bytes as coming in for an owner; all that comes in for them at this moment must find room.

        Raises:
            Forbidden: there is no room for all of it.
        """
        self._coming_bytes[upload.owner] += size
        coming_bytes = self._coming_bytes[upload.owner]
        try:
            async with self._database.read() as connection:
                await owners.check_room(connection, upload.owner, coming_bytes, upload.share_bytes)
            yield
        finally:
            self._coming_bytes[upload.owner] -= size
            self._coming_bytes += Counter()  # forgets those of whom nothing comes any more

    async def _restored(self, known: AnyRow, upload: Upload) -> AnyRow:
        """The row of a policy whose files are there, if need be stored again: another version may convert to another graph."""
        weights_bytes, graph_bytes = [await self._files.size(each) for each in (known.weights_sha256, known.graph_sha256)]
        if weights_bytes == known.weights_bytes and graph_bytes:
            return known
        log.warning("files of a policy are stored again", digest=known.digest)
        _, graph, warnings = await self._store(upload, is_kept=True)
        now_has = {"graph_sha256": graph.sha256, "graph_bytes": graph.size, "warnings": json.dumps(warnings)}
        async with self._database.write() as tx:
            changed = update(policy).where(policy.c.digest == known.digest).values(now_has).returning(*policy.c)
            row = (await tx.execute(changed)).one_or_none()
        if row is None:
            raise _going()
        return row

    async def _store(self, upload: Upload, *, is_kept: bool) -> tuple[Stored, Stored, tuple[str, ...]]:
        """Checks, converts and keeps an upload; gives its weights, its graph and the warnings of the conversion.

        What the farm keeps already (``is_kept``) needs no more room.
        """
        limit_bytes, kind = self._settings.max_weights_bytes, WeightsFormat(upload.kind)
        await asyncio.to_thread(intake.check_weights, upload.weights, kind, limit_bytes, upload.filename)
        with tempfile.TemporaryDirectory(prefix="trifarm-conversion-") as name:
            async with self._converting:
                converted = await convert(
                    upload.weights,
                    upload.manifest,
                    Path(name),
                    self._settings.conversion_deadline_s,
                    self._settings.jail_level,
                    limit_bytes=limit_bytes,
                    filename=upload.filename,
                )
            # Only now, so that weights which were refused leave nothing behind.
            async with nullcontext() if is_kept else self._room(upload, converted.graph.stat().st_size):
                graph = await self._files.put_file(converted.graph)
                return await self._files.put_file(upload.weights), graph, converted.warnings

    async def _insert(
        self, upload: Upload, weights: Stored, graph: Stored, warnings: tuple[str, ...], now_iso: str
    ) -> tuple[Policy, bool]:
        new = insert(policy).values(
            digest=upload.digest,
            name=upload.manifest.name,
            weights_format=upload.kind,
            weights_sha256=weights.sha256,
            weights_bytes=weights.size,
            graph_sha256=graph.sha256,
            graph_bytes=graph.size,
            manifest=canonical_json(upload.manifest),
            warnings=json.dumps(warnings),
            owner=upload.owner,
            created_at=now_iso,
        )
        try:
            async with self._database.write() as tx:
                await owners.hold(tx, upload.owner)
                await owners.check_room(tx, upload.owner, weights.size + graph.size, upload.share_bytes)
                row = (await tx.execute(new.returning(*policy.c))).one()
                await owners.own(tx, upload.digest, upload.owner, now_iso)
        except IntegrityError as error:  # the same policy came in twice at the same time
            async with self._database.read() as connection:
                known = await owners.find_for(connection, upload.digest, upload.owner)
            if known is None:
                raise _going() from error
            return await self._own(upload, known, now_iso)
        return show(row, now_iso), True

    async def _own(self, upload: Upload, known: AnyRow, now_iso: str) -> tuple[Policy, bool]:
        """Makes a policy that is kept already the sender's too: they have shown that they have it, and learn nothing else."""
        async with self._database.write() as tx:
            await owners.hold(tx, upload.owner)
            await owners.check_room(tx, upload.owner, known.weights_bytes + known.graph_bytes, upload.share_bytes)
            try:
                since = await owners.own(tx, upload.digest, upload.owner, now_iso)
            except IntegrityError as error:
                raise _going() from error
        return show(known, since or now_iso), since is None


def _going() -> Conflict:
    return Conflict("policy-going", "This policy was deleted at this moment; send it again.")


def show(row: AnyRow, owned_at: str | None = None) -> Policy:
    """The policy of a row; dated from ``owned_at`` if it is given."""
    return Policy(
        digest=row.digest,
        name=row.name,
        weights_format=row.weights_format,
        weights_sha256=row.weights_sha256,
        weights_bytes=row.weights_bytes,
        graph_sha256=row.graph_sha256,
        manifest=PolicyManifest.model_validate_json(row.manifest),
        warnings=tuple(json.loads(row.warnings)),
        created_at=owned_at or row.created_at,
    )
