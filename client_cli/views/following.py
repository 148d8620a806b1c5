"""Follows one job to its end over the event stream, and through lost connections."""

import time
from dataclasses import dataclass, replace

from api_schemas.job import FINAL_JOB_STATES, EventKind, Job, JobEvent, JobState, TaskName
from api_schemas.success_rate import SHOWN, SHOWN_LEVEL, wilson
from client_cli.connection.api_client import ApiClient
from client_cli.connection.patience import pause_s
from client_cli.terminal.errors import Interrupted, Refused, ServerAway
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.output import counted
from client_cli.views.progress import JobProgress, advance, progress_of, question_sentence, waiting_sentence
from client_cli.views.progress_view import ProgressView, progress_view

GIVE_UP_AFTER_S = 60.0
"""So long a server may be away before following ends."""
RECONNECT_EVERY_S = 1.0
SERVER_FAULTS_FROM = 500


@dataclass
class Followed:
    """What changes while a job is followed: its progress, the last event seen, and when something was last heard."""

    progress: JobProgress
    last_event: int | None = None
    ended: bool = False
    is_away: bool = False
    heard_at_s: float = 0.0


def follow_to_end(client: ApiClient, job_id: str) -> Job:
    """Show a job's progress until it ends, and return it as it ended. Ctrl-C leaves the job running."""
    try:
        job = client.job(job_id)
        if job.state in FINAL_JOB_STATES:
            return job
        followed = Followed(progress=progress_of(job), heard_at_s=time.monotonic())
        with progress_view() as view:
            view.show(followed.progress)
            while not followed.ended:
                _follow_while_connected(client, job_id, followed, view)
        return client.job(job_id)
    except KeyboardInterrupt:
        raise Interrupted(f"job {job_id} goes on without you; 'trifarm watch {job_id}' comes back to it") from None


def _follow_while_connected(client: ApiClient, job_id: str, followed: Followed, view: ProgressView) -> None:
    again_after_s = RECONNECT_EVERY_S
    try:
        _read_events(client, job_id, followed, view)
        # A stream that ends without the job's last event was cut by a stopping server.
        followed.ended = followed.ended or client.job(job_id).state in FINAL_JOB_STATES
    except (ServerAway, Refused) as error:
        busy_s = pause_s(error)
        is_client_fault = isinstance(error, Refused) and error.problem.status < SERVER_FAULTS_FROM and busy_s is None
        if is_client_fault or time.monotonic() - followed.heard_at_s > GIVE_UP_AFTER_S:
            raise
        if not followed.is_away:
            why = f"connection lost, trying again for {GIVE_UP_AFTER_S:.0f} s: {client.url} does not answer"
            view.say(why if busy_s is None else f"trying again for {GIVE_UP_AFTER_S:.0f} s: {error.detail}")
        followed.is_away = True
        again_after_s = again_after_s if busy_s is None else busy_s
    if not followed.ended:
        time.sleep(again_after_s)


def _read_events(client: ApiClient, job_id: str, followed: Followed, view: ProgressView) -> None:
    for event in client.events(job_id, followed.last_event):
        followed.heard_at_s, followed.is_away = time.monotonic(), False
        if event is None:
            sentence = waiting_sentence(client.job(job_id))
            followed.progress = replace(followed.progress, waiting_because=sentence)
        else:
            followed.progress = _with_question(client, advance(followed.progress, event), event)
            followed.last_event = event.id
            followed.ended = event.kind == EventKind.JOB_ENDED  # final states are also in the past of a job that was queued again
        view.show(followed.progress)
        if followed.ended:
            return


def _with_question(client: ApiClient, progress: JobProgress, event: JobEvent) -> JobProgress:
    """The progress with its question as it stands after a trial."""
    if progress.question is None or event.kind != EventKind.TRIAL_DONE:
        return progress
    question = client.job(event.job_id).question
    return progress if question is None else replace(progress, question=question_sentence(question))


def ending(job: Job, url: str | None = None) -> str:
    """How a job ended, in one line that names the next command, and its page where the farm at ``url`` has one."""
    return _ending(job) + ("" if url is None else f"; {url}/jobs/{job.job_id}")


def _rate(job: Job) -> str:
    low, high = wilson(job.successes, job.trials, SHOWN_LEVEL)
    return f"{100 * job.successes / job.trials:.0f} %, {SHOWN} {100 * low:.0f}–{100 * high:.0f} %"


def _ending(job: Job) -> str:
    if job.state is JobState.SUCCEEDED and job.task is TaskName.IDENTIFY:
        recorded = f"{counted(job.trials, 'excitation')} recorded on {job.robot}"
        return f"job {job.job_id}: {recorded}; 'trifarm fetch {job.job_id} --to DIR' brings them"
    if job.state is JobState.SUCCEEDED and job.question is not None:
        return f"job {job.job_id}: {job.question.sentence}; 'trifarm report {job.job_id}' shows the trials"
    if job.state is JobState.SUCCEEDED:
        told = f"{job.successes} of {job.trials} trials succeeded, {_rate(job)}"
        return f"job {job.job_id}: {told}; 'trifarm report {job.job_id}' shows them"
    done = f"{job.trials_done} of {job.trials} trials done"
    return f"job {job.job_id} {job.state.value}: {job.reason or 'no reason given'} ({done})"


def exit_code_of(job: Job) -> ExitCode:
    """0 for a job that has its report, whatever its success rate; 3 for one that has none."""
    return ExitCode.OK if job.state is JobState.SUCCEEDED else ExitCode.JOB_WITHOUT_REPORT
