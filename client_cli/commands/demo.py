"""``trifarm demo``: one farm, one policy, one report, and everything is gone again except the results."""

import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.job import MAX_CHOSEN, MAX_SEED, Job, JobRequest, TaskName
from api_schemas.tracker import TrackerName
from client_cli.commands.fetch import fetch_job
from client_cli.commands.uploading import note_warnings, upload
from client_cli.connection.api_client import ApiClient
from client_cli.embedded.child_process import ROOT
from client_cli.embedded.claims import private_files
from client_cli.embedded.farm import FarmOptions, embedded_farm
from client_cli.embedded.robot_options import (
    DEFAULT_PHYSICS,
    FarmSeedOption,
    FaultOption,
    JailOption,
    PhysicsOption,
    ResetOption,
    RobotOptions,
    TrackerOption,
)
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.errors import Interrupted, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption, RobotsOption, TaskOption
from client_cli.terminal.output import counted, note, print_document, print_line
from client_cli.views.following import ending, exit_code_of, follow_to_end

PARALLEL_DOWNLOADS = 4


@dataclass(frozen=True)
class DemoResult:
    """What a demo leaves behind; a job that failed has no report and no folder of logs."""

    job: Job
    report: dict[str, object] | None
    report_text: str | None
    logs: Path | None


def demo(
    policy: Annotated[
        Path | None,
        typer.Option("--policy", metavar="FILE", help="Weights of the policy; by default the shipped ones for push or lift."),
    ] = None,
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    task: TaskOption = TaskName.PUSH,
    trials: Annotated[int, typer.Option("--trials", min=1, max=MAX_CHOSEN, help="Number of trials, one goal each.")] = 40,
    seed: Annotated[
        int, typer.Option("--seed", min=0, max=MAX_SEED, help="Seed of goals and of each trial's order of robots.")
    ] = 1,
    robots: RobotsOption = 4,
    physics: PhysicsOption = DEFAULT_PHYSICS,
    farm_seed: FarmSeedOption = None,
    reset: ResetOption = None,
    fault: FaultOption = None,
    tracker: TrackerOption = TrackerName.POSE,
    jail_level: JailOption = None,
    folder: Annotated[Path, typer.Option("--dir", metavar="DIR", help="Folder for everything that the demo writes.")] = Path(
        "demo-farm"
    ),
    as_json: JsonOption = False,
) -> None:
    """Start a farm, run a policy, print the report, fetch the logs and stop the farm."""
    local = read_policy(policy or _shipped(task), manifest, layout)
    home, told = folder.absolute(), RobotOptions.of(robots, physics, farm_seed, reset, fault, tracker)
    with _farm(FarmOptions(data=home, home=home / "home", port=0, robots=told, jail_level=jail_level)) as client:
        note(f"uploading {local.weights.name} and queueing {counted(trials, f'{task.value} trial')}")
        wish = JobRequest(policy=local.digest, task=task, trials=trials, seed=seed)
        note_warnings(upload(client, local, task))
        job = follow_to_end(client, client.create_job(wish, uuid.uuid4().hex).job_id)
        result = _collect(client, job, folder)
    if as_json:
        print_document(document(result))
    else:
        print_line(text(result))
    raise typer.Exit(exit_code_of(job))


def _shipped(task: TaskName) -> Path:
    """The weights that come with trifarm for a task.

    Raises:
        UsageProblem: there are none for this one.
    """
    folder = ROOT / "sim_backend/training/reference_policies"
    weights = {path.stem: path for path in folder.glob("*.safetensors")}
    if task.value not in weights:
        shipped = ", ".join(each for each in TaskName if each.value in weights)
        raise UsageProblem(f"no policy for {task.value} comes with trifarm, only for {shipped}: give --policy FILE")
    return weights[task.value]


@contextmanager
def _farm(options: FarmOptions) -> Iterator[ApiClient]:
    robots = options.robots
    note(f"starting {counted(robots.count, 'robot')} with {robots.physics_name} physics; everything is in {options.data}")
    try:
        with private_files(), embedded_farm(options) as farm, ApiClient(farm.connection) as client:
            yield client
    except (KeyboardInterrupt, Interrupted):
        raise Interrupted("the demo was stopped, and its farm with it") from None


def _collect(client: ApiClient, job: Job, folder: Path) -> DemoResult:
    if exit_code_of(job) is not ExitCode.OK:
        return DemoResult(job, None, None, None)
    note("fetching the logs")
    fetched = fetch_job(client, job.job_id, folder / f"logs-{job.job_id}", PARALLEL_DOWNLOADS, with_truth=True)
    logs = fetched.folder
    return DemoResult(job, json.loads(client.report(job.job_id)), client.report_text(job.job_id), logs)


def document(result: DemoResult) -> dict[str, object]:
    """A demo's result as JSON."""
    return {
        "job_id": result.job.job_id,
        "state": result.job.state.value,
        "report": result.report,
        "logs": str(result.logs) if result.logs else None,
    }


def text(result: DemoResult) -> str:
    """A demo's result for people."""
    if result.report_text is None or result.logs is None:
        return ending(result.job)
    return "\n".join(
        [
            result.report_text.rstrip(),
            "",
            f"Logs and report.json are in {result.logs}{os.sep}",
            "Open one in Lichtblick or Foxglove (its 3D panel shows the scene as it is), or simulate it again:",
            f"  trifarm replay {result.logs / 'trial-000.mcap'} --verify{_truth_option(result.logs)}",
        ]
    )


def _truth_option(logs: Path) -> str:
    """What the farm would add by itself, were it still there: robots that differ are simulated again from their truth."""
    truth = logs / "trial-000.truth.mcap"
    return f" --truth {truth}" if truth.exists() else ""
