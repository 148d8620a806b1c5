"""A policy tried where it costs nothing: 20 short trials in a small nominal simulation, for warnings and never for a refusal."""

import importlib.util
import json
import subprocess
import tempfile
from pathlib import Path

from api_schemas.job import TaskName
from api_schemas.observation import fields_of
from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json
from client_cli.embedded.child_process import child_environment, module_command
from client_cli.terminal.child_answer import answer_of

SIMULATION = "sim_backend.trying"
CONVERSION = "services.policies.conversion"
ANY_JAIL = "none"
GOALS = (
    ("goal_fingertip_position_world_m", TaskName.REACH),
    ("goal_keypoints_world_m", TaskName.LIFT),
    ("goal_quat_wxyz", TaskName.LIFT),
    ("goal_quat_xyzw", TaskName.LIFT),
    ("goal_position_world_m", TaskName.PUSH),
)
"""What a policy that sees such a goal was most likely trained for."""

OWN_TASKS = {
    "rrc2022-push": TaskName.PUSH,
    "rrc2022-push-flat": TaskName.PUSH,
    "rrc2022-lift-flat": TaskName.LIFT,
}
"""Layouts that belong to one task each; what rrc2022-lift has, keypoints has, too."""


def task_of(manifest: PolicyManifest) -> str | None:
    """The task that a policy is tried on where nobody says which; None for one that sees no goal."""
    seen = fields_of(manifest.observation)
    return next((task.value for field, task in GOALS if field in seen), None)


def of_another_task(manifest: PolicyManifest, task: TaskName) -> str | None:
    """A sentence where a policy reads the whole layout of one task of 2022 and is sent to the other."""
    for name, own in OWN_TASKS.items():
        if task in OWN_TASKS.values() and task != own and manifest.observation == LAYOUTS[name].observation:
            reads = f"the policy reads {name}, the layout of {own.value}"
            return f"{reads}, and the job is {task.value}, whose goals are of another kind"
    return None


def tried(weights: Path, manifest: PolicyManifest, task: str) -> tuple[str, ...]:
    """What is strange about a policy in 20 short trials, as sentences; nothing where it cannot be tried here."""
    if importlib.util.find_spec("mujoco") is None or manifest.images is not None:  # there are no cameras here
        return ()
    with tempfile.TemporaryDirectory(prefix="trifarm-try-") as name:
        folder = Path(name)
        given, expected, graph = folder / f"weights{weights.suffix}", folder / "manifest.json", folder / "graph.onnx"
        given.write_bytes(weights.read_bytes())
        expected.write_text(canonical_json(manifest))
        converting = module_command(CONVERSION, str(given), str(expected), str(graph), ANY_JAIL)
        subprocess.run(converting, capture_output=True, check=False, cwd=folder, env=child_environment())
        if not graph.exists():
            return ()
        ended = answer_of(module_command(SIMULATION, str(graph), str(expected), "--task", task), subprocess.DEVNULL)
    return () if ended.returncode else tuple(json.loads(ended.stdout)["warnings"])
