"""``trifarm chaos``: breaks a farm of its own on purpose and says whether it kept its promises."""

import json
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from client_cli.embedded.child_process import clone_command
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import print_document, print_line, print_table

ENDS = (0, 1, 2)
PROMISES = {
    "lost": "acknowledged submissions, and logs of accepted outcomes, that are not there",
    "duplicated": "submissions that became two jobs, trials with two outcomes that count",
    "stuck": "jobs that are not over, without a living lease or a printed reason",
    "acted_too_long": "robots that went on after their lease had ended",
    "changed_reports": "reports that are not what was read before",
    "changed_rates": "success rates that faults of the platform changed",
    "untyped_errors": "answers that name no problem, or one that nobody foresaw",
}


class Home(StrEnum):
    """Where the farm keeps truth and files."""

    EMBEDDED = "embedded"
    SCALE = "scale"


class Campaign(StrEnum):
    """What is done to the farm."""

    MATRIX = "matrix"
    KILLS = "kills"
    PAUSES = "pauses"
    OUTAGES = "outages"


def chaos(
    *,
    quick: Annotated[
        bool, typer.Option("--quick", help="Use fewer jobs and shorter faults, for a run below 10 minutes.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", metavar="S", min=0, help="Seed of faults, their targets and jobs.")] = 0,
    home: Annotated[
        Home, typer.Option("--home", help="embedded uses SQLite and a folder; scale starts PostgreSQL and S3.")
    ] = Home.EMBEDDED,
    campaign: Annotated[
        Campaign, typer.Option("--campaign", help="matrix injects every kind of fault; the others repeat one kind.")
    ] = Campaign.MATRIX,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Also write the JSON document to this file.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Start a farm, inject faults of every known kind while clients work, and check that it keeps its promises."""
    if out is not None and (out.is_dir() or not out.absolute().parent.is_dir()):
        raise UsageProblem(f"cannot write {out}: it is a folder, or there is no folder {out.absolute().parent}")
    flags = ["--home", home.value, "--campaign", campaign.value, "--seed", str(seed), *(["--quick"] if quick else [])]
    said = _run(flags)
    if as_json:
        print_document(said)
    else:
        _show(said)
    if out is not None:
        _keep(said, out, is_printed=as_json)
    raise typer.Exit(ExitCode.OK if said["held"] else ExitCode.OTHER)


def _run(flags: list[str]) -> dict[str, Any]:
    """The document of a run.

    Raises:
        ClientError: there was none, with the reason.
    """
    with tempfile.TemporaryDirectory(prefix="trifarm-chaos-") as folder:
        document = Path(folder) / "run.json"
        command = clone_command("chaos", "run", *flags, "--out", str(document))
        code = run_to_end(command, "'chaos' has been stopped; its farm is gone")
        if code not in ENDS or not document.exists():
            raise ClientError(f"'chaos' {how_it_ended(code)}")
        said = json.loads(document.read_text())
    if "error" in said:
        raise ClientError(said["error"])
    return said


def _keep(said: dict[str, Any], out: Path, *, is_printed: bool) -> None:
    try:
        out.write_text(json.dumps(said, indent=2) + "\n")
    except OSError as error:
        raise UsageProblem(f"cannot write {out}: {error.strerror}", after_document=is_printed) from error


def _show(said: dict[str, Any]) -> None:
    print_table(("fault", "times", "verified", "what was seen"), (_row(each) for each in said["faults"]))
    print_line("")
    print_table(("promise", "broken", "counted are"), ((name, said[name], text) for name, text in PROMISES.items()))
    for name, found in said["broken"].items():
        for sentence in found:
            print_line(f"{name}: {sentence}")
    print_line("")
    print_line(
        f"{said['acknowledged']} trials acknowledged, {said['trials_done']} done, {said['faults_injected']} faults in "
        f"{said['took_s']:.0f} s: promises {'kept' if said['held'] else 'BROKEN'}"
    )


def _row(each: dict[str, Any]) -> tuple[str, int, str, str]:
    if each["skipped_because"] is not None:
        return each["fault"], 0, "skipped", each["skipped_because"]
    return each["fault"], each["injected"], "yes" if each["verified"] else "NO", each["seen"]
