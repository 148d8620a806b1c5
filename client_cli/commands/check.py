"""``trifarm check``: what the server would say to a policy, without a server."""

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.policy import canonical_json
from client_cli.embedded.child_process import module_command
from client_cli.policies.policy_files import check_is_file, find_manifest
from client_cli.terminal.errors import ClientError
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption

CHECKING = "services.policies.checking"
ENDS = (ExitCode.OK, ExitCode.REFUSED)


def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Weights of the policy: .safetensors, .onnx or a stable-baselines3 .zip.")
    ],
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check on this machine whether the server would accept a policy; nothing is sent."""
    check_is_file(file)
    found = find_manifest(file, manifest, layout)
    with tempfile.TemporaryDirectory(prefix="trifarm-check-") as folder:
        text = Path(folder) / "manifest.json"
        text.write_text(canonical_json(found))
        flags = ["--json"] if as_json else []
        code = run_to_end(module_command(CHECKING, str(file), str(text), *flags), "'check' has been stopped")
    if code not in ENDS:
        raise ClientError(f"'check' {how_it_ended(code)}")
    raise typer.Exit(code)
