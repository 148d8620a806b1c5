"""``trifarm check``: what the server would say to a policy, without a server."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.policies.checking import and_tried, checked_here, expected
from client_cli.policies.policy_files import check_is_file
from client_cli.policies.trying import task_of
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption, TriedTaskOption, TryOption
from client_cli.terminal.output import note, print_document, print_line


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
    found = expected(file, manifest, layout)
    said = checked_here(file, found)
    chosen = task or task_of(found)
    if said.accepted and tries and chosen is not None:
        note(f"trying it in 20 short trials of {chosen}, for warnings only (--no-try leaves that out)")
        said = and_tried(said, file, found, chosen)
    for warning in said.warnings:
        note(f"warning: {warning}")
    if as_json:
        print_document(said)
    elif said.problem is not None:
        note(f"error: {said.problem.detail} ({said.problem.title})")
    else:
        print_line(f"{said.file} would be accepted as policy {said.digest}")
    raise typer.Exit(ExitCode.OK if said.accepted else ExitCode.REFUSED)
