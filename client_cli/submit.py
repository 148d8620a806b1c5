"""``trifarm submit``: a policy goes in, a job's id comes out."""

import os
import uuid
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.job import MAX_SEED, MAX_TRIALS, Job, JobRequest, TaskName
from client_cli.api_client import ApiClient
from client_cli.following import ending, exit_code_of, follow_to_end
from client_cli.options import JsonOption, LayoutOption, ManifestOption
from client_cli.output import note, print_document, print_line
from client_cli.policy_files import LocalPolicy, read_policy
from client_cli.settings import load_connection


def submit(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The policy's weights: .safetensors, or a single-file .onnx.")],
    task: Annotated[TaskName, typer.Option("--task", help="What is asked of the robot.")],
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    trials: Annotated[int, typer.Option("--trials", min=1, max=MAX_TRIALS, help="How many goals to try.")] = 40,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, max=MAX_SEED, help="Draws goals and robots; the server draws one if absent."),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Follow the job to its end.")] = False,
    idempotency_key: Annotated[
        str | None,
        typer.Option("--idempotency-key", metavar="TEXT", help="The same key and the same job make one job, however often sent."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Upload a policy, queue a job of trials and print the job's id."""
    policy = read_policy(file, manifest, layout)
    with ApiClient(load_connection(os.environ)) as client:
        job = submit_policy(client, policy, task, trials=trials, seed=seed, idempotency_key=idempotency_key)
        if not as_json:
            print_line(job.job_id)
        if wait:
            job = follow_to_end(client, job.job_id)
            note(ending(job))
        if as_json:
            print_document(job)
    if wait:
        raise typer.Exit(exit_code_of(job))


def submit_policy(
    client: ApiClient,
    policy: LocalPolicy,
    task: TaskName,
    *,
    trials: int,
    seed: int | None,
    idempotency_key: str | None = None,
) -> Job:
    """Upload ``policy`` and queue a job with it; what the smoke run found strange is noted, not refused."""
    uploaded = client.upload_policy(policy.digest, policy.weights, policy.manifest)
    for warning in uploaded.warnings:
        note(f"warning: {warning}")
    request = JobRequest(policy=policy.digest, task=task, trials=trials, seed=seed)
    return client.create_job(request, idempotency_key or uuid.uuid4().hex)
