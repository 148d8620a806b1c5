"""``trifarm ladder``: success of each checkpoint of a ladder, with its interval."""

import json
import math
import os
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.job import JobState
from api_schemas.ladder import Ladder, LadderEnds, LadderRequest, Rung, RungRequest
from api_schemas.success_rate import SHOWN
from client_cli.commands.asking import USUAL_TRIALS, Asking
from client_cli.commands.uploading import note_warnings, upload
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.policies.checkpoints import Checkpoint
from client_cli.policies.policy_files import LocalPolicy, read_policy
from client_cli.terminal.errors import Interrupted, ServerAway, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import print_document, print_line, print_table
from client_cli.views.following import GIVE_UP_AFTER_S
from client_cli.views.progress import JobProgress
from client_cli.views.progress_view import progress_view

LOOK_EVERY_S = 1.0
COLUMNS = ("step", "job", "state", "done", "succeeded", "rate", SHOWN, "letters", "policy")
FOLDER = (
    "a folder makes several jobs, which 'trifarm ladder' shows; it takes --task, --until-known with --max, --halving, "
    "--rewards, and no --name, --note, --webhook, --against, --bar, --at-least, --like, --goals, --recipe or --images"
)
LadderArgument = Annotated[str, typer.Argument(metavar="ID", help="Ladder id, as printed by submit.")]


def ladder(ladder_id: LadderArgument, as_json: JsonOption = False) -> None:
    """Show a ladder: the success rate so far of each checkpoint of a folder, on the same goals."""
    with ApiClient(load_connection(os.environ)) as client:
        shown = client.ladder(ladder_id)
    if as_json:
        print_document(shown)
    else:
        print_ladder(shown)


def read_checkpoints(
    checkpoints: Sequence[Checkpoint], manifest: Path | None, layout: str | None
) -> tuple[tuple[LocalPolicy, float], ...]:
    """The policies, named like their files, and their steps; all are checked before the first is sent."""
    return tuple((read_policy(each.file, manifest, layout, name=each.file.stem[:100]), each.step) for each in checkpoints)


def submit_ladder(
    client: ApiClient, policies: Sequence[tuple[LocalPolicy, float]], wish: LadderRequest, idempotency_key: str | None
) -> Ladder:
    """Upload the policies and queue the ladder of them."""
    for policy, _ in policies:
        note_warnings(upload(client, policy, wish.task), policy.weights.name)
    return client.create_ladder(wish, idempotency_key or uuid.uuid4().hex)


def rungs_of(policies: Sequence[tuple[LocalPolicy, float]], rewards: Mapping[str, float]) -> tuple[RungRequest, ...]:
    """What is asked for of each policy; ``rewards`` are by the name of the file, with or without its end, or by the step.

    Raises:
        UsageProblem: there are rewards, but none of this policy.
    """
    return tuple(
        RungRequest(policy=policy.digest, step=step, training_reward=_reward(policy.weights, step, rewards))
        for policy, step in policies
    )


def _reward(file: Path, step: float, rewards: Mapping[str, float]) -> float | None:
    found = next((rewards[name] for name in (file.name, file.stem, f"{step:.10g}", f"{step:g}") if name in rewards), None)
    if rewards and found is None:
        raise UsageProblem(f"--rewards says nothing of {file.name}: name it by its file, or by its step {step:.10g}")
    return found


def read_rewards(file: Path) -> dict[str, float]:
    """The training rewards in a file.

    Raises:
        UsageProblem: it is no JSON object of numbers.
    """
    try:
        read = json.loads(file.read_text())
    except ValueError as error:
        raise UsageProblem(f"{file.name} is no JSON: {error}") from error
    good = isinstance(read, dict) and read and all(type(each) in (int, float) and math.isfinite(each) for each in read.values())
    if not good:
        raise UsageProblem(f'{file.name} has no object of numbers, such as {{"100000": 3.2, "200000": 5.1}}')
    return {name: float(value) for name, value in read.items()}


