"""``trifarm verify``: is a report what its farm signed? Needs no connection."""

import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from pydantic import ValidationError

from api_schemas.report import Report
from api_schemas.signature import Signature, changed_parts
from client_cli.connection.farm_keys import given_key, known_keys
from client_cli.connection.log_download import log_name, sha256_of
from client_cli.connection.settings import home_folder
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import counted, print_document, print_line
from report_views.page import DATA_ID, MAKERS, render_page

THE_SIGNATURE = "the signature itself"
MOST_NAMED = 3
ENDS = {
    "true": ExitCode.OK,
    "forged": ExitCode.DIFFERS,
    "unverified": ExitCode.UNVERIFIED,
    "incomplete": ExitCode.LOGS_MISSING,
}
_DATA = re.compile(rf'<script type="application/json" id="{DATA_ID}">(.*?)</script>', re.DOTALL)
_SECTION = re.compile(r'<section id="([a-z]+)">(.*?)</section>', re.DOTALL)
_CUT_AT = re.compile(r'(?=<section id=")|(?=</main>)')


@dataclass(frozen=True)
class Verified:
    """What was found: ``changed`` names what is not what was signed, ``missing`` the logs that could not be compared."""

    signature: Signature
    changed: tuple[str, ...]
    is_known: bool
    missing: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """One word."""
        if self.changed:
            return "forged"
        if not self.is_known:
            return "unverified"
        return "incomplete" if self.missing else "true"

    @property
    def exit_code(self) -> ExitCode:
        """How the command ends."""
        return ENDS[self.verdict]


def verify(
    report: Annotated[Path, typer.Argument(metavar="REPORT", help="Signed page of 'trifarm report --html' or of the dashboard.")],
    key: Annotated[
        str | None,
        typer.Option("--key", metavar="KEY", help="Public key of the farm, or a file with it; by default the known keys."),
    ] = None,
    logs: Annotated[
        Path | None, typer.Option("--logs", metavar="DIR", help="Folder of fetched logs to compare with the signed ones.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check offline that a signed report is unchanged and which farm signed it."""
    try:
        page = report.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageProblem(f"cannot read {report}: {error}") from error
    if logs is not None and not logs.is_dir():
        raise UsageProblem(f"there is no folder {logs}; --logs names one that 'trifarm fetch' made")
    keys = {given_key(key): "given by --key"} if key else known_keys(home_folder(os.environ))
    found = check(page, frozenset(keys), logs)
    if as_json:
        print_document(document(found))
    else:
        print_line("\n".join(_lines(report.name, found, keys)))
    raise typer.Exit(found.exit_code)


def document(found: Verified) -> dict[str, object]:
    """The verdict as JSON."""
    signed = found.signature
    return {
        "verdict": found.verdict,
        "changed": list(found.changed),
        "missing": list(found.missing),
        "job_id": signed.job_id,
        "policy": signed.policy,
        "report_sha256": signed.report_sha256,
        "key": signed.key,
    }


def check(page: str, keys: frozenset[str], logs: Path | None = None) -> Verified:
    """Compares the data in a page with what was signed, and what the page shows with the data.

    Args:
        page: the HTML.
        keys: the public keys that are known.
        logs: a folder of logs to be compared, too; one that is not in it is no change of the report.

    Raises:
        UsageProblem: the page is no signed report.
    """
    report, signature = _embedded(page)
    changed = [*changed_parts(report, signature)]
    if not _is_signed(signature):
        changed.append(THE_SIGNATURE)
    changed += _shown_otherwise(page, report, signature)
    named = () if logs is None else tuple(_logs_of(report, logs))
    changed += [
        f"{path.name} is not the log that was signed" for path, sha256 in named if path.is_file() and sha256_of(path) != sha256
    ]
    missing = tuple(path.name for path, _ in named if not path.is_file())
    return Verified(signature, tuple(changed), signature.key in keys, missing)


def _embedded(page: str) -> tuple[dict[str, Any], Signature]:
    found = _DATA.search(page)
    try:
        data = json.loads(found[1] if found else "")
        return data["report"], Signature.model_validate(data["signature"])
    except (ValueError, KeyError, TypeError) as error:
        raise UsageProblem(
            "this is no signed report: the data of one are missing or broken; 'trifarm report ID --html FILE' makes a new one"
        ) from error


def _is_signed(signature: Signature) -> bool:
    try:
        public = Ed25519PublicKey.from_public_bytes(bytes.fromhex(signature.key))
        public.verify(bytes.fromhex(signature.signature), signature.signed_bytes())
    except (InvalidSignature, ValueError):
        return False
    return True


def _shown_otherwise(page: str, report: dict[str, Any], signature: Signature) -> Iterator[str]:
    """The sections of the page that do not show what the data say; a page of an unknown maker is judged by its data alone."""
    maker = next((maker for maker in MAKERS if f'<meta name="generator" content="{maker}">' in page), None)
    if maker is None:
        yield f"the page's maker, which is none of {', '.join(MAKERS)}"
        return
    try:
        true_page = render_page(Report.model_validate(report), signature, maker)
    except ValidationError:
        return  # changed_parts has named it
    if page == true_page:
        return
    now, then = dict(_SECTION.findall(page)), dict(_SECTION.findall(true_page))
    different = [name for name in dict.fromkeys((*then, *now)) if now.get(name) != then.get(name)]
    yield from (f"what the page shows under '{name}'" for name in different)
    if _CUT_AT.split(page)[0] != _CUT_AT.split(true_page)[0] or not different:
        yield "what the page holds besides its sections"


def _logs_of(report: dict[str, Any], folder: Path) -> Iterator[tuple[Path, str]]:
    """Where each trial's log should be, and the SHA-256 that was signed."""
    rows = report.get("per_trial", [])
    yield from ((folder / log_name(row["trial"]), row["log_sha256"]) for row in rows if row["log_sha256"] is not None)


def _lines(name: str, found: Verified, keys: dict[str, str]) -> Iterator[str]:
    signed = found.signature
    if found.changed:
        yield f"{name}: FORGED; this is not what the farm signed:"
        yield from (f"  {part}" for part in found.changed)
    elif found.is_known:
        yield f"{name}: true; job {signed.job_id} as its farm signed it ({keys[signed.key]})"
    else:
        yield f"{name}: unverified; nothing was changed since it was signed, but its key is not known here"
        yield "  ask the farm's operator for the key, and give it with --key"
    if found.missing:
        more = len(found.missing) - MOST_NAMED
        named = ", ".join(found.missing[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
        yield f"  not in the folder, and so not compared: {counted(len(found.missing), 'log')} ({named})"
    if not found.changed:
        yield f"  key    {signed.key}"
        yield f"  policy {signed.policy}"
