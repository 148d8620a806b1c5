"""What a job is to find out, and whose goals it tries, as options of ``submit`` and arguments of ``Farm.submit`` say it."""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from api_schemas.builtin_policies import PREFIX, builtin_digest
from api_schemas.job import MAX_CHOSEN, MAX_SEED, POLICY_TASKS, Job, TaskName
from client_cli.commands.builtins import builtin_named
from client_cli.commands.uploading import upload
from client_cli.connection.api_client import ApiClient
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.errors import UsageProblem

USUAL_TRIALS, USUAL_MOST = 40, 200
JOB = re.compile(r"j[a-z2-7]{12}")
DIGEST = re.compile(r"[0-9a-f]{64}")
AgainstOption = Annotated[
    str | None,
    typer.Option("--against", metavar="JOB|POLICY", help="With --until-known: a job, or a policy (file, builtin: or digest)."),
]
BarOption = Annotated[
    float | None, typer.Option("--bar", help="With --until-known: is the success rate above this, such as 0.8?")
]
UntilKnownOption = Annotated[
    bool, typer.Option("--until-known", help="End the job when it is known whether it is better, or at --max goals.")
]
MaxOption = Annotated[
    int | None, typer.Option("--max", min=1, max=MAX_CHOSEN, help="Most goals that --until-known may try; 200 by default.")
]
AtLeastOption = Annotated[
    float | None,
    typer.Option("--at-least", help="Smallest difference that matters, such as 0.1; ends also when there is none so large."),
]
LikeOption = Annotated[
    str | None, typer.Option("--like", metavar="JOB", help="Take task, goals and orders of robots from this job.")
]
GoalsOption = Annotated[
    Path | None, typer.Option("--goals", metavar="FILE", help="Goals of your own: a JSON list, one entry for each trial.")
]
RecipeOption = Annotated[
    str | None,
    typer.Option("--recipe", metavar="NAME", help="The training that the policy is one seed of; with --training-seed."),
]
TrainingSeedOption = Annotated[
    int | None, typer.Option("--training-seed", min=0, max=MAX_SEED, help="Which seed of --recipe trained the policy.")
]
HalvingOption = Annotated[
    bool, typer.Option("--halving", help="Of a folder: give up the worse half of the rungs at each stage (successive halving).")
]
RewardsOption = Annotated[
    Path | None,
    typer.Option(
        "--rewards", metavar="FILE", help="Of a folder: training rewards, a JSON object from step or file name to number."
    ),
]


@dataclass(frozen=True)
class Asking:
    """What was asked for beyond a policy and a task."""

    against: str | None = None
    bar: float | None = None
    until_known: bool = False
    most: int | None = None
    at_least: float | None = None
    like: str | None = None
    goals: Path | None = None

    def check(self) -> None:
        """Raises for options that say nothing together."""
        asks = self.against is not None or self.bar is not None
        if self.until_known and not asks:
            raise UsageProblem("--until-known needs --against JOB|POLICY or --bar RATE: what is to be known?")
        if not self.until_known and (asks or self.most is not None or self.at_least is not None):
            raise UsageProblem(
                "--against, --bar, --max and --at-least go with --until-known; for a fixed number of trials on the same goals "
                "take --like JOB and 'trifarm compare'"
            )

    @property
    def goals_of(self) -> str | None:
        """The job whose goals are taken."""
        return self.against if self.against is not None and JOB.fullmatch(self.against) else self.like


def wish_of(
    client: ApiClient,
    asking: Asking,
    common: Mapping[str, Any],
    *,
    trials: int | None,
    layout: str | None = None,
    warn: Callable[[str], None],
) -> dict[str, Any]:
    """The fields of a job's request; uploads the other policy, and takes from another job what is to be like it.

    ``warn`` is told what is strange about the other policy.

    Raises:
        UsageProblem: options contradict each other, or no task is named.
        ClientError: the farm refuses the other policy, or has no such job.
    """
    asking.check()
    wish = dict(common)
    if asking.until_known:
        if trials is not None:
            raise UsageProblem("--until-known takes --max N for the most goals that may be tried, not --trials")
        wish["trials"] = asking.most or USUAL_MOST
    elif trials is not None:
        wish["trials"] = trials
    if asking.goals is not None:
        wish["goals"] = read_goals(asking.goals)
        if asking.until_known and asking.most is None:
            wish.pop("trials")
    elif "trials" not in wish:
        wish["trials"] = USUAL_TRIALS
    if asking.goals_of is not None:
        wish |= _like(client.job(asking.goals_of), wish, is_fixed=trials is not None or asking.most is not None)
    if wish.get("task") is None:
        raise UsageProblem(
            f"--task names what is asked of the robots ({', '.join(POLICY_TASKS)}); only a job like another takes it from there"
        )
    if asking.like is not None:
        wish["like"] = asking.like
    if asking.until_known:
        against = None if asking.against is None else _other(client, asking.against, layout, TaskName(wish["task"]), warn)
        wish["question"] = {"against": against, "bar": asking.bar, "at_least": asking.at_least}
    return wish


def _like(other: Job, wish: Mapping[str, Any], *, is_fixed: bool) -> dict[str, Any]:
    if wish.get("task") not in (None, other.task):
        raise UsageProblem(f"job {other.job_id} is of {other.task}, not of {wish['task']}; leave --task out")
    trials = min(wish["trials"], other.trials) if is_fixed else other.trials
    return {"task": other.task, "object": other.object, "object_scale": other.object_scale, "trials": trials}


def _other(client: ApiClient, named: str, layout: str | None, task: TaskName, warn: Callable[[str], None]) -> str:
    """The job or the digest of the policy that is meant."""
    if JOB.fullmatch(named) or DIGEST.fullmatch(named):
        return named
    if named.startswith(PREFIX):
        builtin = builtin_named(Path(named))
        client.take_builtin(builtin)
        return builtin_digest(builtin)
    policy = read_policy(Path(named), None, layout)
    for text in upload(client, policy, task):
        warn(f"{policy.weights.name}: {text}")
    return policy.digest


def read_goals(file: Path) -> list[Any]:
    """The goals in a file, not checked yet.

    Raises:
        UsageProblem: it is no JSON list.
    """
    try:
        goals = json.loads(file.read_text())
    except ValueError as error:
        raise UsageProblem(f"{file.name} is no JSON: {error}") from error
    if not isinstance(goals, list):
        raise UsageProblem(f'{file.name} has no list of goals, such as [{{"position_m": [0.05, 0.0, 0.0325]}}]')
    return goals