def ends_of(asking: Asking, *, halving: bool, trials: int | None) -> dict[str, object]:
    """The trials of a ladder, and by which rule rungs are given up.

    Raises:
        UsageProblem: something was asked for that a ladder does not know.
    """
    if asking != Asking(until_known=asking.until_known, most=asking.most) or (halving and asking.until_known):
        raise UsageProblem(FOLDER)
    if asking.most is not None and (trials is not None or not asking.until_known):
        raise UsageProblem("--max N is the most goals of each rung with --until-known; without it take --trials")
    ends = LadderEnds.KNOWN if asking.until_known else LadderEnds.HALVING if halving else None
    return {"trials": asking.most or trials or USUAL_TRIALS, "ends": ends}


def follow_ladder(client: ApiClient, ladder_id: str) -> Ladder:
    """Show a ladder's progress until its last job has ended. Ctrl-C leaves the jobs running."""
    heard_at_s = time.monotonic()
    try:
        with progress_view() as view:
            while True:
                try:
                    shown, heard_at_s = client.ladder(ladder_id), time.monotonic()
                except ServerAway:
                    if time.monotonic() - heard_at_s > GIVE_UP_AFTER_S:
                        raise
                else:
                    view.show(_progress(shown))
                    if shown.is_over:
                        return shown
                time.sleep(LOOK_EVERY_S)
    except KeyboardInterrupt:
        raise Interrupted(f"ladder {ladder_id} goes on without you; 'trifarm ladder {ladder_id}' shows it") from None


def _progress(shown: Ladder) -> JobProgress:
    done, successes = (sum(getattr(rung, name) for rung in shown.rungs) for name in ("trials_done", "successes"))
    return JobProgress(trials=shown.trials * len(shown.rungs), done=done, successes=successes)


def ladder_exit_code(shown: Ladder) -> ExitCode:
    """0 when each rung has its report."""
    whole = all(rung.state is JobState.SUCCEEDED for rung in shown.rungs)
    return ExitCode.OK if whole else ExitCode.JOB_WITHOUT_REPORT


def print_ladder(shown: Ladder) -> None:
    """The ladder as a table, the first line saying what it is."""
    drawn = " (drawn by the farm)" if shown.seed_drawn_by_server else ""
    print_line(f"{shown.name}: {shown.task.value}, {len(shown.rungs)} rungs × {shown.trials} trials, seed {shown.seed}{drawn}")
    print_table(COLUMNS, (_row(rung) for rung in shown.rungs))
    for line in said_of(shown):
        print_line(line)


def said_of(shown: Ladder) -> Iterator[str]:
    """The best rung, which others cannot be told from it, and whether success follows step and reward."""
    best = next((rung for rung in shown.rungs if rung.job_id == shown.best), None)
    if best is not None:
        alike = [r for r in shown.rungs if r is not best and set(r.letters or "") & set(best.letters or "")]
        others = ", ".join(f"{rung.step:.10g}" for rung in alike)
        yield f"best by lower bound: step {best.step:.10g}" + (f"; cannot be told from it: {others}" if others else "")
        yield "rungs that share a letter cannot be told apart, at every look; any false difference has a chance of 5 %"
    for found in shown.correlations:
        low, high = found.interval_95
        interval = f"{SHOWN} {low:+.2f} to {high:+.2f}, {found.rungs} rungs"
        yield f"rank correlation with {found.of}: {found.estimate:+.2f}, {interval}"


def _row(rung: Rung) -> tuple[object, ...]:
    rate = None if rung.success_rate is None else f"{100 * rung.success_rate:.0f} %"
    interval = None if rung.interval_95 is None else f"{100 * rung.interval_95[0]:.0f}–{100 * rung.interval_95[1]:.0f} %"
    done = f"{rung.trials_done}/{rung.trials}"
    state = "given up" if rung.given_up else rung.state.value
    return f"{rung.step:.10g}", rung.job_id, state, done, rung.successes, rate, interval, rung.letters, rung.policy_name
