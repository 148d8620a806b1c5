"""From an upload to a kept policy: digest, checks, conversion, files, and the row last."""

import asyncio
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import insert, select
from sqlalchemy.exc import IntegrityError

from api_schemas.policy import Policy, PolicyManifest, WeightsFormat, canonical_json, policy_digest
from services.database.database import Database
from services.database.rows import AnyRow
from services.database.tables import policy
from services.errors import NotFound, Refused
from services.files.store import FileStore, Stored
from services.policies import child, intake
from services.policies.unfit import printable
from services.settings import Settings

WRONG_DIGEST = "check that the upload was not cut short, and send it to the address with the digest of what you have"


@dataclass(frozen=True)
class Upload:
    """What a user sent: weights in a file that is the caller's, and the parsed manifest."""

    digest: str
    weights: Path
    weights_sha256: str
    kind: WeightsFormat
    manifest: PolicyManifest
    owner: str
    filename: str | None = None


class Policies:
    """The policies of the farm; rows in the database, weights and graphs in the file store."""

    def __init__(self, settings: Settings, database: Database, files: FileStore) -> None:
        self._settings = settings
        self._database = database
        self._files = files
        self._converting = asyncio.Semaphore(settings.conversion_at_once)

    async def find(self, digest: str) -> Policy:
        """The policy of a digest.

        Raises:
            NotFound: it was never uploaded.
        """
        async with self._database.read() as connection:
            row = (await connection.execute(select(policy).where(policy.c.digest == digest))).one_or_none()
        if row is None:
            raise NotFound("policy-not-found", f"No policy has the digest {digest}; upload it with PUT /v1/policies/{digest}.")
        return show(row)

    async def page(self, before: int | None, limit: int) -> tuple[tuple[Policy, ...], int | None]:
        """Policies, newest first, numbered below ``before``; and the number to go on from."""
        wanted = select(policy).order_by(policy.c.number.desc()).limit(limit + 1)
        if before is not None:
            wanted = wanted.where(policy.c.number < before)
        async with self._database.read() as connection:
            rows = (await connection.execute(wanted)).all()
        shown = tuple(show(row) for row in rows[:limit])
        return shown, rows[limit - 1].number if len(rows) > limit else None

    async def take(self, upload: Upload, now_iso: str) -> tuple[Policy, bool]:
        """Keeps an upload; gives the policy and whether it is new.

        Raises:
            Refused: the digest is another, or the policy cannot be converted.
        """
        actual = policy_digest(upload.weights_sha256, upload.manifest)
        if actual != upload.digest:
            detail = f"Weights and manifest have the digest {actual}, not {upload.digest}; PUT them to /v1/policies/{actual}."
            raise Refused(
                "digest-mismatch", detail, digest=actual, file=printable(upload.filename), part="", instead=WRONG_DIGEST
            )
        try:
            return await self.find(actual), False
        except NotFound:
            pass
        limit_bytes = self._settings.max_weights_bytes
        await asyncio.to_thread(intake.check_weights, upload.weights, upload.kind, limit_bytes, upload.filename)
        graph, warnings = await self._convert(upload)
        # Only now, so that weights which were refused leave nothing behind.
        weights = await self._files.put_file(upload.weights, durable=True)
        return await self._insert(upload, weights, graph, warnings, now_iso)

    async def _convert(self, upload: Upload) -> tuple[Stored, tuple[str, ...]]:
        async with self._converting:
            with tempfile.TemporaryDirectory(prefix="trifarm-conversion-") as name:
                folder, deadline_s = Path(name), self._settings.conversion_deadline_s
                manifest = folder / "manifest.json"
                manifest.write_text(canonical_json(upload.manifest))
                converted = await child.convert(
                    upload.weights,
                    manifest,
                    folder / "policy.onnx",
                    deadline_s,
                    self._settings.jail_level,
                    filename=upload.filename,
                )
                return await self._files.put_file(converted.graph, durable=True), converted.warnings

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
            manifest=canonical_json(upload.manifest),
            warnings=json.dumps(warnings),
            owner=upload.owner,
            created_at=now_iso,
        )
        new = True
        try:
            async with self._database.write() as tx:
                await tx.execute(row)
        except IntegrityError:
            new = False  # the same policy came in twice at the same time
        return await self.find(upload.digest), new


def show(row: AnyRow) -> Policy:
    """The policy of a row."""
    return Policy(
        digest=row.digest,
        name=row.name,
        weights_format=WeightsFormat(row.weights_format),
        weights_sha256=row.weights_sha256,
        weights_bytes=row.weights_bytes,
        graph_sha256=row.graph_sha256,
        manifest=PolicyManifest.model_validate_json(row.manifest),
        warnings=tuple(json.loads(row.warnings)),
        created_at=row.created_at,
    )
