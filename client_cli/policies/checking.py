"""The farm's own checks of a policy, run here: what ``trifarm check`` and ``trifarm.check`` have in common."""

import subprocess
import tempfile
from pathlib import Path

from api_schemas.policy import LAYOUTS, PolicyCheck, PolicyManifest, WeightsFormat, canonical_json
from client_cli.embedded.child_process import module_command
from client_cli.policies.policy_files import find_manifest
from client_cli.policies.trying import tried
from client_cli.terminal.child_answer import answer_of
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended

CHECKING = "services.policies.checking"
ENDS = (ExitCode.OK, ExitCode.REFUSED)


def checked_here(file: Path, manifest: PolicyManifest) -> PolicyCheck:
    """Whether a farm would accept a policy.

    Raises:
        ClientError: the checks broke.
    """
    with tempfile.TemporaryDirectory(prefix="trifarm-check-") as folder:
        text = Path(folder) / "manifest.json"
        text.write_text(canonical_json(manifest))
        ended = answer_of(module_command(CHECKING, str(file), str(text), "--json"), subprocess.DEVNULL)
    if ended.returncode not in ENDS:
        raise ClientError(f"'check' {how_it_ended(ended.returncode)}")
    return PolicyCheck.model_validate_json(ended.stdout)


def and_tried(said: PolicyCheck, file: Path, manifest: PolicyManifest, task: str) -> PolicyCheck:
    """A verdict with the warnings of 20 short trials of ``task``."""
    return said.model_copy(update={"warnings": (*said.warnings, *tried(file, manifest, task))})


def expected(file: Path, manifest: Path | None, layout: str | None) -> PolicyManifest:
    """What is stated of a file; of one that is refused whatever is stated, any manifest will do to say so.

    Raises:
        UsageProblem: nothing states it, or what does cannot be used.
    """
    try:
        return find_manifest(file, manifest, layout)
    except UsageProblem:
        if manifest is None and layout is None and file.suffix.lower() not in {f".{form}" for form in WeightsFormat}:
            return next(iter(LAYOUTS.values()))
        raise
