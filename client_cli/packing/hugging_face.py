"""Hugging Face folders: LeRobot's policies are exported by LeRobot itself, in its own environment; others are state dicts."""

import importlib.util
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from client_cli.packing import kinds
from client_cli.packing.kinds import PLAIN
from client_cli.terminal.errors import UsageProblem

if TYPE_CHECKING:
    from client_cli.packing.reading import Statement

EXPORTER = Path(__file__).with_name("lerobot_export.py")
"""A program of its own that needs nothing but LeRobot."""
REASONS = {
    "diffusion": "it draws new noise for each chunk of actions, and a policy on the farm gives the same action for the same past",
    "vqbet": "it draws codes at random, and a policy on the farm gives the same action for the same past",
    "tdmpc": "it plans by drawing trajectories, and a policy on the farm gives the same action for the same past",
    "smolvla": "it sees images and reads text, and a robot of the farm shows neither to a policy",
    "pi0": "it sees images and reads text, and a robot of the farm shows neither to a policy",
    "pi05": "it sees images and reads text, and a robot of the farm shows neither to a policy",
    "pi0_fast": "it sees images and reads text, and a robot of the farm shows neither to a policy",
}
WAY_OUT = "distil it into a network without them, or export what you need of it with torch.jit.script and pack that"
EXPORT_WITHIN_S = 600.0
REFUSED = 3
"""Exit code of the exporter where LeRobot's policy cannot be exported; its last line says why."""


def opened(folder: Path, stated: "Statement") -> tuple[Path, str, "Statement"]:
    """The file in or made of a folder, its kind, and what is stated of it.

    Raises:
        UsageProblem: it is of a kind that cannot be packed, or LeRobot is wanted and not here.
    """
    config = kinds.config_of(folder)
    kind = config.get("type")
    if not isinstance(kind, str) or "input_features" not in config:
        return folder / "model.safetensors", PLAIN, stated
    if kind in REASONS:
        raise UsageProblem(
            f"{folder.name} is a policy of LeRobot of the kind {kind!r}, which is not packed: {REASONS[kind]}; {WAY_OUT}"
        )
    if kind != "act":
        raise UsageProblem(f"{folder.name} is LeRobot's {kind!r}; only 'act' is exported here: {WAY_OUT}")
    return _exported(folder, stated), "torchscript", replace(stated, states=())


def _exported(folder: Path, stated: "Statement") -> Path:
    python = stated.python or (Path(sys.executable) if importlib.util.find_spec("lerobot") else None)
    if python is None:
        raise UsageProblem(
            f"{folder.name} is a policy of LeRobot, which is not installed here and wants another torch: give --python with the "
            f"interpreter of an environment that has it (such as lerobot/bin/python), or run 'python {EXPORTER} {folder} act.pt' "
            "there and 'trifarm pack act.pt' here"
        )
    out = Path(tempfile.mkdtemp(prefix="trifarm-lerobot-")) / f"{folder.name}.pt"
    command = [str(python), str(EXPORTER), str(folder), str(out)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=EXPORT_WITHIN_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise UsageProblem(f"--python {python} could not export {folder.name}: {str(error)[:200]}") from error
    if ended.returncode != 0:
        lines = [line for line in (ended.stdout if ended.returncode == REFUSED else ended.stderr).splitlines() if line.strip()]
        raise UsageProblem(f"LeRobot could not export {folder.name}: {(lines or ['it says nothing'])[-1][:300]}")
    return out
