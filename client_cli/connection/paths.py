"""Where on a server things are: an id is checked before it becomes a part of an address, in which it could mean another."""

import re

from client_cli.terminal.errors import UsageProblem

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")


def job_path(job_id: str) -> str:
    """Of a job; one reads like jabcdefghijkl."""
    return f"/v1/jobs/{_checked(job_id, 'job', 'jabcdefghijkl', 'trifarm jobs')}"


def ladder_path(ladder_id: str) -> str:
    """Of a ladder; one reads like labcdefghijkl."""
    return f"/v1/ladders/{_checked(ladder_id, 'ladder', 'labcdefghijkl', 'trifarm submit DIR')}"


def robot_path(robot: str) -> str:
    """Of a robot; one reads like robot-0."""
    return f"/v1/robots/{_checked(robot, 'robot', 'robot-0', 'trifarm robots')}"


def share_path(share_id: str) -> str:
    """Of a share; one reads like sabcdefghijkl."""
    return f"/v1/shares/{_checked(share_id, 'share', 'sabcdefghijkl', 'trifarm share list')}"


def token_path(token_id: str) -> str:
    """Of a token, by its id, which is not the token itself."""
    return f"/v1/tokens/{_checked(token_id, 'token', 'abcdefghijkl', 'trifarm token list')}"


def trial_path(trial_id: str) -> str:
    """Of a trial; one reads like jabcdefghijkl-007."""
    job_id, _, ordinal = trial_id.rpartition("-")
    if not job_id or not ordinal.isdecimal():
        raise UsageProblem(f"{trial_id!r} is no trial of a farm; one reads like jabcdefghijkl-007")
    return f"{job_path(job_id)}/trials/{int(ordinal)}"


def _checked(text: str, what: str, example: str, shown_by: str) -> str:
    if not _ID.fullmatch(text):
        raise UsageProblem(f"{text[:80]!r} is no id of a {what}; one reads like {example}, and '{shown_by}' shows it")
    return text
