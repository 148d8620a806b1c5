"""``trifarm check``: what the server would say to a policy, without a server."""

import subprocess
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.policy import LAYOUTS, PolicyCheck, PolicyManifest, WeightsFormat, canonical_json
from client_cli.embedded.child_process import module_command
from client_cli.policies.policy_files import check_is_file, find_manifest
from client_cli.policies.trying import task_of, tried
from client_cli.terminal.child_answer import answer_of
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption, TriedTaskOption, TryOption
from client_cli.terminal.output import note, print_document, print_line

CHECKING = "services.policies.checking"
ENDS = (ExitCode.OK, ExitCode.REFUSED)


def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Weights of the policy: .safetensors, .onnx or a stable-baselines3 .zip.")
    ],
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    task: TriedTaskOption = None,
    tries: TryOption = True,
    as_json: JsonOption = False,
) -> None:
    """Check on this machine whether the server would accept a policy, and try it in short trials; nothing is sent."""
    check_is_file(file)
    found = _expected(file, manifest, layout)
    with tempfile.TemporaryDirectory(prefix="trifarm-check-") as folder:
        text = Path(folder) / "manifest.json"
        text.write_text(canonical_json(found))
        ended = answer_of(module_command(CHECKING, str(file), str(text), "--json"), subprocess.DEVNULL)
    if ended.returncode not in ENDS:
        raise ClientError(f"'check' {how_it_ended(ended.returncode)}")
    said = PolicyCheck.model_validate_json(ended.stdout)
    chosen = task or task_of(found)
    if said.accepted and tries and chosen is not None:
        note(f"trying it in 20 short trials of {chosen}, for warnings only (--no-try leaves that out)")
        said = said.model_copy(update={"warnings": (*said.warnings, *tried(file, found, chosen))})
    for warning in said.warnings:
        note(f"warning: {warning}")
    if as_json:
        print_document(said)
    elif said.problem is not None:
        note(f"error: {said.problem.detail} ({said.problem.title})")
    else:
        print_line(f"{said.file} would be accepted as policy {said.digest}")
    raise typer.Exit(ended.returncode)


def _expected(file: Path, manifest: Path | None, layout: str | None) -> PolicyManifest:
    """What is stated of a file; of one that is refused whatever is stated, any manifest will do to say so."""
    try:
        return find_manifest(file, manifest, layout)
    except UsageProblem:
        if manifest is None and layout is None and file.suffix.lower() not in {f".{form}" for form in WeightsFormat}:
            return next(iter(LAYOUTS.values()))
        raise
