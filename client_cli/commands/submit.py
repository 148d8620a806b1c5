"""``trifarm submit``: a policy goes in, a job's id comes out; of a folder of checkpoints, a ladder's."""

import os
import sys
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from api_schemas.job import MAX_SEED, MAX_TRIALS, JobPriority
from api_schemas.ladder import LadderRequest
from api_schemas.physics import ObjectName
from client_cli.commands.asking import (
    AgainstOption,
    Asking,
    AtLeastOption,
    BarOption,
    GoalsOption,
    HalvingOption,
    LikeOption,
    MaxOption,
    RecipeOption,
    RewardsOption,
    TrainingSeedOption,
    UntilKnownOption,
)
from client_cli.commands.ladder import (
    FOLDER,
    ends_of,
    follow_ladder,
    ladder_exit_code,
    read_checkpoints,
    read_rewards,
    rungs_of,
    submit_ladder,
)
from client_cli.commands.submission import checked, prepare
from client_cli.commands.uploading import note_warnings
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.policies.checkpoints import find_checkpoints
from client_cli.policies.policy_files import LocalPolicy
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.options import (
    IdempotencyKeyOption,
    ImagesOption,
    JsonOption,
    LayoutOption,
    LikeTaskOption,
    ManifestOption,
    NameOption,
    NoteOption,
    ObjectOption,
    ObjectScaleOption,
    PriorityOption,
    WaitOption,
    WebhookOption,
)
from client_cli.terminal.output import counted, note, print_document, print_line
from client_cli.views.following import ending, exit_code_of, follow_to_end


def submit(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Weights (.safetensors, .onnx, stable-baselines3 .zip), a folder of checkpoints, or builtin:grasp[-turn].",
        ),
    ],
    task: LikeTaskOption = None,
    *,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    trials: Annotated[
        int | None,
        typer.Option("--trials", min=1, max=MAX_TRIALS, help="Number of trials, one goal each; 40 by default."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            min=0,
            max=MAX_SEED,
            help="Seed of goals and of each trial's order of robots; by default the server draws it.",
        ),
    ] = None,
    thing: ObjectOption = ObjectName.CUBE,
    scale: ObjectScaleOption = 1.0,
    priority: PriorityOption = JobPriority.NORMAL,
    against: AgainstOption = None,
    bar: BarOption = None,
    until_known: UntilKnownOption = False,
    most: MaxOption = None,
    at_least: AtLeastOption = None,
    like: LikeOption = None,
    goals: GoalsOption = None,
    images: ImagesOption = False,
    recipe: RecipeOption = None,
    training_seed: TrainingSeedOption = None,
    halving: HalvingOption = False,
    rewards: RewardsOption = None,
    name: NameOption = None,
    note_text: NoteOption = None,
    webhook: WebhookOption = None,
    wait: WaitOption = False,
    idempotency_key: IdempotencyKeyOption = None,
    step_from: Annotated[
        str | None,
        typer.Option(
            "--step-from",
            metavar="WORD|PATTERN",
            help="Number in the names of a folder's checkpoints by which they are ordered: the word before it, or a pattern "
            "with a group, such as 'ep_(\\d+)'; by default the last that differs.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Upload a policy, queue a job and print its id; for a folder, queue a job for each checkpoint."""
    common: dict[str, Any] = {"task": task, "seed": seed, "object": thing, "object_scale": scale, "priority": priority}
    asking = Asking(against, bar, until_known, most, at_least, like, goals)
    if file.is_dir():
        of_one_job = (webhook, name, note_text, recipe, training_seed)
        if any(each is not None for each in of_one_job) or task is None or images:
            raise UsageProblem(FOLDER)
        ends = ends_of(asking, halving=halving, trials=trials)
        policies = read_checkpoints(find_checkpoints(file, step_from), manifest, layout)
        told = {} if rewards is None else read_rewards(rewards)
        named = {"name": file.resolve().name[:100] or "checkpoints", "rungs": rungs_of(policies, told), **ends}
        _submit_folder(policies, checked(LadderRequest, common | named), idempotency_key, wait=wait, as_json=as_json)
        return
    if halving or rewards is not None:
        raise UsageProblem("--halving and --rewards are for a folder of checkpoints, which makes a ladder")
    common |= {"recipe": recipe, "training_seed": training_seed, "webhook": webhook, "images": images}
    common |= {"name": name, "note": note_text}
    with ApiClient(load_connection(os.environ)) as client:
        made = prepare(client, file, asking, common, trials=trials, manifest=manifest, layout=layout)
        note_warnings(made.warnings)
        job = client.create_job(made.wish, idempotency_key or uuid.uuid4().hex)
        if not as_json:
            print_line(job.job_id)
            if sys.stdout.isatty() and not wait:
                note(f"'trifarm watch {job.job_id}' follows it, 'trifarm report {job.job_id}' shows what came of it")
        if job.question is not None:
            note(job.question.findable)
        if wait:
            job = follow_to_end(client, job.job_id)
            note(ending(job, client.url))
        if as_json:
            print_document(job)
    if wait:
        raise typer.Exit(exit_code_of(job))


def _submit_folder(
    policies: Sequence[tuple[LocalPolicy, float]], wish: LadderRequest, key: str | None, *, wait: bool, as_json: bool
) -> None:
    with ApiClient(load_connection(os.environ)) as client:
        made = submit_ladder(client, policies, wish, key)
        if not as_json:
            print_line(made.ladder_id)
        if wait:
            made = follow_ladder(client, made.ladder_id)
        shown = f"'trifarm ladder {made.ladder_id}' shows them, {client.url}/ladders/{made.ladder_id} too"
        note(f"{counted(len(made.rungs), 'job')}; {shown}")
        if as_json:
            print_document(made)
    if wait:
        raise typer.Exit(ladder_exit_code(made))
