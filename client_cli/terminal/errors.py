"""Errors of the command line, each with its exit code.

ClientError
 |- UsageProblem      2   a file, flag or setting that cannot be used
 |- ServerAway        4   nobody answers at the address
 |- Refused           5   the server answered with a problem
 |- Interrupted     130   Ctrl-C
 `- everything else   1
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from client_cli.terminal.exit_codes import ExitCode

if TYPE_CHECKING:
    from api_schemas.error import Problem

COMMANDS = {
    "GET /v1/jobs/<job>/events": "trifarm watch JOB",
    "GET /v1/jobs/<job>/trials": "trifarm report JOB --json",
    "POST /v1/jobs/<job>/cancel": "trifarm cancel JOB",
    "POST /v1/identifications": "trifarm identify",
    "GET /v1/jobs": "trifarm jobs",
    "GET /v1/robots": "trifarm robots",
    "GET /v1/tokens": "trifarm token list",
    "PUT /v1/canary": "trifarm canary set",
}
"""What a server's hint is called here; longer routes stand before those that they begin with."""


class ClientError(Exception):
    """What went wrong, in one sentence that says what to do; a command ends with it.

    ``detail`` is the sentence; ``after_document`` says that stdout already has the command's JSON document.
    """

    title = "error"
    exit_code = ExitCode.OTHER

    def __init__(self, detail: str, *, after_document: bool = False):
        super().__init__(detail)
        self.detail = detail
        self.after_document = after_document


class UsageProblem(ClientError):
    """Something the user gave cannot be used; the text names the valid choices."""

    title = "wrong usage"
    exit_code = ExitCode.USAGE


class ServerAway(ClientError):
    """No server answers at ``url``, or the connection broke."""

    title = "server away"
    exit_code = ExitCode.SERVER_AWAY

    def __init__(self, url: str, why: str):
        super().__init__(
            f"no trifarm server answers at {url} ({why}); start one with 'trifarm up', "
            "or name another with TRIFARM_URL and TRIFARM_TOKEN"
        )


class Refused(ClientError):
    """The server answered with a problem document; ``retry_after_s`` is when to ask again, where it said so."""

    exit_code = ExitCode.REFUSED

    def __init__(self, problem: "Problem", retry_after_s: float | None = None):
        super().__init__(problem.detail)
        self.title = problem.title
        self.problem = problem
        self.retry_after_s = retry_after_s


class Interrupted(ClientError):
    """Ctrl-C, where more is to be said than nothing."""

    title = "interrupted"
    exit_code = ExitCode.INTERRUPTED


@contextmanager
def files_checked() -> Iterator[None]:
    """A file or folder inside that cannot be read or written is the user's to name anew; a closed pipe is nobody's fault.

    Raises:
        UsageProblem: instead of an OSError, with the path and the reason.
    """
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageProblem(f"cannot use {error.filename}: {reason}" if error.filename else reason) from error


def error_line(error: ClientError) -> str:
    """What stderr gets when a command fails; a problem's title tells its kind."""
    if isinstance(error, Interrupted):
        return f"{error.title}: {error.detail}"
    adds = isinstance(error, Refused) and not error.detail.startswith(error.title)
    detail = error.detail
    if isinstance(error, Refused):
        for route, command in COMMANDS.items():
            detail = detail.replace(route, f"'{command}'")
    return f"error: {detail}" + (f" ({error.title})" if adds else "")


def error_document(error: ClientError) -> dict[str, object]:
    """What stdout gets with ``--json`` when a command fails."""
    more = {"type": error.problem.type, "status": error.problem.status} if isinstance(error, Refused) else {}
    from api_schemas import error as documents  # pydantic, which help does not need

    return documents.error_document(error.title, error.detail, int(error.exit_code), **more)
