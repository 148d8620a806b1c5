"""``trifarm submit``: a policy goes in, a job's id comes out."""

import os
import uuid
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.job import MAX_SEED, MAX_TRIALS, Job, JobRequest
from api_schemas.object import ObjectName
from client_cli.api_client import ApiClient
from client_cli.following import ending, exit_code_of, follow_to_end
from client_cli.options import (
    IdempotencyKeyOption,
    JsonOption,
    LayoutOption,
    ManifestOption,
    ObjectOption,
    ObjectScaleOption,
    TaskOption,
    WaitOption,
)
from client_cli.output import note, print_document, print_line
from client_cli.policy_files import LocalPolicy, read_policy
from client_cli.settings import load_connection


def submit(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The policy's weights: .safetensors, .onnx or SB3's .zip.")],
    task: TaskOption,
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    trials: Annotated[int, typer.Option("--trials", min=1, max=MAX_TRIALS, help="How many goals to try.")] = 40,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, max=MAX_SEED, help="Draws goals and robots; the server draws one if absent."),
    ] = None,
    thing: ObjectOption = ObjectName.CUBE,
    scale: ObjectScaleOption = 1.0,
    wait: WaitOption = False,
    idempotency_key: IdempotencyKeyOption = None,
    as_json: JsonOption = False,
) -> None:
    """Upload a policy, queue a job of trials and print the job's id."""
    policy = read_policy(file, manifest, layout)
    wish = JobRequest(policy=policy.digest, task=task, trials=trials, seed=seed, object=thing, object_scale=scale)
    with ApiClient(load_connection(os.environ)) as client:
        job = submit_policy(client, policy, wish, idempotency_key)
        if not as_json:
            print_line(job.job_id)
        if wait:
            job = follow_to_end(client, job.job_id)
            note(ending(job))
        if as_json:
            print_document(job)
    if wait:
        raise typer.Exit(exit_code_of(job))


def submit_policy(client: ApiClient, policy: LocalPolicy, wish: JobRequest, idempotency_key: str | None = None) -> Job:
    """Upload ``policy`` and queue the job of it; what the dry run found strange is noted, not refused."""
    uploaded = client.upload_policy(policy.digest, policy.weights, policy.manifest)
    for warning in uploaded.warnings:
        note(f"warning: {warning}")
    return client.create_job(wish, idempotency_key or uuid.uuid4().hex)
