"""From an upload to a kept policy: digest, checks, conversion, files, and the row last."""

import asyncio
import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import structlog
from sqlalchemy import insert, update
from sqlalchemy.exc import IntegrityError

from api_schemas.builtin_policies import BUILTIN, BUILTIN_NAMES, PREFIX, builtin_content, builtin_digest
from api_schemas.policy import BUILTIN_FORMAT, Policy, PolicyManifest, WeightsFormat, canonical_json, policy_digest
from services.database.database import Database
from services.database.rows import AnyRow
from services.database.tables import policy
from services.errors import Conflict, NotFound, Refused
from services.files.store import FileStore, Stored
from services.policies import child, intake, owners
from services.policies.unfit import printable
from services.settings import Settings

log = structlog.get_logger()
WRONG_DIGEST = "check that the upload was not cut short, and send it to the address with the digest of what you have"


@dataclass(frozen=True)
class Upload:
    """What a user sent: weights in a file that is the caller's, and the parsed manifest; ``share_bytes`` is what he may keep."""

    digest: str
    weights: Path
    weights_sha256: str
    kind: WeightsFormat | Literal["builtin"]
    manifest: PolicyManifest
    owner: str
    filename: str | None = None
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
        """The policy of a digest; with ``owner`` only if it is his.

        Raises:
            NotFound: it was never uploaded, or by others only.
        """
        async with self._database.read() as connection:
            row = await owners.find(connection, digest, owner)
        if row is None:
            raise NotFound("policy-not-found", f"No policy has the digest {digest}; upload it with POST /v1/policies.")
        return show(row)

    async def page(self, before: int | None, limit: int, owner: str | None) -> tuple[tuple[Policy, ...], int | None]:
        """Policies, newest first, placed below ``before``, with ``owner`` only his; and the place to go on from."""
        async with self._database.read() as connection:
            rows = await owners.page(connection, before, limit + 1, owner)
        shown = tuple(show(row) for row in rows[:limit])
        return shown, rows[limit - 1].place if len(rows) > limit else None

    async def take(self, upload: Upload, now_iso: str) -> tuple[Policy, bool]:
        """Keeps an upload; gives the policy and whether it is new.

        Raises:
            Refused: the digest is another, or the policy cannot be converted.
            Forbidden: its owner has no room for it.
        """
        if upload.digest in BUILTIN_NAMES:
            name = BUILTIN_NAMES[upload.digest]
            raise Refused("policy-built-in", f"This is {PREFIX}{name}, which comes with the farm; operators alone may use it.")
        actual = policy_digest(upload.weights_sha256, upload.manifest)
        if actual != upload.digest:
            detail = f"Weights and manifest have the digest {actual}, not {upload.digest}; PUT them to /v1/policies/{actual}."
            raise Refused(
                "digest-mismatch", detail, digest=actual, file=printable(upload.filename), part="", instead=WRONG_DIGEST
            )
        async with self._database.read() as connection:
            mine, known = [await owners.find(connection, actual, owner) for owner in (upload.owner, None)]
        if known is not None:
            await self._restore(known, upload)
        if mine is not None:
            return await self.find(actual, upload.owner), False
        with self._coming(upload.owner, upload.weights.stat().st_size) as coming_bytes:
            await self._check_room(upload, coming_bytes)
            if known is not None:
                return await self._own(upload, known.graph_bytes, now_iso)
            return await self._keep(upload, now_iso)

    async def take_builtin(self, name: str, owner: str, now_iso: str) -> tuple[Policy, bool]:
        """Makes a built-in policy an owner's, as if he had sent it; gives the policy and whether it is new to him."""
        content, manifest = builtin_content(name), BUILTIN[name]
        with tempfile.TemporaryDirectory(prefix="trifarm-builtin-") as folder:
            path = Path(folder) / "builtin"
            path.write_bytes(content)
            sha256 = hashlib.sha256(content).hexdigest()
            upload = Upload(builtin_digest(name), path, sha256, BUILTIN_FORMAT, manifest, owner)
            async with self._database.read() as connection:
                known = await owners.find(connection, upload.digest, None)
            stored = await self._files.put_file(path)
            if known is not None:
                return await self._own(upload, known.graph_bytes, now_iso)
            return await self._insert(upload, stored, stored, (), now_iso)

    async def disown(self, digest: str, owner: str) -> None:
        """Takes a policy from its owner; its files go as logs do that nothing refers to.

        Raises:
            NotFound: it is not his.
            Conflict: something needs it.
        """
        try:
            async with self._database.write() as tx:
                await owners.disown(tx, digest, owner)
        except IntegrityError as error:  # a job of it came in at this moment
            raise Conflict("policy-in-use", f"A job of the policy {digest} has just come in; it is kept.") from error

    @contextmanager
    def _coming(self, owner: str, size: int) -> Iterator[int]:
        """What comes in for an owner at this moment, ``size`` among it: all of it must find room, or no more is done for it."""
        self._coming_bytes[owner] += size
        try:
            yield self._coming_bytes[owner]
        finally:
            self._coming_bytes[owner] -= size
            self._coming_bytes += Counter()  # forgets those of whom nothing comes any more

    async def _check_room(self, upload: Upload, coming_bytes: int) -> None:
        async with self._database.read() as connection:
            await owners.check_room(connection, upload.owner, coming_bytes, upload.share_bytes)

    async def _keep(self, upload: Upload, now_iso: str) -> tuple[Policy, bool]:
        weights, graph, warnings = await self._store(upload, is_kept=False)
        return await self._insert(upload, weights, graph, warnings, now_iso)

    async def _restore(self, known: AnyRow, upload: Upload) -> None:
        """Stores the files of a policy again that are gone; another version may convert to another graph than was there."""
        weights_bytes, graph_bytes = [await self._files.size(each) for each in (known.weights_sha256, known.graph_sha256)]
        if weights_bytes == known.weights_bytes and graph_bytes:
            return
        log.warning("files of a policy are stored again", digest=known.digest)
        _, graph, warnings = await self._store(upload, is_kept=True)
        now_has = {"graph_sha256": graph.sha256, "graph_bytes": graph.size, "warnings": json.dumps(warnings)}
        async with self._database.write() as tx:
            await tx.execute(update(policy).where(policy.c.digest == known.digest).values(now_has))

    async def _store(self, upload: Upload, *, is_kept: bool) -> tuple[Stored, Stored, tuple[str, ...]]:
        """Checks, converts and keeps an upload; gives its weights, its graph and the warnings of the conversion.

        What the farm keeps already (``is_kept``) needs no more room.
        """
        limit_bytes, kind = self._settings.max_weights_bytes, WeightsFormat(upload.kind)
        await asyncio.to_thread(intake.check_weights, upload.weights, kind, limit_bytes, upload.filename)
        with tempfile.TemporaryDirectory(prefix="trifarm-conversion-") as name:
            converted = await self._convert(upload, Path(name))
            with self._coming(upload.owner, converted.graph.stat().st_size) as coming_bytes:
                if not is_kept:
                    await self._check_room(upload, coming_bytes)
                # Only now, so that weights which were refused leave nothing behind.
                graph = await self._files.put_file(converted.graph)
                return await self._files.put_file(upload.weights), graph, converted.warnings

    async def _convert(self, upload: Upload, folder: Path) -> child.Converted:
        manifest = folder / "manifest.json"
        manifest.write_text(canonical_json(upload.manifest))
        async with self._converting:
            return await child.convert(
                upload.weights,
                manifest,
                folder / "policy.onnx",
                self._settings.conversion_deadline_s,
                self._settings.jail_level,
                limit_bytes=self._settings.max_weights_bytes,
                filename=upload.filename,
            )

    async def _insert(
        self, upload: Upload, weights: Stored, graph: Stored, warnings: tuple[str, ...], now_iso: str
    ) -> tuple[Policy, bool]:
        row = insert(policy).values(
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
                await tx.execute(row)
                await owners.own(tx, upload.digest, upload.owner, now_iso)
        except IntegrityError:
            return await self._own(upload, graph.size, now_iso)  # the same policy came in twice at the same time
        return await self.find(upload.digest, upload.owner), True

    async def _own(self, upload: Upload, graph_bytes: int, now_iso: str) -> tuple[Policy, bool]:
        """Makes a policy that is kept already the sender's too: he has shown that he has it, and learns nothing else."""
        async with self._database.write() as tx:
            await owners.hold(tx, upload.owner)
            size = await asyncio.to_thread(lambda: upload.weights.stat().st_size)
            await owners.check_room(tx, upload.owner, size + graph_bytes, upload.share_bytes)
            try:
                new = await owners.own(tx, upload.digest, upload.owner, now_iso)
            except IntegrityError as error:
                raise Conflict("policy-going", "This policy was deleted at this moment; send it again.") from error
        return await self.find(upload.digest, upload.owner), new


def show(row: AnyRow) -> Policy:
    """The policy of a row."""
    return Policy(
        digest=row.digest,
        name=row.name,
        weights_format=row.weights_format,
        weights_sha256=row.weights_sha256,
        weights_bytes=row.weights_bytes,
        graph_sha256=row.graph_sha256,
        manifest=PolicyManifest.model_validate_json(row.manifest),
        warnings=tuple(json.loads(row.warnings)),
        created_at=row.created_at,
    )
