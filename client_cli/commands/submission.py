"""A policy brought to a farm, and the job that is asked of it: what ``trifarm submit`` and ``Farm.submit`` have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from api_schemas.builtin_policies import builtin_digest
from api_schemas.job import JobRequest
from api_schemas.ladder import LadderRequest
from client_cli.commands.asking import Asking, wish_of
from client_cli.commands.builtins import builtin_named
from client_cli.commands.label import labels_of
from client_cli.commands.uploading import upload
from client_cli.connection.api_client import ApiClient
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.wrong_values import sentence

LABELS = ("name", "note")
Wish = TypeVar("Wish", JobRequest, LadderRequest)


@dataclass(frozen=True)
class Submission:
    """A job that may be queued: the farm has its policy. ``warnings`` are for whoever asks for it."""

    wish: JobRequest
    warnings: tuple[str, ...]


def prepare(
    client: ApiClient,
    weights: Path,
    asking: Asking,
    asked: Mapping[str, Any],
    *,
    trials: int | None,
    manifest: Path | None,
    layout: str | None,
) -> Submission:
    """Checks what is asked for, then uploads the policies; nothing is queued yet.

    Args:
        client: of the farm.
        weights: a file, or ``builtin:NAME``.
        asking: what the job is to find out, and whose goals it tries.
        asked: fields of the request as they are, such as task, seed and name; None where nothing was said.
        trials: how many, if that was said.
        manifest: the manifest's file, if not the one beside the weights.
        layout: a ready-made manifest instead.

    Raises:
        UsageProblem: a file or a value cannot be used.
        ClientError: the farm refuses a policy.
    """
    labels = labels_of({key: asked[key] for key in LABELS if asked.get(key) is not None})
    wanted = {key: value for key, value in asked.items() if key not in LABELS} | labels.model_dump(exclude_unset=True)
    builtin = builtin_named(weights)
    policy = None if builtin else read_policy(weights, manifest, layout)
    warnings: list[str] = []
    wanted = wish_of(client, asking, wanted, trials=trials, layout=layout, warn=warnings.append)
    wish = checked(JobRequest, wanted | {"policy": builtin_digest(builtin) if policy is None else policy.digest})
    if policy is None:
        client.take_builtin(builtin)
    else:
        warnings += upload(client, policy, wish.task)
    return Submission(wish, tuple(warnings))


def checked(schema: type[Wish], asked: Mapping[str, object]) -> Wish:
    """What is asked for.

    Raises:
        UsageProblem: with the first thing that is wrong with it.
    """
    try:
        return schema.model_validate(asked)
    except ValidationError as error:
        raise UsageProblem(sentence(error, "the job")) from error
