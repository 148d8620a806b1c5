"""``trifarm why``: which of its robot's effects made a trial fail, by simulating it again without them."""

import json
import os
import re
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.builtin_policies import PREFIX, builtin_content, builtin_manifest
from api_schemas.policy import canonical_json
from api_schemas.trial import OutcomeKind
from api_schemas.why import JobWhy, TrialWhy, Why, WhyEffect, WhyGroup, WhyState, job_why
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.embedded.child_process import child_environment, module_command
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.child_answer import answer_of
from client_cli.terminal.errors import ClientError, Refused, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import counted, note, print_document, print_line, print_table

EXPLAINING, CONVERSION = "robot_farm.explaining", "services.policies.conversion"
A_TRIAL = re.compile(r".*-[0-9]{3,5}")
LOOK_EVERY_S = 1.0
TOO_MANY = 429


def why(
    asked: Annotated[
        str, typer.Argument(metavar="TRIAL|JOB|LOG", help="A trial's or a job's id, or the log of a trial with its --truth.")
    ],
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="FILE", help="Truth of the log's trial, from 'trifarm fetch --truth' (operators only)."),
    ] = None,
    policy: Annotated[
        str | None, typer.Option("--policy", metavar="FILE", help="Weights of the log's policy, with a manifest beside them.")
    ] = None,
    most: Annotated[
        int, typer.Option("--most", min=1, max=1000, help="Of a job, how many failed trials are explained, the first of them.")
    ] = 20,
    as_json: JsonOption = False,
) -> None:
    """Say why a trial failed: simulate it again without each group of its robot's effects, with its policy in the loop."""
    if (log := Path(asked)).suffix == ".mcap" or log.is_file():
        _of_log(log, truth, policy, as_json=as_json)
        return
    if truth is not None or policy is not None:
        raise UsageProblem("--truth and --policy go with the log of a trial; a farm has both")
    with ApiClient(load_connection(os.environ)) as client:
        if A_TRIAL.fullmatch(asked):
            found = _answered(client, client.ask_why(asked))
            _show_trial(found, as_json=as_json)
        else:
            table = _of_job(client, asked, most)
            if as_json:
                print_document(table)
            else:
                _show_job(table)


def _of_log(log: Path, truth: Path | None, policy: str | None, *, as_json: bool) -> None:
    if truth is None or policy is None:
        raise UsageProblem(f"{log.name} is simulated on this machine with --truth FILE and --policy FILE; give both")
    for path in (log, truth):
        if not path.is_file():
            raise UsageProblem(f"there is no file {path}")
    with tempfile.TemporaryDirectory(prefix="trifarm-why-") as folder:
        graph = _graph_of(policy, Path(folder))
        ended = answer_of(module_command(EXPLAINING, str(log), "--truth", str(truth), "--graph", str(graph)))
    if ended.returncode in (ExitCode.USAGE, ExitCode.DIFFERS, ExitCode.OTHER_FORM) and ended.stdout:
        raise _CannotExplain(_error_of(ended.stdout), ExitCode(ended.returncode))
    if ended.returncode:
        raise ClientError(f"'why' {how_it_ended(ended.returncode)}")
    found = Why.model_validate_json(ended.stdout)
    if as_json:
        print_document(found)
    else:
        _show(found)


class _CannotExplain(ClientError):
    """The trial's files give no answer."""

    def __init__(self, message: str, code: ExitCode) -> None:
        super().__init__(message)
        self.exit_code = code


def _error_of(said: str) -> str:
    return str(json.loads(said)["error"])


def _graph_of(policy: str, folder: Path) -> Path:
    """The policy as robots run it, in a folder."""
    graph, text = folder / "graph.onnx", folder / "manifest.json"
    if builtin_manifest(policy) is not None:
        graph.write_bytes(builtin_content(policy.removeprefix(PREFIX)))
        return graph
    found = read_policy(Path(policy), None, None)
    text.write_text(canonical_json(found.manifest))
    command = module_command(CONVERSION, str(found.weights.absolute()), str(text), str(graph), "none")
    ended = subprocess.run(command, env=child_environment(), cwd=folder, capture_output=True, check=False)
    if not graph.is_file():
        said = ended.stdout.decode(errors="replace").strip() or how_it_ended(ended.returncode)
        raise UsageProblem(f"{policy} cannot be converted: {said}; 'trifarm check {policy}' says more")
    return graph


def _of_job(client: ApiClient, job_id: str, most: int) -> JobWhy:
    failed = [trial for trial in client.trials(job_id) if trial.outcome is not None and trial.outcome.kind is OutcomeKind.FAILED]
    if not failed:
        raise ClientError(f"no trial of job {job_id} missed its goal so far; there is nothing to explain")
    asked: list[TrialWhy] = []
    for trial in failed[:most]:
        try:
            asked.append(client.ask_why(trial.trial_id))
        except Refused as error:
            if error.problem.status != TOO_MANY:
                raise
            note(f"{trial.trial_id} is left out: {error.problem.detail}")
    answers = []
    for number, each in enumerate(asked, 1):
        answers.append(_answered(client, each))
        note(f"{number} of {counted(len(asked), 'trial')}: {each.trial}: {answers[-1].sentence or answers[-1].problem}")
    return job_why(job_id, len(failed), answers)


def _answered(client: ApiClient, found: TrialWhy) -> TrialWhy:
    """Wait for the answer."""
    told = None
    while found.state in (WhyState.QUEUED, WhyState.RUNNING):
        if found.state is not told:
            told = found.state
            note(f"{found.trial}: {'waits for its turn' if told is WhyState.QUEUED else 'is simulated again and again'} …")
        time.sleep(LOOK_EVERY_S)
        found = client.why(found.trial)
    return found


def _show_trial(found: TrialWhy, *, as_json: bool) -> None:
    if as_json:
        print_document(found)
    if found.why is None:
        raise ClientError(f"why {found.trial} failed cannot be said: {found.problem}", after_document=as_json)
    if not as_json:
        _show(found.why)
        if found.questions_left is not None:
            note(f"{counted(found.questions_left, 'question')} left for the robot of this trial")


def _show(found: Why) -> None:
    print_line(f"{found.trial}: {found.sentence}")
    if found.effects is None:
        return
    rows = [(each.words, *_counts(each), "") for each in found.groups]
    rows += [(each.name, *_counts(each), _values(each.values)) for each in found.effects]
    print_table(("without", "turns it", "other noise", "explains", "values"), rows)


def _counts(each: WhyGroup | WhyEffect) -> tuple[str, str, str]:
    tried = f"{each.successes} of {each.replays}" if each.replays else "-"
    return "yes" if each.turned else "no", tried, "yes" if each.explains else "no"


def _values(values: dict[str, float | tuple[float, ...]]) -> str:
    return ", ".join(
        f"{name} {' '.join(f'{number:.4g}' for number in (value if isinstance(value, tuple) else (value,)))}"
        for name, value in values.items()
    )


def _show_job(table: JobWhy) -> None:
    print_line(f"job {table.job_id}: {table.answered} of {counted(table.failed, 'failed trial')} answered")
    rows = [
        (each.words, each.trials, f"{each.share:.0%}", f"{each.interval_80[0]:.0%} to {each.interval_80[1]:.0%}")
        for each in table.groups
    ]
    if rows:
        print_table(("it succeeds without", "trials", "share", "80 % interval"), rows)
    causes = {"cause": "a group", "chance": "chance", "together": "several groups together", "policy": "the policy"}
    print_line("the cause is " + ", ".join(f"{causes[verdict]} in {count}" for verdict, count in table.verdicts.items()))
    print_line(f"advice: {table.advice}")
