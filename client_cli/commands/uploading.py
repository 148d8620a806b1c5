"""A policy brought to a farm, with what is strange about it."""

from api_schemas.job import TaskName
from client_cli.connection.api_client import ApiClient
from client_cli.policies.policy_files import LocalPolicy
from client_cli.policies.trying import of_another_task
from client_cli.terminal.output import note


def upload(client: ApiClient, policy: LocalPolicy, task: TaskName) -> tuple[str, ...]:
    """Warnings about a policy that is asked to do ``task``: those of the farm's dry run, and that it is of another task.

    Raises:
        ClientError: the farm refuses it.
    """
    unlike = of_another_task(policy.manifest, task)
    found = client.upload_policy(policy.digest, policy.weights, policy.manifest).warnings
    return (*found, *(() if unlike is None else (unlike,)))


def note_warnings(warnings: tuple[str, ...], of: str = "") -> None:
    """Says warnings on stderr, with the name of the file where there are several."""
    for text in warnings:
        note(f"warning: {of}{': ' if of else ''}{text}")
